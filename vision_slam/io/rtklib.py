"""Positions of RTKLIB (``.pos``): times, places and their standard deviations."""

import re
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import InputError

# Least standard deviation of a solution of each quality [m]; RTKLIB states the noise alone.
_LEAST_SIGMA_M = {1: 0.01, 2: 0.05, 3: 0.5, 4: 0.5, 5: 1.0, 6: 0.05}
_GPS_EPOCH_S = 315964800.0  # 6 January 1980
_WEEK_S = 604800.0
# Unix times from which GPS time is ahead of UTC by so many seconds.
_LEAPS = ((1483228800.0, 18.0), (1435708800.0, 17.0), (1341100800.0, 16.0), (1230768000.0, 15.0))
_LEAST_WORDS = 10


def read_positions(file: Path) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Read the positions of a file in degrees.

    Times may be dates or GPS week and seconds; GPS time is converted to UTC. Angles may be degrees or degrees,
    minutes and seconds. Standard deviations
    are at least 1 cm for fixed, 5 cm for float and 1 m for single solutions.

    Parameters
    ----------
    file : Path
        Output of RTKLIB.

    Returns
    -------
    time_s : (N,) ndarray
        Unix times [s].
    place : (N, 3) ndarray
        Longitude, latitude [deg] and ellipsoidal height [m].
    sigma_m : (N,) ndarray
        Horizontal standard deviation of each position [m].

    Raises
    ------
    InputError
        A line is no position, or the file holds none.
    """
    rows, is_utc, has_minutes = [], False, False
    lines = file.read_text(encoding="utf-8", errors="replace").splitlines()
    for number, line in enumerate(lines, start=1):
        if line.startswith("%"):
            _refuse_other_positions(line, file)
            is_utc = is_utc or ("UTC" in line and "latitude" in line)
            has_minutes = has_minutes or "latitude(d'" in line
        elif line.strip():
            words = re.split(r"[\s,;]+", line.strip())
            words = _with_degrees(words, f"{file}, line {number}") if has_minutes else words
            rows.append(_position(words, f"{file}, line {number}"))
    if not rows:
        raise InputError(f"{file} holds no positions; process the observations again.")
    table = np.array(rows)
    time_s = table[:, 0] if is_utc else table[:, 0] - _leap_s(table[:, 0])
    return time_s, table[:, 1:4], table[:, 4]


def _refuse_other_positions(header: str, file: Path) -> None:
    """Refuse positions about the Earth's centre or a base, and times of Japan, as the header names them."""
    kinds = {
        "x-ecef": "positions from the Earth's centre",
        "e-baseline": "positions from a base",
        " JST": "times of Japan",
    }
    found = next((words for mark, words in kinds.items() if mark in header), None)
    if found is not None:
        raise InputError(
            f"{file} holds {found}; choose latitude, longitude, height and GPST or UTC in RTKLIB's output options."
        )


def _with_degrees(words: list[str], where: str) -> list[str]:
    """Return the words of a line with both angles in degrees instead of degrees, minutes and seconds."""
    if len(words) < _LEAST_WORDS + 4:
        raise InputError(
            f"{where}: {len(words)} values; degrees, minutes and seconds of both angles were expected."
        )
    angles = [_degrees(words[k : k + 3], where) for k in (2, 5)]
    return [*words[:2], *angles, *words[8:]]


def _degrees(parts: list[str], where: str) -> str:
    """Return an angle of degrees, minutes and seconds in degrees; the sign stands before the degrees, −0 too."""
    try:
        degrees, minutes, seconds = map(float, parts)
    except ValueError as error:
        raise InputError(f"{where} is no position in degrees ({error}); correct or remove it.") from error
    size = abs(degrees) + minutes / 60.0 + seconds / 3600.0
    return repr(-size if parts[0].startswith("-") else size)


def _position(words: list[str], where: str) -> tuple[float, float, float, float, float]:
    """Return time [s], longitude, latitude [deg], height and standard deviation [m] of one line."""
    if len(words) < _LEAST_WORDS:
        raise InputError(
            f"{where}: {len(words)} values; time, latitude, longitude, height, quality, satellites and three "
            "standard deviations were expected."
        )
    try:
        latitude, longitude, height, quality, _, north, east = map(float, words[2:9])
        time_s = _time_s(words[0], words[1])
    except ValueError as error:
        raise InputError(f"{where} is no position in degrees ({error}); correct or remove it.") from error
    if not (-90.0 <= latitude <= 90.0 and -180.0 <= longitude <= 360.0):
        raise InputError(f"{where}: {latitude}, {longitude} are no degrees; write latitude and longitude.")
    sigma_m = float(np.sqrt(0.5 * (north**2 + east**2)))
    return time_s, longitude, latitude, height, max(sigma_m, _LEAST_SIGMA_M.get(int(quality), 1.0))


def _time_s(first: str, second: str) -> float:
    """Return seconds since 1970 of a date and time of day, or of a GPS week and its seconds."""
    if "/" not in first and "-" not in first:
        return _GPS_EPOCH_S + _WEEK_S * float(first) + float(second)
    day = datetime.strptime(first.replace("-", "/") + "+0000", "%Y/%m/%d%z").astimezone(UTC).timestamp()
    hours, minutes, seconds = second.split(":")
    return day + 3600.0 * float(hours) + 60.0 * float(minutes) + float(seconds)


def _leap_s(time_s: FloatArray) -> FloatArray:
    """Return by how much GPS time is ahead of UTC (N,) [s]."""
    ahead = np.full(len(time_s), 14.0)
    for since_s, leap_s in reversed(_LEAPS):
        ahead[time_s >= since_s] = leap_s
    return ahead
