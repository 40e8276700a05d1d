"""Formats of satellite receivers: Android GnssLogger, u-blox, tables of other programs."""
