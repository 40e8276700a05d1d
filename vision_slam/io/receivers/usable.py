"""Fixes that can be used: finite places at times that increase."""

import numpy as np

from survey.core.arrays import BoolArray, FloatArray, IntArray
from survey.core.errors import InputError


def usable(
    time_s: FloatArray, place: FloatArray, sigma_m: FloatArray | None, where: str
) -> tuple[BoolArray, tuple[str, ...]]:
    """Return which fixes (N,) of a file can be used, and notes of those that are left out.

    Parameters
    ----------
    time_s, place : ndarray
        Times (N,) [s] and places (N, 3).
    sigma_m : (N,) ndarray, optional
        Standard deviations [m].
    where : str
        The file, for messages.

    Raises
    ------
    InputError
        A time is no finite number, or the times do not increase but for fixes that repeat the one before.

    Examples
    --------
    >>> usable(np.array([0.0, 1.0]), np.array([[8.0, 46.0, np.nan], [8.0, 46.0, 5.0]]), None, "a.csv")[0].tolist()
    [False, True]
    """
    bad = np.flatnonzero(~np.isfinite(time_s))
    if len(bad):
        raise InputError(f"{where}: the time of fix {bad[0] + 1} is no finite number; correct or remove it.")
    values = place if sigma_m is None else np.column_stack([place, sigma_m])
    stays: BoolArray = np.asarray(np.isfinite(values).all(axis=1), dtype=np.bool_)
    n_not_finite = int((~stays).sum())
    if not stays.any():
        raise InputError(f"{where} holds no fix with a finite place and error; record again, or correct it.")
    numbers = np.flatnonzero(stays)
    is_same = (np.diff(np.column_stack([time_s, place])[numbers], axis=0) == 0.0).all(axis=1)
    stays[numbers[1:][is_same]] = False
    _refuse_disorder(time_s, np.flatnonzero(stays), where)
    counted = (
        (n_not_finite, "fixes whose place or error is no finite number are left out"),
        (int(is_same.sum()), "fixes that repeat time and place of the one before are left out"),
    )
    return stays, tuple(f"{n} {words}" for n, words in counted if n)


def _refuse_disorder(time_s: FloatArray, numbers: IntArray, where: str) -> None:
    """Refuse times that do not increase, by the first fix whose time does not."""
    late = np.flatnonzero(np.diff(time_s[numbers]) <= 0.0)
    if not len(late):
        return
    before, after = numbers[late[0]], numbers[late[0] + 1]
    raise InputError(
        f"{where}: the times of the fixes do not increase: fix {after + 1} at {time_s[after]:.3f} s follows one at "
        f"{time_s[before]:.3f} s; sort them, or remove those of a second receiver."
    )
