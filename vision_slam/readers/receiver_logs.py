"""Logs of satellite receivers: NMEA 0183, u-blox UBX, Android GnssLogger, positions of GrafNav and Inertial Explorer.

`read_nmea` reads GGA sentences, standard deviations from GST, dates from RMC and ZDA; `sentence_times` converts times of day
to Unix times across midnight. `read_ublox` reads UBX-NAV-PVT messages, or the NMEA sentences of a log without them.
`read_gnss_logger` reads the fixes of one provider. `read_grafnav` reads text under one line of names and one of units, which
`is_grafnav` recognizes: angles in degrees, or degrees, minutes and seconds, and times as seconds of a GPS week or dates. All return `ReceiverFixes`. Raw observations are left out.
"""

import re
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from survey.core import UNSTATED, FloatArray, InputError, existing_file
from survey.core.crs import ELLIPSOIDAL
from vision_slam.readers.sequence import DATED_S, ReceiverFixes, axis_sigma_m

# Horizontal errors of RTK solutions by quality, fixed and float, and of other fixes beside them [m].
_QUALITY_SIGMA_M = {4: 0.02, 5: 0.3}
_USUAL_SIGMA_M = 1.1
_UPWARD = 1.7  # error of heights over that across
# Qualities of GGA sentences: dead reckoning, entered by hand, simulated.
_NOT_MEASURED = {6, 7, 8}
_MOST_DAMAGED = 0.1
_ALL_SYSTEMS = "GN"
_KINDS = {"GGA", "GST", "RMC", "ZDA"}
_LEAST_SENTENCE_WORDS = {"GGA": 10, "GST": 9, "RMC": 10, "ZDA": 5}


def read_nmea(file: Path) -> ReceiverFixes:
    """Return the fixes of the GGA sentences; times count from the first midnight where no RMC or ZDA sentence has the date.

    Damaged sentences are left out and counted, and so are fixes without a height and places that no satellites gave: dead
    reckoning, places entered by hand and simulated ones. Of fixes of one time by several systems of satellites, that of
    all systems (GN) is taken, else the first.
    """
    found = _Sentences()
    damaged: list[str] = []
    for where, sentence in _sentences(file):
        words, fault = _sentence_words(sentence)
        if fault:
            damaged.append(f"{where}: {fault}")
        else:
            found.add(words, where)
    n_sentences = len(damaged) + found.n
    if damaged and len(damaged) > _MOST_DAMAGED * n_sentences:
        raise InputError(f"{damaged[0]} {len(damaged)} of {n_sentences} sentences of the log are damaged.")
    if not found.fixes_of:
        raise InputError(
            f"{file} holds no GGA sentence with a fix of satellites ({found.n_without_fix} without a fix, "
            f"{found.n_not_measured} dead reckoned, entered by hand or simulated); record GGA, and wait for a fix."
        )
    return found.fixes(_damage_note(damaged, n_sentences))


class _Sentences:
    """What the sentences of a log state."""

    def __init__(self) -> None:
        self.clocks: list[float] = []
        self.midnights: list[float | None] = []
        self.fixes_of: dict[int, _Fix] = {}
        self.sigma_of: dict[int, tuple[float, float]] = {}
        self.n = self.n_without_fix = self.n_not_measured = self.n_other_systems = 0

    def add(self, words: list[str], where: str) -> None:
        """Add a sentence; refuse one without numbers where they belong."""
        self.n += 1
        kind = words[0][2:]
        try:
            if kind == "GGA":
                self._add_fix(words)
            elif kind == "GST":
                self._add_sigma(words)
            else:
                self._add_date(words)
        except (ValueError, IndexError) as error:
            raise InputError(f"{where}: {error} in a {kind} sentence; correct or remove it.") from error

    def _add_time(self, text: str, midnight: float | None = None) -> int:
        """Add the time of a sentence, and return its number."""
        self.clocks.append(clock_s(text))
        self.midnights.append(midnight)
        return len(self.clocks) - 1

    def _add_date(self, words: list[str]) -> None:
        midnight = midnight_s(words)
        if midnight is not None:
            self._add_time(words[1], midnight)

    def _add_sigma(self, words: list[str]) -> None:
        sigmas_m = _gst(words)
        if sigmas_m is not None:
            self.sigma_of[self._add_time(words[1])] = sigmas_m

    def _add_fix(self, words: list[str]) -> None:
        quality = int(words[6] or 0)
        if quality == 0 or not words[9].strip():
            self.n_without_fix += 1
        elif quality in _NOT_MEASURED:
            self.n_not_measured += 1
        else:
            self._take(_gga(words, quality), self._add_time(words[1]))

    def _take(self, fix: "_Fix", number: int) -> None:
        """Take a fix, unless another system of satellites gave the one before at the same time."""
        last = next(reversed(self.fixes_of), None)
        is_second = last is not None and self.clocks[last] == self.clocks[number]
        if last is None or not is_second or self.fixes_of[last].system == fix.system:
            self.fixes_of[number] = fix
            return
        self.n_other_systems += 1
        if fix.system == _ALL_SYSTEMS:
            del self.fixes_of[last]
            self.fixes_of[number] = fix

    def fixes(self, note: str) -> ReceiverFixes:
        """Return the fixes, with notes of damaged sentences and of fixes that are left out."""
        times, is_dated = sentence_times(self.clocks, self.midnights)
        fixes = list(self.fixes_of.values())
        time_s = times[list(self.fixes_of)]
        stated = dict(zip(times[list(self.sigma_of)].tolist(), self.sigma_of.values(), strict=True))
        qualities = [fix.quality for fix in fixes]
        across = {at: sigma_m for at, (sigma_m, _) in stated.items()}
        upward = {at: sigma_m for at, (_, sigma_m) in stated.items() if sigma_m > 0.0}
        return ReceiverFixes(
            time_s,
            np.array([fix.place for fix in fixes]),
            is_dated=is_dated,
            n_without_fix=self.n_without_fix,
            sigma_m=_sigma_by_quality_m(time_s, qualities, across),
            notes=tuple(words for words in (note, *self._notes()) if words),
            sigma_z_m=_sigma_by_quality_m(time_s, qualities, upward, upward=True) if upward else None,
        )

    def _notes(self) -> Iterator[str]:
        """Yield a note of each kind of fixes that are left out."""
        if self.n_not_measured:
            yield f"{self.n_not_measured} places that are dead reckoned, entered by hand or simulated are left out"
        if self.n_other_systems:
            yield (
                f"{self.n_other_systems} fixes by another system of satellites at the time of one that is taken are left out"
            )


class _Fix(NamedTuple):
    """Longitude, latitude [deg] and height [m] of a GGA sentence, its quality and its system of satellites."""

    place: tuple[float, float, float]
    quality: int
    system: str


def _sentences(file: Path) -> Iterator[tuple[str, str]]:
    """Yield the place and the text of each sentence that is read."""
    for number, line in enumerate(file.read_text(encoding="ascii", errors="replace").splitlines(), start=1):
        sentence = line[max(line.rfind("$"), 0) :]
        if sentence.startswith("$") and sentence[3:6] in _KINDS:
            yield f"{file}, line {number}", sentence


def _damage_note(damaged: list[str], n_sentences: int) -> str:
    """Return a note of sentences that are left out because they are damaged."""
    if not damaged:
        return ""
    return f"{len(damaged)} of {n_sentences} sentences are damaged and left out; the first: {damaged[0].rstrip('.')}"


def _gst(words: list[str]) -> tuple[float, float] | None:
    """Return standard deviations [m], horizontal and of the height (0 where not stated), of a GST sentence; None of an empty one."""
    if not words[6] or not words[7]:
        return None
    sigma_m = float(np.hypot(float(words[6]), float(words[7])) / np.sqrt(2.0))
    upward_m = float(words[8]) if words[8].strip() else 0.0
    return (sigma_m, upward_m) if sigma_m > 0.0 else None


def _sigma_by_quality_m(
    time_s: FloatArray, qualities: list[int], stated: dict[float, float], *, upward: bool = False
) -> FloatArray | None:
    """Return standard deviations (N,) [m] by GST sentence or quality; None where neither says more than usual."""
    if not stated and not set(qualities) & set(_QUALITY_SIGMA_M):
        return None
    usual_m = float(np.median(list(stated.values()))) if stated else _USUAL_SIGMA_M
    share = _UPWARD if upward else 1.0
    by_quality = [share * _QUALITY_SIGMA_M.get(quality, usual_m / share) for quality in qualities]
    return np.array([stated.get(t, sigma) for t, sigma in zip(time_s.tolist(), by_quality, strict=True)])


def _gga(words: list[str], quality: int) -> _Fix:
    """Return the fix of a GGA sentence."""
    latitude = _nmea_degrees(words[2], 2) * _hemisphere_sign(words[3], "NS")
    longitude = _nmea_degrees(words[4], 3) * _hemisphere_sign(words[5], "EW")
    return _Fix((longitude, latitude, float(words[9])), quality, words[0][:2])


def _hemisphere_sign(letter: str, hemispheres: str) -> float:
    """Return 1 for the first letter of two hemispheres, -1 for the second."""
    if letter.strip().upper() not in tuple(hemispheres):
        raise ValueError(f"the hemisphere {letter!r} is neither {hemispheres[0]} nor {hemispheres[1]}")
    return 1.0 if letter.strip().upper() == hemispheres[0] else -1.0


def _sentence_words(sentence: str) -> tuple[list[str], str]:
    """Return the fields of a sentence, and what is wrong with it; ``""`` where nothing is."""
    body, star, checksum = sentence[1:].partition("*")
    checksum = checksum.split(",")[0]  # phones add their own time of arrival
    sum_of = 0
    for letter in body:
        sum_of ^= ord(letter)
    words = body.split(",")
    least = _LEAST_SENTENCE_WORDS.get(words[0][2:], 10)
    if not star:
        return words, "the sentence has no checksum; log NMEA with checksums, so that damage is seen."
    if checksum.strip().upper() != f"{sum_of & 0xFF:02X}":
        return words, "the checksum of the sentence is wrong; it was cut off or damaged, remove it."
    if len(words) < least:
        return words, f"the sentence has {len(words)} fields; at least {least} were expected."
    return words, ""


def _nmea_degrees(text: str, n_digits: int) -> float:
    """Return the degrees of ddmm.mmmm or dddmm.mmmm."""
    return float(text[:n_digits]) + float(text[n_digits:]) / 60.0


_DAY_S = 86400.0
_STATUS_VALID, _DATE_DIGITS = "A", 6


def clock_s(text: str) -> float:
    """Return seconds since midnight of hhmmss.ss.

    >>> clock_s("010002.50")
    3602.5
    """
    return float(text[:2]) * 3600.0 + float(text[2:4]) * 60.0 + float(text[4:])


def midnight_s(words: list[str]) -> float | None:
    """Return the Unix time of the midnight before an RMC or ZDA sentence; None where it states no date.

    >>> midnight_s("GPZDA,101502.00,02,01,1970,00,00".split(","))
    86400.0
    """
    if words[0][2:] == "ZDA":
        if not all(words[1:5]):
            return None
        return datetime(int(words[4]), int(words[3]), int(words[2]), tzinfo=UTC).timestamp()
    if words[2] != _STATUS_VALID or len(words[9]) != _DATE_DIGITS:
        return None
    return datetime.strptime(words[9] + "+0000", "%d%m%y%z").timestamp()


def sentence_times(clocks: Sequence[float], midnights: Sequence[float | None]) -> tuple[FloatArray, bool]:
    """Return times (N,) [s] of sentences in their order, and whether they are Unix times.

    Without any date they count from the first midnight. A date holds for the sentences that follow it, and for those
    before it back to the longest pause since the date before, as a receiver that was switched off makes one.

    `midnights`: unix time of the midnight before each sentence [s]; None for one without a date.

    >>> sentence_times([86399.0, 1.0], [None, None])[0].tolist()
    [86399.0, 86401.0]
    >>> sentence_times([10.0, 10.0, 20.0, 20.0], [0.0, None, None, 172800.0])[0].tolist()
    [10.0, 10.0, 172820.0, 172820.0]
    """
    steps = np.diff(np.asarray(clocks, dtype=np.float64))
    n_days = np.concatenate([[0.0], np.cumsum(steps < -0.5 * _DAY_S)])
    times: FloatArray = np.asarray(clocks, dtype=np.float64) + _DAY_S * n_days
    dated = [(k, midnight) for k, midnight in enumerate(midnights) if midnight is not None]
    if not dated:
        return times, False
    shifts = np.full(len(times), dated[0][1] - _DAY_S * n_days[dated[0][0]])
    last = dated[0][0]
    for k, midnight in dated[1:]:
        shift = midnight - _DAY_S * n_days[k]
        if shift != shifts[k]:
            first = last + 1 + int(np.argmax(steps[last:k] % _DAY_S))
            shifts[first:] = shift
        last = k
    return times + shifts, True


SYNC = b"\xb5\x62"
_GGA = re.compile(rb"\$G[A-Z]GGA,")
_UBX_FIX_TYPES = (2, 3, 4)  # 2D, 3D, with dead reckoning


def read_ublox(file: Path) -> ReceiverFixes:
    """Read the positions of a binary log; other messages in it (RTCM, raw data) are passed over.

    The horizontal accuracy estimate of the receiver, a standard deviation of the distance, is
    divided by √2 for each axis. Heights are ellipsoidal. Messages whose checksum is wrong, as a
    log that begins or ends in the middle of one has, are left out and counted, and so are positions that the
    receiver itself does not call valid (``gnssFixOK``). A log without NAV-PVT gives the fixes of its NMEA sentences,
    with a note.
    """
    from pyubx2 import ERR_LOG, UBX_PROTOCOL, UBXReader

    damaged: list[Exception] = []
    rows, n_without_fix = [], 0
    with file.open("rb") as stream:
        reader = UBXReader(stream, protfilter=UBX_PROTOCOL, quitonerror=ERR_LOG, errorhandler=damaged.append)
        for _, message in reader:
            if getattr(message, "identity", "") != "NAV-PVT":
                continue
            is_dated = message.validDate and message.validTime
            if message.fixType not in _UBX_FIX_TYPES or not (message.gnssFixOk and is_dated):
                n_without_fix += 1
                continue
            rows.append(_ubx_position(message))
    if not rows and n_without_fix == 0 and _GGA.search(file.read_bytes()):
        fixes = read_nmea(file)
        return fixes._replace(
            notes=("no NAV-PVT message: the fixes are those of NMEA sentences", *fixes.notes)
        )
    if not rows:
        raise InputError(
            f"{file} holds no NAV-PVT message with a position ({n_without_fix} without one, {len(damaged)} damaged); "
            "switch UBX-NAV-PVT on in the receiver, and wait for a fix."
        )
    table = np.array(rows)
    notes = (f"{len(damaged)} damaged messages of the receiver are left out",) if damaged else ()
    return ReceiverFixes(
        table[:, 0],
        table[:, 1:4],
        table[:, 4],
        n_without_fix=n_without_fix,
        vertical_datum=ELLIPSOIDAL,
        notes=notes,
        sigma_z_m=table[:, 5] if (table[:, 5] > 0.0).all() else None,
    )


def _ubx_position(message: Any) -> tuple[float, ...]:
    """Return Unix time [s], longitude, latitude [deg], ellipsoidal height, standard deviations across and of the height [m]."""
    day = datetime(message.year, message.month, message.day, tzinfo=UTC).timestamp()
    clock = 3600.0 * message.hour + 60.0 * message.min + message.second + 1e-9 * message.nano
    sigma_m = 1e-3 * message.hAcc / float(np.sqrt(2.0))
    return day + clock, message.lon, message.lat, 1e-3 * message.height, sigma_m, 1e-3 * message.vAcc


# Names of the fields by version of the app; the order of the last resort is that of version 2.
_LOGGER_FIELDS = {
    "latitude": ("latitudedegrees", "latitude"),
    "longitude": ("longitudedegrees", "longitude"),
    "height": ("altitudemeters", "altitude"),
    "accuracy": ("accuracymeters", "accuracy"),
    "time": ("unixtimemillis", "(utc)timeinms", "timeinms"),
}
_USUAL_LOGGER_HEADER = "Fix,Provider,Latitude,Longitude,Altitude,Speed,Accuracy,(UTC)TimeInMs"
# The satellites' own positions first, then those that the phone has fused, then those by radio cells.
_PROVIDERS = ("GPS", "FLP", "FUSED", "NLP", "NETWORK", "GT")


def read_gnss_logger(file: Path) -> ReceiverFixes:
    """Read the fixes of a log: those of one provider, GPS where it has at least two.

    Android's accuracy is the radius of 68 %; it becomes a standard deviation in each axis. Fixes without an
    altitude, which phones log before satellites are found, are left out and counted.
    """
    lines = file.read_text(encoding="utf-8", errors="replace").splitlines()
    header = next(
        (line.lstrip("# ") for line in lines if line.lstrip("# ").startswith("Fix,Prov")),
        _USUAL_LOGGER_HEADER,
    )
    columns = _logger_columns(header)
    by_provider: dict[str, list[tuple[float, ...]]] = {}
    n_without_height = 0
    for number, line in enumerate(lines, start=1):
        if line.startswith("Fix,"):
            words = line.split(",")
            fix = _logger_fix(words, columns, f"{file}, line {number}")
            if np.isnan(fix[3]):
                n_without_height += 1
            else:
                by_provider.setdefault(words[1].upper(), []).append(fix)
    chosen = next((p for p in _PROVIDERS if len(by_provider.get(p, [])) >= 2), None)
    if chosen is None:
        raise InputError(
            f"{file} holds {sum(map(len, by_provider.values()))} fixes and no two of one provider; "
            "log for longer, with location switched on."
        )
    table = np.array(by_provider[chosen])
    _, first = np.unique(table[:, 0], return_index=True)
    table = table[first]
    others = ", ".join(f"{len(rows)} of {name}" for name, rows in by_provider.items() if name != chosen)
    note = f"fixes of the provider {chosen}" + (f" ({others} are left out)" if others else "")
    has_sigma = bool((table[:, 4] > 0.0).all())
    return ReceiverFixes(
        1e-3 * table[:, 0],
        table[:, 1:4],
        axis_sigma_m(table[:, 4]) if has_sigma else None,
        n_without_fix=n_without_height,
        vertical_datum=ELLIPSOIDAL,
        notes=(note,),
    )


def _logger_columns(header: str) -> dict[str, int]:
    names = [name.strip().lower() for name in header.split(",")]
    return {
        kind: next((names.index(name) for name in spellings if name in names), -1)
        for kind, spellings in _LOGGER_FIELDS.items()
    }


def _logger_fix(words: list[str], columns: dict[str, int], where: str) -> tuple[float, ...]:
    """Return time [ms], longitude, latitude [deg], height (NaN without) and accuracy (0 without) [m] of one line."""
    try:
        values = {kind: words[at].strip() for kind, at in columns.items() if at >= 0}
        height = values["height"] or "nan"
        fix = (*(float(values[kind]) for kind in ("time", "longitude", "latitude")), float(height))
        accuracy = float(values.get("accuracy") or 0.0)
    except (ValueError, IndexError, KeyError) as error:
        raise InputError(
            f"{where} is no fix with time, longitude, latitude and altitude ({error}); correct or remove it."
        ) from error
    if not (abs(fix[1]) <= 180.0 and abs(fix[2]) <= 90.0 and np.isfinite(fix[:3]).all()):
        raise InputError(f"{where}: {fix[2]:g}, {fix[1]:g} are no degrees; correct or remove the line.")
    return (*fix, accuracy)


_HEADER_LINES = 200
_UNITS = re.compile(r"\s*(\([^()]*\)\s*){3,}$")
_GPS_EPOCH_S, _WEEK_S = 315964800.0, 604800.0  # 6 January 1980
# Unix times from which GPS time is ahead of UTC by so many seconds.
_LEAPS = ((1483228800.0, 18.0), (1435708800.0, 17.0), (1341100800.0, 16.0), (1230768000.0, 15.0))
_LEAST_SIGMA_M = 0.01  # the programs state the noise alone
_NAMES = {
    "week": ("week", "gpsweek"),
    "time": ("gpstime", "utctime", "time"),
    "date": ("utcdate", "gpsdate", "date"),
    "latitude": ("latitude",),
    "longitude": ("longitude",),
    "easting": ("easting", "east"),
    "northing": ("northing", "north"),
    "height": ("h-ell", "h-msl", "h-ortho", "height"),
    "sigma_east": ("sdeast", "e-sd", "stdeast"),
    "sigma_north": ("sdnorth", "n-sd", "stdnorth"),
    "sigma_height": ("sdheight", "h-sd", "sdup", "stdheight"),
}
_DATES = {"(mdy)": "%m/%d/%Y", "(dmy)": "%d/%m/%Y", "(ymd)": "%Y/%m/%d"}


def leap_s(time_s: FloatArray) -> FloatArray:
    """Return by how much GPS time is ahead of UTC (N,) [s]."""
    ahead = np.full(len(time_s), 14.0)
    for since_s, leap in reversed(_LEAPS):
        ahead[time_s >= since_s] = leap
    return ahead


def gps_week_s(week: float, second: float) -> float:
    """Return GPS time in seconds since 1970 of a GPS week and its seconds."""
    return _GPS_EPOCH_S + _WEEK_S * week + second


def decimal_degrees(parts: list[str], where: str) -> float:
    """Return an angle of degrees, minutes and seconds in degrees; the sign stands before the degrees, −0 too."""
    try:
        numbers = [float(part) for part in parts]
    except ValueError as error:
        raise InputError(f"{where} is no position in degrees ({error}); correct or remove it.") from error
    size = abs(numbers[0]) + sum(n / 60.0**k for k, n in enumerate(numbers[1:], start=1))
    return -size if parts[0].startswith("-") else size


class _GrafNavColumns(NamedTuple):
    """Name, unit and first word of each value that is read, the words of a row, and the lines before the rows."""

    name: dict[str, str]
    unit: dict[str, str]
    words: dict[str, slice]
    n_words: int
    head: list[str]


def is_grafnav(lines: list[str]) -> bool:
    """Return whether a line of names with a place stands above one of units in brackets."""
    return _grafnav_header(lines) is not None


def _grafnav_header(lines: list[str]) -> int | None:
    for k, line in enumerate(lines[1:_HEADER_LINES], start=1):
        words = lines[k - 1].lower().split()
        if _UNITS.match(line) and {"latitude", "easting"} & set(words):
            return k - 1
    return None


def read_grafnav(path: Path) -> ReceiverFixes:
    """Read positions and their standard deviations; what the datum of the file is taken for is noted."""
    file = existing_file(path, "the fixes")
    lines = file.read_text(encoding="utf-8", errors="replace").splitlines()
    first = _grafnav_header(lines)
    if first is None:
        raise InputError(f"{file} has no line of column names above one of units; export it with its header.")
    columns = _grafnav_columns(lines, first, file)
    rows = []
    for number, line in enumerate(lines[first + 2 :], start=first + 3):
        if words := line.split():
            rows.append(_grafnav_row(words, columns, f"{file}, line {number}"))
    if not rows:
        raise InputError(f"{file} holds no positions under its header; export it again.")
    table = np.array(rows)
    time_s, is_dated = table[:, 0], bool(table[0, 0] > DATED_S)
    if is_dated and not columns.name["time"].startswith("utc"):
        time_s = time_s - leap_s(time_s)
    across, upward = np.sqrt(0.5 * (table[:, 4] ** 2 + table[:, 5] ** 2)), table[:, 6]
    return ReceiverFixes(
        time_s,
        table[:, 1:4],
        np.maximum(across, _LEAST_SIGMA_M) if np.isfinite(across).all() else None,
        is_geodetic="longitude" in columns.name,
        is_dated=is_dated,
        vertical_datum=ELLIPSOIDAL if columns.name["height"] == "h-ell" else UNSTATED,
        notes=_datum_notes(columns.head),
        sigma_z_m=np.maximum(upward, _LEAST_SIGMA_M) if np.isfinite(upward).all() else None,
    )


def _grafnav_columns(lines: list[str], first: int, file: Path) -> _GrafNavColumns:
    """Return where the values of a row stand; a unit belongs to the name that ends nearest to its end."""
    names = list(re.finditer(r"\S+", lines[first].lower()))
    ends = np.array([name.end() for name in names])
    units = [""] * len(names)
    for unit in re.finditer(r"\([^()]*\)", lines[first + 1].lower()):
        units[int(np.argmin(np.abs(ends - unit.end())))] = unit.group()
    sizes = [
        len(re.findall("[dms]", unit)) if re.fullmatch(r"\((\+/-)?d ?m( ?s)?\)", unit) else 1
        for unit in units
    ]
    begins = np.concatenate([[0], np.cumsum(sizes)]).tolist()
    found = {
        kind: next((k for k, name in enumerate(names) if name.group() in spellings), None)
        for kind, spellings in _NAMES.items()
    }
    at = {kind: k for kind, k in found.items() if k is not None}
    place = ("latitude", "longitude") if "latitude" in at else ("northing", "easting")
    missing = [kind for kind in ("time", *place, "height") if kind not in at]
    if missing:
        raise InputError(f"{file} has no column of {' and '.join(missing)}; export it with that column.")
    for kind in ("height", "sigma_height", "sigma_east", "sigma_north", "easting", "northing"):
        if kind in at and units[at[kind]] not in ("(m)", ""):
            raise InputError(
                f"{file} has {names[at[kind]].group()} in {units[at[kind]]}; metres (m) were expected, export it in metres."
            )
    return _GrafNavColumns(
        {
            kind: names[k].group()
            for kind, k in at.items()
            if kind not in ("easting", "northing") or kind in place
        },
        {kind: units[k] for kind, k in at.items()},
        {kind: slice(begins[k], begins[k + 1]) for kind, k in at.items()},
        begins[-1],
        lines[:first],
    )


def _grafnav_row(words: list[str], columns: _GrafNavColumns, where: str) -> tuple[float, ...]:
    """Return time [s], place, height and standard deviations to the east, to the north and upwards of one line."""
    if len(words) != columns.n_words:
        raise InputError(
            f"{where}: {len(words)} values, and the header names {columns.n_words}; correct or remove the line."
        )
    axes = ("longitude", "latitude") if "longitude" in columns.name else ("easting", "northing")
    x, y = (decimal_degrees(words[columns.words[axis]], where) for axis in axes)
    others = ("height", "sigma_east", "sigma_north", "sigma_height")
    try:
        numbers = [
            float(words[columns.words[kind].start]) if kind in columns.name else float("nan")
            for kind in others
        ]
        time_s = _grafnav_time_s(words, columns)
    except ValueError as error:
        raise InputError(f"{where} is no position ({error}); correct or remove it.") from error
    if axes[0] == "longitude" and not (abs(x) <= 360.0 and abs(y) <= 90.0):
        raise InputError(f"{where}: {y}, {x} are no degrees; correct or remove the line.")
    return (time_s, x, y, *numbers)


def _grafnav_time_s(words: list[str], columns: _GrafNavColumns) -> float:
    """Return seconds since 1970 where the row has a date or a week, else of the week or day."""
    text = words[columns.words["time"].start]
    hours = [float(part) for part in text.split(":")]
    second = hours[0] if len(hours) == 1 else 3600.0 * hours[0] + 60.0 * hours[1] + hours[2]
    if "date" in columns.name:
        form = _DATES.get(columns.unit["date"], "%m/%d/%Y")
        day = datetime.strptime(words[columns.words["date"].start].replace("-", "/"), form)
        return day.replace(tzinfo=UTC).timestamp() + second
    if "week" in columns.name and len(hours) == 1:
        return gps_week_s(float(words[columns.words["week"].start]), second)
    return second


def _datum_notes(head: list[str]) -> tuple[str, ...]:
    """Return a note of a datum other than WGS 84 and its equals."""
    stated = next((line.partition(":")[2] for line in head if line.lower().startswith("datum")), "")
    datum = stated.split(",")[0].strip()
    if not datum or datum.upper().startswith(("WGS84", "WGS 84", "ITRF", "IGS")):
        return ()
    return (f"places in the datum {datum} are taken for WGS 84; both can lie metres apart",)
