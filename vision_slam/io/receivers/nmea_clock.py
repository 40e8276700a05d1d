"""Times of NMEA sentences from their times of day and the dates that some of them state."""

from collections.abc import Sequence
from datetime import UTC, datetime

import numpy as np

from survey.core.arrays import FloatArray

_DAY_S = 86400.0
_STATUS_VALID, _DATE_DIGITS = "A", 6


def clock_s(text: str) -> float:
    """Return seconds since midnight of hhmmss.ss.

    Examples
    --------
    >>> clock_s("010002.50")
    3602.5
    """
    return float(text[:2]) * 3600.0 + float(text[2:4]) * 60.0 + float(text[4:])


def midnight_s(words: list[str]) -> float | None:
    """Return the Unix time of the midnight before an RMC or ZDA sentence; None where it states no date.

    Examples
    --------
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

    Parameters
    ----------
    clocks : sequence of float
        Seconds since midnight of each sentence; less by half a day than the one before is a new day.
    midnights : sequence of float or None
        Unix time of the midnight before each sentence [s]; None for one without a date.

    Examples
    --------
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
