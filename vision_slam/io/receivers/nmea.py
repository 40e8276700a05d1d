"""NMEA 0183: fixes, their quality, standard deviations and dates."""

from collections.abc import Iterator
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
# Qualities of GGA sentences: dead reckoning, entered by hand, simulated.
_NOT_MEASURED = {6, 7, 8}
_MOST_DAMAGED = 0.1


def read_nmea(file: Path) -> ReceiverFixes:
    """Return the fixes of the GGA sentences; times count from the first midnight where no RMC sentence has the date.

    Damaged sentences are left out and counted, and so are places that no satellites gave: dead reckoning, places entered by
    hand and simulated ones.

    Raises
    ------
    InputError
        No fix, more than a tenth of the sentences damaged, or a sentence that holds no numbers where they belong.
    """
    found = _Sentences()
    damaged: list[str] = []
    for where, sentence in _sentences(file):
        words, fault = _words(sentence)
        if fault:
            damaged.append(f"{where}: {fault}")
        else:
            found.add(words, where)
    n_sentences = len(damaged) + found.n
    if damaged and len(damaged) > _MOST_DAMAGED * n_sentences:
        raise InputError(f"{damaged[0]} {len(damaged)} of {n_sentences} sentences of the log are damaged.")
    if not found.rows:
        raise InputError(
            f"{file} holds no GGA sentence with a fix of satellites ({found.n_without_fix} without a fix, "
            f"{found.n_not_measured} dead reckoned, entered by hand or simulated); record GGA, and wait for a fix."
        )
    return found.fixes(_damage_note(damaged, n_sentences))


class _Sentences:
    """What the sentences of a log state."""

    def __init__(self) -> None:
        self.rows: list[tuple[float, float, float, float]] = []
        self.qualities: list[int] = []
        self.stated: dict[float, float] = {}
        self.midnight_s: float | None = None
        self.n = self.n_without_fix = self.n_not_measured = 0

    def add(self, words: list[str], where: str) -> None:
        """Add a sentence; refuse one without numbers where they belong."""
        self.n += 1
        kind = words[0][2:]
        last_s = self.rows[-1][0] if self.rows else 0.0
        try:
            if kind == "RMC":
                self.midnight_s = _midnight_s(words, last_s) if self.midnight_s is None else self.midnight_s
            elif kind == "GST":
                self.stated |= _gst(words, last_s)
            else:
                self._add_fix(words, last_s)
        except (ValueError, IndexError) as error:
            raise InputError(f"{where}: {error} in a {kind} sentence; correct or remove it.") from error

    def _add_fix(self, words: list[str], last_s: float) -> None:
        quality = int(words[6] or 0)
        if quality == 0:
            self.n_without_fix += 1
        elif quality in _NOT_MEASURED:
            self.n_not_measured += 1
        else:
            self.rows.append(_gga(words, last_s))
            self.qualities.append(quality)

    def fixes(self, note: str) -> ReceiverFixes:
        """Return the fixes, with a note of damaged sentences and one of places that no satellites gave."""
        table = np.array(self.rows)
        left_out = (
            f"{self.n_not_measured} places that are dead reckoned, entered by hand or simulated are left out"
        )
        return ReceiverFixes(
            table[:, 0] + (self.midnight_s or 0.0),
            table[:, 1:],
            is_dated=self.midnight_s is not None,
            n_without_fix=self.n_without_fix,
            sigma_m=_sigma_m(table[:, 0], self.qualities, self.stated),
            notes=tuple(words for words in (note, left_out if self.n_not_measured else "") if words),
        )


def _sentences(file: Path) -> Iterator[tuple[str, str]]:
    """Yield the place and the text of each sentence that is read."""
    for number, line in enumerate(file.read_text(encoding="ascii", errors="replace").splitlines(), start=1):
        sentence = line[max(line.rfind("$"), 0) :]
        if sentence.startswith("$") and sentence[3:6] in {"GGA", "GST", "RMC"}:
            yield f"{file}, line {number}", sentence


def _damage_note(damaged: list[str], n_sentences: int) -> str:
    """Return a note of sentences that are left out because they are damaged."""
    if not damaged:
        return ""
    return f"{len(damaged)} of {n_sentences} sentences are damaged and left out; the first: {damaged[0].rstrip('.')}"


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
    latitude = _degrees(words[2], 2) * _sign(words[3], "NS")
    longitude = _degrees(words[4], 3) * _sign(words[5], "EW")
    return _clock_s(words[1], last_s), longitude, latitude, float(words[9])


def _sign(letter: str, hemispheres: str) -> float:
    """Return 1 for the first letter of two hemispheres, -1 for the second."""
    if letter.strip().upper() not in tuple(hemispheres):
        raise ValueError(f"the hemisphere {letter!r} is neither {hemispheres[0]} nor {hemispheres[1]}")
    return 1.0 if letter.strip().upper() == hemispheres[0] else -1.0


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


def _words(sentence: str) -> tuple[list[str], str]:
    """Return the fields of a sentence, and what is wrong with it; ``""`` where nothing is."""
    body, star, checksum = sentence[1:].partition("*")
    checksum = checksum.split(",")[0]  # phones add their own time of arrival
    sum_of = 0
    for letter in body:
        sum_of ^= ord(letter)
    words = body.split(",")
    least = 9 if words[0][2:] == "GST" else 10
    if not star:
        return words, "the sentence has no checksum; log NMEA with checksums, so that damage is seen."
    if checksum.strip().upper() != f"{sum_of & 0xFF:02X}":
        return words, "the checksum of the sentence is wrong; it was cut off or damaged, remove it."
    if len(words) < least:
        return words, f"the sentence has {len(words)} fields; at least {least} were expected."
    return words, ""


def _degrees(text: str, n_digits: int) -> float:
    """Degrees of ddmm.mmmm or dddmm.mmmm."""
    return float(text[:n_digits]) + float(text[n_digits:]) / 60.0
