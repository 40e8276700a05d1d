"""Times are seconds everywhere: recognition of times in milliseconds, microseconds and nanoseconds.

A format or the name of a column may declare a unit; numbers are then converted. Where seconds were declared, numbers that
are plainly none are refused: dates since 1970 by their size, and other times by steps that no recording has.
"""

import re

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import InputError

PER_SECOND = {"nanoseconds": 1e9, "microseconds": 1e6, "milliseconds": 1e3}
"""How many of a unit are a second."""
# No date between 1979 and 2103 is beyond these; and no other time is as large as the last [s].
_DATES_S, _LARGEST_S = (3e8, 4.2e9), 1e11
LONGEST_STEP_S, LONGEST_IMAGE_STEP_S = 600.0, 2000.0
"""Longest intervals between the poses and the images of a drive, by their median: beyond them they are in another unit."""
# Least interval between two readings in each unit: of 1 kHz in nanoseconds, of 500 Hz in microseconds.
_LEAST_STEPS = {"nanoseconds": 1e6, "microseconds": 2e3, "milliseconds": 0.0}
_DECLARED = re.compile(
    r"(?:^|[\W_]|unixtime)(?:(ns|nano\w*)|([uµμ]s|micro\w*)|(ms|milli\w*))[\W_]*$", re.IGNORECASE
)


def declared_unit(name: str) -> str | None:
    """Return the unit that the name of a column of times ends with; None for seconds and where it states none.

    >>> declared_unit("Timestamp [ns]"), declared_unit("time_ms"), declared_unit("UnixTimeMillis"), declared_unit("time_s")
    ('nanoseconds', 'milliseconds', 'milliseconds', None)
    """
    found = _DECLARED.search(name)
    return None if found is None else list(PER_SECOND)[found.lastindex - 1 if found.lastindex else 0]


def without_time_unit(name: str) -> str:
    """Return the name of a column of times without a unit other than seconds.

    >>> without_time_unit("timestamp_ns"), without_time_unit("time")
    ('timestamp', 'time')
    """
    return _DECLARED.sub("", name)


def plain_unit(times: FloatArray, longest_step_s: float = np.inf) -> str | None:
    """Return the unit of times that are plainly no seconds; None for seconds.

    `times` (N,): in order. `longest_step_s`: no median step is longer [s].

    >>> plain_unit(np.array([1.7e18, 1.7e18 + 1e8])), plain_unit(np.array([1.7e12])), plain_unit(np.array([1.7e9]))
    ('nanoseconds', 'milliseconds', None)
    >>> plain_unit(np.array([5e12, 5.1e12])), plain_unit(np.array([0.0, 1e8]), 600.0), plain_unit(np.array([0.0, 0.1]))
    ('nanoseconds', 'nanoseconds', None)
    """
    if len(times) == 0 or not np.isfinite(times).all():
        return None
    first, step = abs(float(times[0])), float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    if first <= _LARGEST_S and step <= longest_step_s:
        return None
    for name, per_second in PER_SECOND.items():
        if _DATES_S[0] <= first / per_second <= _DATES_S[1] and step <= LONGEST_STEP_S * per_second:
            return name
    return next(name for name, least in _LEAST_STEPS.items() if step >= least)


def refuse_other_unit(times: FloatArray, where: str, longest_step_s: float = np.inf) -> None:
    """Refuse times of a reading whose unit is seconds that are plainly in another one.

    `times` (N,): in order. `where`: begins the sentence. `longest_step_s`: no median step is longer [s].

    >>> refuse_other_unit(np.array([1.7e18, 1.7e18 + 1e8]), "the times of a.tum")
    Traceback (most recent call last):
        ...
    survey.core.errors.InputError: the times of a.tum are no seconds (the first is 1.7e+18, the next 1e+08 later): they look like nanoseconds; divide them by 1e+09.
    """
    unit = plain_unit(times, longest_step_s)
    if unit is not None:
        after = f", the next {np.median(np.diff(times)):.6g} later" if len(times) > 1 else ""
        raise InputError(
            f"{where} are no seconds (the first is {times[0]:.15g}{after}): they look like {unit}; divide them by {PER_SECOND[unit]:.0e}."
        )
