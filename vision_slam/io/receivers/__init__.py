"""Formats of satellite receivers: NMEA 0183, Android GnssLogger, u-blox, tables of other programs."""
