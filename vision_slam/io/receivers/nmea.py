"""NMEA 0183: fixes, their quality, standard deviations and dates."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from vision_slam.io.receivers.nmea_clock import clock_s, midnight_s, sentence_times
from vision_slam.io.receivers.rows import ReceiverFixes

# Horizontal errors of RTK solutions by quality, fixed and float, and of other fixes beside them [m].
_QUALITY_SIGMA_M = {4: 0.02, 5: 0.3}
_USUAL_SIGMA_M = 1.1
# Qualities of GGA sentences: dead reckoning, entered by hand, simulated.
_NOT_MEASURED = {6, 7, 8}
_MOST_DAMAGED = 0.1
_ALL_SYSTEMS = "GN"
_KINDS = {"GGA", "GST", "RMC", "ZDA"}
_LEAST_WORDS = {"GGA": 10, "GST": 9, "RMC": 10, "ZDA": 5}


def read_nmea(file: Path) -> ReceiverFixes:
    """Return the fixes of the GGA sentences; times count from the first midnight where no RMC or ZDA sentence has the date.

    Damaged sentences are left out and counted, and so are fixes without a height and places that no satellites gave: dead
    reckoning, places entered by hand and simulated ones. Of fixes of one time by several systems of satellites, that of
    all systems (GN) is taken, else the first.

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
        self.sigma_of: dict[int, float] = {}
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
        sigma_m = _gst(words)
        if sigma_m is not None:
            self.sigma_of[self._add_time(words[1])] = sigma_m

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
        return ReceiverFixes(
            time_s,
            np.array([fix.place for fix in fixes]),
            is_dated=is_dated,
            n_without_fix=self.n_without_fix,
            sigma_m=_sigma_m(time_s, [fix.quality for fix in fixes], stated),
            notes=tuple(words for words in (note, *self._notes()) if words),
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


def _gst(words: list[str]) -> float | None:
    """Return the horizontal standard deviation [m] of a GST sentence; None where it is empty."""
    if not words[6] or not words[7]:
        return None
    sigma_m = float(np.hypot(float(words[6]), float(words[7])) / np.sqrt(2.0))
    return sigma_m if sigma_m > 0.0 else None


def _sigma_m(time_s: FloatArray, qualities: list[int], stated: dict[float, float]) -> FloatArray | None:
    """Return standard deviations (N,) [m] by GST sentence or quality; None where neither says more than usual."""
    if not stated and not set(qualities) & set(_QUALITY_SIGMA_M):
        return None
    usual_m = float(np.median(list(stated.values()))) if stated else _USUAL_SIGMA_M
    by_quality = [_QUALITY_SIGMA_M.get(quality, usual_m) for quality in qualities]
    return np.array([stated.get(t, sigma) for t, sigma in zip(time_s.tolist(), by_quality, strict=True)])


def _gga(words: list[str], quality: int) -> _Fix:
    """Return the fix of a GGA sentence."""
    latitude = _degrees(words[2], 2) * _sign(words[3], "NS")
    longitude = _degrees(words[4], 3) * _sign(words[5], "EW")
    return _Fix((longitude, latitude, float(words[9])), quality, words[0][:2])


def _sign(letter: str, hemispheres: str) -> float:
    """Return 1 for the first letter of two hemispheres, -1 for the second."""
    if letter.strip().upper() not in tuple(hemispheres):
        raise ValueError(f"the hemisphere {letter!r} is neither {hemispheres[0]} nor {hemispheres[1]}")
    return 1.0 if letter.strip().upper() == hemispheres[0] else -1.0


def _words(sentence: str) -> tuple[list[str], str]:
    """Return the fields of a sentence, and what is wrong with it; ``""`` where nothing is."""
    body, star, checksum = sentence[1:].partition("*")
    checksum = checksum.split(",")[0]  # phones add their own time of arrival
    sum_of = 0
    for letter in body:
        sum_of ^= ord(letter)
    words = body.split(",")
    least = _LEAST_WORDS.get(words[0][2:], 10)
    if not star:
        return words, "the sentence has no checksum; log NMEA with checksums, so that damage is seen."
    if checksum.strip().upper() != f"{sum_of & 0xFF:02X}":
        return words, "the checksum of the sentence is wrong; it was cut off or damaged, remove it."
    if len(words) < least:
        return words, f"the sentence has {len(words)} fields; at least {least} were expected."
    return words, ""


def _degrees(text: str, n_digits: int) -> float:
    """Return the degrees of ddmm.mmmm or dddmm.mmmm."""
    return float(text[:n_digits]) + float(text[n_digits:]) / 60.0
