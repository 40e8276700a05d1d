"""NMEA 0183: fixes, their quality, standard deviations and dates."""

from datetime import datetime
from pathlib import Path

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from vision_slam.io.receivers.rows import ReceiverFixes

_DAY_S = 86400.0
# Horizontal errors of RTK solutions by quality, fixed and float, and of other fixes beside them [m].
_QUALITY_SIGMA_M = {4: 0.02, 5: 0.3}
_USUAL_SIGMA_M = 1.1


def read_nmea(file: Path) -> ReceiverFixes:
    """Time since the first midnight, or Unix time where a sentence has the date, and place of the GGA sentences."""
    rows: list[tuple[float, float, float, float]] = []
    qualities: list[int] = []
    stated: dict[float, float] = {}
    n_without_fix, midnight_s = 0, None
    for number, line in enumerate(file.read_text(encoding="ascii", errors="replace").splitlines(), start=1):
        sentence = line[max(line.find("$"), 0) :]
        kind, where = sentence[3:6], f"{file}, line {number}"
        if kind not in {"GGA", "GST", "RMC"} or not sentence.startswith("$"):
            continue
        words = _checked_words(sentence, where)
        try:
            last_s = rows[-1][0] if rows else 0.0
            if kind == "RMC":
                midnight_s = _midnight_s(words, last_s) if midnight_s is None else midnight_s
            elif kind == "GST":
                stated |= _gst(words, last_s)
            elif words[6] in ("", "0"):
                n_without_fix += 1
            else:
                rows.append(_gga(words, last_s))
                qualities.append(int(words[6]))
        except (ValueError, IndexError) as error:
            raise InputError(f"{where}: {error} in a {kind} sentence; correct or remove it.") from error
    if not rows:
        raise InputError(
            f"{file} holds no GGA sentence with a fix ({n_without_fix} without one); record GGA, and wait for a fix."
        )
    table = np.array(rows)
    return ReceiverFixes(
        table[:, 0] + (midnight_s or 0.0),
        table[:, 1:],
        is_dated=midnight_s is not None,
        n_without_fix=n_without_fix,
        sigma_m=_sigma_m(table[:, 0], qualities, stated),
    )


def _gst(words: list[str], last_s: float) -> dict[float, float]:
    """Return the horizontal standard deviation [m] by the time of a GST sentence; nothing where it is empty."""
    if not words[6] or not words[7]:
        return {}
    sigma_m = float(np.hypot(float(words[6]), float(words[7])) / np.sqrt(2.0))
    return {_clock_s(words[1], last_s): sigma_m} if sigma_m > 0.0 else {}


def _sigma_m(time_s: FloatArray, qualities: list[int], stated: dict[float, float]) -> FloatArray | None:
    """Return standard deviations (N,) [m] by GST sentence or quality; None where neither says more than usual."""
    if not stated and not set(qualities) & set(_QUALITY_SIGMA_M):
        return None
    usual_m = float(np.median(list(stated.values()))) if stated else _USUAL_SIGMA_M
    by_quality = [_QUALITY_SIGMA_M.get(quality, usual_m) for quality in qualities]
    return np.array([stated.get(t, sigma) for t, sigma in zip(time_s.tolist(), by_quality, strict=True)])


def _gga(words: list[str], last_s: float) -> tuple[float, float, float, float]:
    """Time since the first midnight [s], longitude, latitude [deg] and height [m] of a fix after one at `last_s`."""
    latitude = _degrees(words[2], 2) * (1.0 if words[3] == "N" else -1.0)
    longitude = _degrees(words[4], 3) * (1.0 if words[5] == "E" else -1.0)
    return _clock_s(words[1], last_s), longitude, latitude, float(words[9])


def _clock_s(text: str, last_s: float) -> float:
    """Seconds since the first midnight of hhmmss.ss, which comes after `last_s`."""
    clock = float(text[:2]) * 3600.0 + float(text[2:4]) * 60.0 + float(text[4:])
    clock += _DAY_S * float(np.floor(last_s / _DAY_S))
    return clock + _DAY_S if clock < last_s - 0.5 * _DAY_S else clock


def _midnight_s(words: list[str], last_s: float) -> float | None:
    """Unix time of the log's first midnight by an RMC sentence; None when the receiver does not know the date yet."""
    if words[2] != "A" or len(words[9]) != 6:
        return None
    midnight = datetime.strptime(words[9] + "+0000", "%d%m%y%z").timestamp()
    return midnight - _DAY_S * float(np.floor(_clock_s(words[1], last_s) / _DAY_S))


def _checked_words(line: str, where: str) -> list[str]:
    body, star, checksum = line[1:].partition("*")
    checksum = checksum.split(",")[0]  # phones add their own time of arrival
    sum_of = 0
    for letter in body:
        sum_of ^= ord(letter)
    if not star:
        raise InputError(
            f"{where}: the sentence has no checksum; log NMEA with checksums, so that damage is seen."
        )
    if checksum.strip().upper() != f"{sum_of & 0xFF:02X}":
        raise InputError(
            f"{where}: the checksum of the sentence is wrong; it was cut off or damaged, remove it."
        )
    words = body.split(",")
    least = 9 if words[0][2:] == "GST" else 10
    if len(words) < least:
        raise InputError(f"{where}: the sentence has {len(words)} fields; at least {least} were expected.")
    return words


def _degrees(text: str, n_digits: int) -> float:
    """Degrees of ddmm.mmmm or dddmm.mmmm."""
    return float(text[:n_digits]) + float(text[n_digits:]) / 60.0
