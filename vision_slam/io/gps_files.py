"""GPS files: NMEA, RTKLIB, u-blox, Android GnssLogger, GPX tracks, tables."""

import csv
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from survey.core.errors import ConfigError, InputError
from survey.core.files.library_messages import first_line
from survey.core.files.reading import existing_file
from survey.io.tables import read_table
from survey.io.tracks import read_gpx
from vision_slam.io.gps_log import WGS84, GpsLog
from vision_slam.io.receivers.gnss_logger import read_gnss_logger
from vision_slam.io.receivers.nmea import read_nmea
from vision_slam.io.receivers.rows import ReceiverFixes
from vision_slam.io.receivers.tables import read_fix_table
from vision_slam.io.receivers.ublox import SYNC, read_ublox
from vision_slam.io.receivers.usable import usable
from vision_slam.io.rtklib import read_positions

_DEGREES = ("time_s", "latitude_deg", "longitude_deg", "height_m")
_METRES = ("time_s", "easting_m", "northing_m", "height_m")


def read_gps(path: str | Path, columns: Sequence[str] = ()) -> GpsLog:
    """Read a GPS file; records without a fix, places that are not finite, at 0° N 0° E or repeated are left out and counted.

    ``.gpx``; ``.ubx`` of u-blox (NAV-PVT); RTKLIB's positions in degrees (``.pos``); logs of Android's
    GnssLogger; tables with the columns time_s, easting_m, northing_m, height_m or time_s,
    latitude_deg, longitude_deg, height_m, and with or without sigma_m, or with the usual names
    of other programs (lat, lon, alt, timestamp, hAcc …); NMEA 0183, bare or as phones log
    it, of which the GGA sentences give time of day, position, quality and height above the geoid, GST
    sentences the standard deviation, and RMC and ZDA sentences the date. Where no GST sentence states it,
    fixed RTK solutions count as of 2 cm, float ones of 0.3 m. Other suffixes are recognized by their content.

    Parameters
    ----------
    path : str or pathlib.Path
        The file.
    columns : sequence of str
        Columns of a table by key, such as ``time=t,x=Easting``.

    Returns
    -------
    GpsLog
        Fixes in degrees or in metres.

    Raises
    ------
    InputError
        Missing, damaged, times that do not increase, or no fix at all.
    ConfigError
        Columns are named, and the file is no table.
    """
    file = existing_file(path, "the fixes")
    suffix = file.suffix.lower()
    kind = suffix if suffix in _READERS and suffix != ".txt" else _kind_of(file)
    if columns and kind != ".csv":
        raise ConfigError(f"{file} is no table; leave --columns out.")
    if columns or (kind == ".csv" and not _has_own_columns(file)):
        return _usable(GpsLog(**read_fix_table(file, columns)._asdict()), file)
    return _usable(_READERS[kind](file), file)


def _usable(log: GpsLog, file: Path) -> GpsLog:
    """Leave out fixes that are not finite, repeat the one before or lie at 0° N 0° E, with notes."""
    stays, notes = usable(log.time_s, log.place, log.sigma_m, str(file))
    sigma_m = None if log.sigma_m is None else log.sigma_m[stays]
    log = replace(
        log, time_s=log.time_s[stays], place=log.place[stays], sigma_m=sigma_m, notes=(*log.notes, *notes)
    )
    return log.without_zero_places(str(file))


def _has_own_columns(file: Path) -> bool:
    """Return whether a table has firnline's own names of columns."""
    header = set(_header(file))
    return set(_DEGREES) <= header or set(_METRES) <= header


def _kind_of(file: Path) -> str:
    """Return the suffix that fits the content of a file."""
    with file.open("rb") as stream:
        head = stream.read(_SNIFFED_BYTES)
    if SYNC in head[:_SYNC_WITHIN]:
        return ".ubx"
    lines = [line.strip() for line in head.decode("utf-8", errors="replace").splitlines()]
    if lines and "RINEX" in lines[0]:
        raise InputError(
            f"{file} holds raw observations (RINEX) and no positions; process them with RTKLIB and give its .pos file."
        )
    if any(line.startswith(("Fix,", "# Fix,")) for line in lines):
        return ".txt"
    if any("$G" in line and "," in line for line in lines):
        return ".nmea"
    plain = next((line for line in lines if line and not line.startswith(("%", "#"))), "")
    if _RTKLIB_LINE.match(plain):
        return ".pos"
    has_header = any(mark in plain for mark in ",;\t") and any(map(str.isalpha, plain))
    return ".csv" if has_header else ".nmea"


def _from_gpx(file: Path) -> GpsLog:
    unix_s, place = read_gpx(file, WGS84)
    return GpsLog(unix_s, place, is_dated=True)


def _from_positions(file: Path) -> GpsLog:
    time_s, place, sigma_m = read_positions(file)
    return GpsLog(time_s, place, is_dated=True, sigma_m=sigma_m)


def _log_of(read: Callable[[Path], ReceiverFixes]) -> Callable[[Path], GpsLog]:
    """Return a reader of logs from a reader of fixes."""
    return lambda file: GpsLog(**read(file)._asdict())


def is_receiver_file(path: str | Path) -> bool:
    """Return whether a file holds fixes of a receiver rather than poses, by its suffix and columns.

    Parameters
    ----------
    path : str or pathlib.Path
        The file.

    Returns
    -------
    bool
        False for ``.tum`` and for tables without the columns of fixes.
    """
    file = existing_file(path, "the reference")
    if file.suffix.lower() == ".csv":
        return "height_m" in _header(file)
    return file.suffix.lower() != ".tum"


def _header(file: Path) -> list[str]:
    try:
        with file.open(encoding="utf-8", newline="") as stream:
            return next(csv.reader(stream), [])
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{file} is no table of text ({first_line(error)}); get it again.") from error


def _from_table(file: Path) -> GpsLog:
    header = _header(file)
    names = _DEGREES if "latitude_deg" in header else _METRES
    table = read_table(file, names, what="the table of fixes")
    rows = np.column_stack([table[name] for name in names])
    sigma_m = table.get("sigma_m")
    if sigma_m is not None and not (sigma_m > 0.0).all():
        raise InputError(
            f"{file} holds a sigma_m that is not above 0; write the error of each fix in metres."
        )
    if names is _METRES:
        return GpsLog(rows[:, 0], rows[:, 1:], is_geodetic=False, sigma_m=sigma_m)
    return GpsLog(rows[:, 0], rows[:, [2, 1, 3]], sigma_m=sigma_m)


_SNIFFED_BYTES, _SYNC_WITHIN = 65536, 4096
_RTKLIB_LINE = re.compile(r"(\d{4}[/-]\d{2}[/-]\d{2}[ ,]+\d{1,2}:\d{2}:|\d{4}[ ,]+\d{1,6}\.\d+[ ,])")
_READERS: dict[str, Callable[[Path], GpsLog]] = {
    ".gpx": _from_gpx,
    ".pos": _from_positions,
    ".ubx": _log_of(read_ublox),
    ".csv": _from_table,
    ".nmea": _log_of(read_nmea),
    ".txt": _log_of(read_gnss_logger),
}
