"""Times of day and dates that a table writes as one number: 100015 for 10:00:15."""

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import InputError

# 19700101000000 to 21000101000000
_CALENDAR = (1.97e13, 2.1e13)
_DAY_CLOCK = 240000.0
# Seconds that a number of hours, minutes and seconds leaps over from one minute to the next.
_LEAP_S = 40.0
_EVEN_S = 1.0


def refuse_clock_numbers(numbers: FloatArray, where: str) -> None:
    """Refuse numbers that are dates or times of day and would be taken for seconds.

    Parameters
    ----------
    numbers : (N,) ndarray
        The column of times.
    where : str
        What they stand in, for the message.

    Raises
    ------
    InputError
        All are dates such as 20240612 or 20240612100015, or they have even steps as hours, minutes and seconds alone.

    Examples
    --------
    >>> refuse_clock_numbers(np.array([0.0, 40.0, 80.0, 120.0]), "fixes.csv")
    >>> refuse_clock_numbers(np.array([100040.0, 100050.0, 100100.0]), "fixes.csv")
    Traceback (most recent call last):
    survey.core.errors.InputError: fixes.csv counts hours, minutes and seconds in one number (100040); ...
    """
    if ((numbers > _CALENDAR[0]) & (numbers < _CALENDAR[1])).all() or _is_days(numbers):
        raise InputError(
            f"{where} writes dates as one number ({numbers[0]:.0f}); write them as 2024-06-12T10:00:15Z or as Unix time."
        )
    if _is_clock(numbers):
        raise InputError(
            f"{where} counts hours, minutes and seconds in one number ({numbers[0]:.6g}); "
            "write seconds, or dates such as 2024-06-12T10:00:15Z."
        )


def _is_days(numbers: FloatArray) -> bool:
    """Return whether all numbers are days such as 20240612."""
    years, rest = np.divmod(numbers, 10000.0)
    months, days = np.divmod(rest, 100.0)
    is_day = (years >= 1900) & (years <= 2100) & (months >= 1) & (months <= 12) & (days >= 1) & (days <= 31)
    return bool((is_day & (numbers == np.rint(numbers))).all())


def _is_clock(numbers: FloatArray) -> bool:
    """Return whether numbers of uneven steps have even ones when they are read as hours, minutes and seconds."""
    hours, rest = np.divmod(numbers, 10000.0)
    minutes, seconds = np.divmod(rest, 100.0)
    is_possible = (numbers >= 0.0) & (numbers < _DAY_CLOCK) & (minutes < 60.0) & (seconds < 60.0)
    if len(numbers) < 3 or not is_possible.all():
        return False
    uneven, even = np.ptp(np.diff(numbers)), np.ptp(np.diff(3600.0 * hours + 60.0 * minutes + seconds))
    return bool(uneven >= _LEAP_S - _EVEN_S and even < _EVEN_S)
