"""GPS files: recognition of the format, GPX tracks, tables of fixes, positions of RTKLIB.

`read_gps` recognizes a file by its suffix or content and returns a `GpsLog`. `read_fix_table` reads tables of other
programs by the usual names of columns, with times as numbers or dates, or with columns that the user names.
`read_positions` reads the ``.pos`` files of RTKLIB and converts GPS time to UTC. `is_receiver_log` says whether a file is a
log of fixes and no table of points. Raw observations (RINEX) are refused.
"""

import csv
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from survey.core import ConfigError, FloatArray, InputError, existing_file, first_line, printable
from survey.core.lengths import log_converted
from survey.core.time_units import PER_SECOND, declared_unit, plain_unit
from survey.io.column_names import (
    OWN_NAMES,
    ColumnNames,
    axis_of,
    metres_factor,
    normalize,
    one_column,
    parse_columns,
    rename_header,
)
from survey.io.tables import read_table
from survey.io.text_tables import Axis, TextTable, read_text_table, refuse_clock_numbers, refuse_hemispheres
from survey.io.trajectory_files import read_gpx
from vision_slam.readers.receiver_logs import (
    SYNC,
    decimal_degrees,
    gps_week_s,
    is_grafnav,
    leap_s,
    read_gnss_logger,
    read_grafnav,
    read_nmea,
    read_ublox,
)
from vision_slam.readers.sequence import DATED_S, WGS84, GpsLog, ReceiverFixes, axis_sigma_m, usable

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
    """
    file = existing_file(path, "the fixes")
    suffix = file.suffix.lower()
    kind = suffix if suffix in _READERS and suffix != ".txt" else _kind_of(file)
    if columns and kind != ".csv":
        raise ConfigError(f"{file} is no table; leave --columns out.")
    if columns or (kind == ".csv" and not _has_own_columns(file)):
        return _usable(GpsLog(**read_fix_table(file, columns)._asdict()), file)
    return _usable(_READERS[kind](file), file)


RECEIVER_ENDINGS = (".gpx", ".nmea", ".pos", ".ubx")
"""Endings of logs of fixes; other endings, such as ``.txt``, are recognized by their content."""
_TEXT_ENDINGS = (".txt", ".log", ".asc", ".dat", "")


def is_receiver_log(path: str | Path) -> bool:
    """Return whether a file is a log of fixes: by its ending, or a text by the marks that no table of points has."""
    file = Path(path)
    suffix = file.suffix.lower()
    if suffix in RECEIVER_ENDINGS or suffix not in _TEXT_ENDINGS or not file.is_file():
        return suffix in RECEIVER_ENDINGS
    with file.open("rb") as stream:
        lines = stream.read(_SNIFFED_BYTES).decode("utf-8", errors="replace").splitlines()
    starts = ("Fix,", "# Fix,", "%  GPST", "%  UTC", "% GPST", "% UTC")
    return any(line.startswith(starts) or _NMEA_FIX.search(line) for line in lines) or is_grafnav(lines)


def _usable(log: GpsLog, file: Path) -> GpsLog:
    """Leave out fixes that are not finite, repeat the one before or lie at 0° N 0° E, with notes."""
    stays, notes = usable(log.time_s, log.place, log.sigma_m, str(file))
    log = replace(log.select(stays), notes=(*log.notes, *notes))
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
    if is_grafnav(head.decode("utf-8", errors="replace").splitlines()):
        return _GRAFNAV
    if any("$G" in line and "," in line for line in lines):
        return ".nmea"
    plain = next((line for line in lines if line and not line.startswith(("%", "#"))), "")
    if _RTKLIB_LINE.match(plain):
        return ".pos"
    has_header = any(mark in plain for mark in ",;\t") and any(map(str.isalpha, plain))
    return ".csv" if has_header else ".nmea"


def _from_gpx(file: Path) -> GpsLog:
    unix_s, place = read_gpx(file, WGS84)
    n_apart = len(_APART.findall(file.read_bytes()))
    notes = (f"{n_apart} points of {file} that stand outside of its tracks (wpt, rtept) are not read",)
    return GpsLog(unix_s, place, is_dated=True, notes=notes if n_apart else ())


def _from_positions(file: Path) -> GpsLog:
    time_s, place, sigma_m, sigma_z_m = read_positions(file)
    return GpsLog(time_s, place, is_dated=True, sigma_m=sigma_m, sigma_z_m=sigma_z_m)


def _log_of(read: Callable[[Path], ReceiverFixes]) -> Callable[[Path], GpsLog]:
    """Return a reader of logs from a reader of fixes."""
    return lambda file: GpsLog(**read(file)._asdict())


def is_receiver_file(path: str | Path) -> bool:
    """Return whether a file holds fixes of a receiver rather than poses, by its suffix and columns.

    Returns: False for ``.tum`` and for tables without the columns of fixes.
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
    unread = [name for name in header if name not in (*names, "sigma_m")]
    notes = (printable(f"{file}: columns that are not used: {', '.join(unread)}"),) if unread else ()
    if sigma_m is not None and not (sigma_m > 0.0).all():
        raise InputError(
            f"{file} holds a sigma_m that is not above 0; write the error of each fix in metres."
        )
    if names is _METRES:
        return GpsLog(rows[:, 0], rows[:, 1:], is_geodetic=False, sigma_m=sigma_m, notes=notes)
    return GpsLog(rows[:, 0], rows[:, [2, 1, 3]], sigma_m=sigma_m, notes=notes)


_APART = re.compile(rb"<(?:\w+:)?(?:wpt|rtept)[\s>]")
_SNIFFED_BYTES, _SYNC_WITHIN = 65536, 4096
_GRAFNAV = "GrafNav"
_NMEA_FIX = re.compile(r"\$G[A-Z]GGA,")
_RTKLIB_LINE = re.compile(r"(\d{4}[/-]\d{2}[/-]\d{2}[ ,]+\d{1,2}:\d{2}:|\d{4}[ ,]+\d{1,6}\.\d+[ ,])")
_READERS: dict[str, Callable[[Path], GpsLog]] = {
    ".gpx": _from_gpx,
    ".pos": _from_positions,
    ".ubx": _log_of(read_ublox),
    ".csv": _from_table,
    ".nmea": _log_of(read_nmea),
    ".txt": _log_of(read_gnss_logger),
    _GRAFNAV: _log_of(read_grafnav),
}


KEYS = {key: OWN_NAMES[key] for key in ("time", "x", "y", "z", "lon", "lat", "sigma_xy", "sigma_z")}
_RADII = ("acc",)  # accuracy, hAcc
_CLOCK = re.compile(r"\d{1,2}:\d{2}:")
_DAY_FIRST = re.compile(r"^(\d{2})\.(\d{2})\.(\d{4})\b")


def read_fix_table(file: Path, columns: Sequence[str] = ()) -> ReceiverFixes:
    """Read a table with columns of time, place and height by their usual names.

    Returns: in degrees or in metres. Times are numbers (seconds, or Unix milli-, micro- or nanoseconds) or
    dates as ISO 8601 or ``31.12.2026 23:59:59``, of UTC unless they state an offset; a date and a time of day
    may stand in two columns. A column of accuracy counts as the radius of 68 %, one of a horizontal standard
    deviation as that of the distance; a note says which columns were read.
    """
    table = read_text_table(file, "the table of fixes")
    given = parse_columns(columns, KEYS)
    table = table._replace(header=rename_header(table.header, given, table.where))
    names = _column_names(table)
    date = _date_column(table, names["time"])
    time_s, unit = _column_of_times(table, names["time"], given.get("time_s", names["time"]), date)
    is_geodetic = "longitude" in names
    first, second = ("longitude", "latitude") if is_geodetic else ("easting", "northing")
    kinds = (first, second, "height")
    place = np.column_stack([_column_in_metres(table, names[kind], axis_of(kind)) for kind in kinds])
    if is_geodetic and (np.abs(place[:, :2]) > (360.0, 90.0)).any():
        raise InputError(
            f"{table.where} holds places that are no degrees in {names[first]} and {names[second]}; "
            f"name columns of metres with --columns x={names[first]},y={names[second]}."
        )
    if is_geodetic:
        refuse_hemispheres(table, place[:, 0], place[:, 1])
    names |= {} if date is None else {"date": date}
    read = ColumnNames(
        {kind: given.get(name, name) for kind, name in names.items()}, _unused_columns(table, names)
    )
    return ReceiverFixes(
        time_s,
        place,
        _column_of_sigma_m(table, names, given),
        is_geodetic=is_geodetic,
        is_dated=bool(time_s[0] > DATED_S),
        notes=(read.sentence(str(file)).rstrip(".") + unit, *_gps_time_notes(read.columns["time"])),
        sigma_z_m=_positive_metres(table, names["sigma_z"]) if "sigma_z" in names else None,
    )


def _gps_time_notes(name: str) -> tuple[str, ...]:
    """Return a note where the name of the column of times means GPS time, which is not UTC."""
    if not normalize(name).startswith("gps"):
        return ()
    return (
        f"the times of the column {name} are taken for UTC; GPS time is 18 s ahead of it, convert it where the column holds that",
    )


def _column_names(table: TextTable) -> dict[str, str]:
    """Return the columns of time, place, height and error by what they hold; metres before degrees."""
    header, where = table.header, table.where
    found: dict[str, str] = {}
    for kind in (
        "time",
        "x",
        "y",
        "easting",
        "northing",
        "longitude",
        "latitude",
        "height",
        "sigma_xy",
        "sigma_z",
    ):
        name = one_column(kind, header, where)
        if name is not None:
            found[kind] = name
    for old, new in (("x", "easting"), ("y", "northing")):
        if old in found:
            found[new] = found.pop(old)
    metric, degrees = {"easting", "northing"}, {"longitude", "latitude"}
    is_metric = metric <= found.keys() or (metric & found.keys() and not degrees & found.keys())
    drop = degrees if is_metric else metric
    found = {kind: name for kind, name in found.items() if kind not in drop}
    place = metric if is_metric else degrees
    missing = [kind for kind in ("time", *sorted(place), "height") if kind not in found]
    if missing:
        keys = {"longitude": "lon", "latitude": "lat", "height": "z", "easting": "x", "northing": "y"}
        key = keys.get(missing[0], missing[0])
        raise InputError(
            f"{where} has no column of {' and '.join(missing)} (found {printable(', '.join(header))[:200]}); "
            f"name it with --columns {key}=NAME."
        )
    return found


def _unused_columns(table: TextTable, names: dict[str, str]) -> tuple[str, ...]:
    return tuple(name for name in table.header if name not in names.values())


def _column_in_metres(table: TextTable, name: str, axis: Axis | None = None) -> FloatArray:
    metres = metres_factor(name)
    log_converted(f"{table.where}, column {name},", [("numbers", metres)])
    return metres * table.numbers(name, axis)


def _column_of_sigma_m(table: TextTable, names: dict[str, str], given: dict[str, str]) -> FloatArray | None:
    """Return the standard deviation in each axis; None without a column."""
    if "sigma_xy" not in names:
        return None
    name = names["sigma_xy"]
    stated = _positive_metres(table, name)
    is_radius = any(part in normalize(given.get(name, name)) for part in _RADII)
    return axis_sigma_m(stated) if is_radius else stated / np.sqrt(2.0)


def _positive_metres(table: TextTable, name: str) -> FloatArray:
    """Return a column of errors in metres, or refuse one that is not above 0."""
    stated = _column_in_metres(table, name)
    if not (stated > 0.0).all():
        raise InputError(
            f"{table.where} holds an error that is not above 0 in the column {name}; correct it."
        )
    return stated


def _date_column(table: TextTable, name: str) -> str | None:
    """Return the column of days beside a column of times of day; None where times are complete."""
    return one_column("date", table.header, table.where) if _CLOCK.match(table.texts(name)[0]) else None


def _column_of_times(table: TextTable, name: str, given: str, date: str | None) -> tuple[FloatArray, str]:
    """Return seconds (N,) of a column of numbers or dates, and what they were where not seconds.

    `given`: its name in the file, which may state a unit.
    """
    if table.is_number(name, 0):
        numbers = table.numbers(name)
        refuse_clock_numbers(numbers, f"{table.where}, column {name}")
        unit = declared_unit(given) or plain_unit(numbers)
        return (numbers, "") if unit is None else (numbers / PER_SECOND[unit], f", times are {unit}")
    days = ("",) * len(table.lines) if date is None else table.texts(date)
    return _column_of_dates(table, name, days), ", times are dates"


def _column_of_dates(table: TextTable, name: str, days: Sequence[str]) -> FloatArray:
    """Return Unix times (N,) [s] of the cells of a column, each after its day where the day is apart."""
    times = np.empty(len(table.lines))
    cells = zip(table.lines, days, table.texts(name), strict=True)
    for k, (line, day, cell) in enumerate(cells):
        text = _DAY_FIRST.sub(r"\3-\2-\1", f"{day} {cell}".strip().replace("/", "-"))
        try:
            date = datetime.fromisoformat(text)
        except ValueError as error:
            raise InputError(
                f"{table.where}, line {line}: {printable(cell)[:40]!r} in the column {name} is no number and no date such as "
                "2024-06-12T10:15:02.5Z; correct it."
            ) from error
        times[k] = (date if date.tzinfo else date.replace(tzinfo=UTC)).timestamp()
    return times


# Least standard deviation of a solution of each quality [m]; RTKLIB states the noise alone.
_LEAST_SIGMA_M = {1: 0.01, 2: 0.05, 3: 0.5, 4: 0.5, 5: 1.0, 6: 0.05}
_LEAST_RTKLIB_WORDS = 10


def read_positions(file: Path) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Read the positions of a file in degrees.

    Times may be dates or GPS week and seconds; GPS time is converted to UTC. Angles may be degrees or degrees,
    minutes and seconds. Standard deviations
    are at least 1 cm for fixed, 5 cm for float and 1 m for single solutions.

    Returns `time_s` (N,): unix times [s]. `place` (N, 3): longitude, latitude [deg] and ellipsoidal height
    [m]. `sigma_m`, `sigma_z_m` (N,): standard deviation of each position, horizontal and of its height [m].
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
            rows.append(_rtklib_position(words, f"{file}, line {number}"))
    if not rows:
        raise InputError(f"{file} holds no positions; process the observations again.")
    table = np.array(rows)
    time_s = table[:, 0] if is_utc else table[:, 0] - leap_s(table[:, 0])
    return time_s, table[:, 1:4], table[:, 4], table[:, 5]


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
    if len(words) < _LEAST_RTKLIB_WORDS + 4:
        raise InputError(
            f"{where}: {len(words)} values; degrees, minutes and seconds of both angles were expected."
        )
    angles = [repr(decimal_degrees(words[k : k + 3], where)) for k in (2, 5)]
    return [*words[:2], *angles, *words[8:]]


def _rtklib_position(words: list[str], where: str) -> tuple[float, ...]:
    """Return time [s], longitude, latitude [deg], height and standard deviations across and of the height [m] of one line."""
    if len(words) < _LEAST_RTKLIB_WORDS:
        raise InputError(
            f"{where}: {len(words)} values; time, latitude, longitude, height, quality, satellites and three "
            "standard deviations were expected."
        )
    try:
        latitude, longitude, height, quality, _, north, east, upward = map(float, words[2:10])
        time_s = _rtklib_time_s(words[0], words[1])
    except ValueError as error:
        raise InputError(f"{where} is no position in degrees ({error}); correct or remove it.") from error
    if not (-90.0 <= latitude <= 90.0 and -180.0 <= longitude <= 360.0):
        raise InputError(f"{where}: {latitude}, {longitude} are no degrees; write latitude and longitude.")
    sigma_m = float(np.sqrt(0.5 * (north**2 + east**2)))
    least_m = _LEAST_SIGMA_M.get(int(quality), 1.0)
    return time_s, longitude, latitude, height, max(sigma_m, least_m), max(upward, least_m)


def _rtklib_time_s(first: str, second: str) -> float:
    """Return seconds since 1970 of a date and time of day, or of a GPS week and its seconds."""
    if "/" not in first and "-" not in first:
        return gps_week_s(float(first), float(second))
    day = datetime.strptime(first.replace("-", "/") + "+0000", "%Y/%m/%d%z").astimezone(UTC).timestamp()
    hours, minutes, seconds = second.split(":")
    return day + 3600.0 * float(hours) + 60.0 * float(minutes) + float(seconds)
