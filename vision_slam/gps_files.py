"""Satellite fixes from receivers' own files: NMEA sentences, GPX tracks, CSV tables."""

import csv
from pathlib import Path

import numpy as np
from pyproj import CRS

from survey.arrays import FloatArray
from survey.errors import InputError
from survey.geodesy import projected_crs, transformed
from survey.io.files import existing_file
from survey.io.tables import read_table
from survey.io.tracks import read_track
from survey.sensors import GpsFixes

_WGS84 = CRS.from_epsg(4326)
_DAY_S = 86400.0
_DEGREES = ("time_s", "latitude_deg", "longitude_deg", "height_m")
_METRES = ("time_s", "easting_m", "northing_m", "height_m")


def read_gps(path: str | Path, crs: CRS | str) -> GpsFixes:
    """Read fixes into a projected CRS; sentences without a fix are left out.

    ``.gpx``; ``.csv`` with the columns time_s, easting_m, northing_m, height_m or time_s,
    latitude_deg, longitude_deg, height_m; anything else is read as NMEA 0183, of which the
    GGA sentences tell time of day, place and height above the geoid.

    Raises
    ------
    InputError
        Missing, damaged, no fix at all, or times that do not increase.
    """
    file, metric = existing_file(path, "the fixes"), projected_crs(crs, "the fixes")
    if file.suffix.lower() == ".gpx":
        time_s, position = read_track(file, metric)
    elif file.suffix.lower() == ".csv":
        time_s, position = _from_table(file, metric)
    else:
        rows = _gga_rows(file)
        time_s, position = rows[:, 0], _projected(rows[:, 1:], metric, file)
    return GpsFixes(time_s, position)


def _from_table(file: Path, crs: CRS) -> tuple[FloatArray, FloatArray]:
    with file.open(encoding="utf-8", newline="") as stream:
        header = next(csv.reader(stream), [])
    names = _DEGREES if "latitude_deg" in header else _METRES
    table = read_table(file, names, what="the table of fixes")
    rows = np.column_stack([table[name] for name in names])
    return rows[:, 0], rows[:, 1:] if names is _METRES else _projected(rows[:, 1:], crs, file)


def _projected(degrees: FloatArray, crs: CRS, file: Path) -> FloatArray:
    """Latitude, longitude, height (N, 3) to easting, northing, height."""
    return np.column_stack([transformed(degrees[:, 1::-1], _WGS84, crs, f"the fixes {file}"), degrees[:, 2]])


def _gga_rows(file: Path) -> FloatArray:
    """Time since the first midnight [s], latitude, longitude [deg], height [m] of sentences that hold a fix."""
    rows: list[tuple[float, float, float, float]] = []
    days = 0.0
    for number, line in enumerate(file.read_text(encoding="ascii", errors="replace").splitlines(), start=1):
        if line[3:6] != "GGA" or not line.startswith("$"):
            continue
        words = _checked_words(line, f"{file}, line {number}")
        if words[6] in ("", "0"):
            continue
        try:
            clock = float(words[1][:2]) * 3600.0 + float(words[1][2:4]) * 60.0 + float(words[1][4:])
            latitude = _degrees(words[2], 2) * (1.0 if words[3] == "N" else -1.0)
            longitude = _degrees(words[4], 3) * (1.0 if words[5] == "E" else -1.0)
            height = float(words[9])
        except ValueError as error:
            raise InputError(
                f"{file}, line {number}: {error} in a GGA sentence; correct or remove it."
            ) from error
        if rows and clock + days < rows[-1][0] - 0.5 * _DAY_S:
            days += _DAY_S
        rows.append((clock + days, latitude, longitude, height))
    if not rows:
        raise InputError(f"{file} holds no GGA sentence with a fix; record GGA, and wait for a fix.")
    return np.array(rows)


def _checked_words(line: str, where: str) -> list[str]:
    body, star, told = line[1:].partition("*")
    sum_of = 0
    for letter in body:
        sum_of ^= ord(letter)
    if not star or told.strip().upper() != f"{sum_of & 0xFF:02X}":
        raise InputError(
            f"{where}: the checksum of the sentence is wrong; it was cut off or damaged, remove it."
        )
    words = body.split(",")
    if len(words) < 10:
        raise InputError(f"{where}: the GGA sentence has {len(words)} fields; at least 10 were expected.")
    return words


def _degrees(text: str, n_digits: int) -> float:
    """Degrees of ddmm.mmmm or dddmm.mmmm."""
    return float(text[:n_digits]) + float(text[n_digits:]) / 60.0
