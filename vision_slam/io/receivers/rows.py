"""Fixes as a receiver's file has them, before they become a log."""

from typing import NamedTuple

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.crs.vertical_datum import UNSTATED

_RADIUS_OF_68_PERCENT = 1.51


class ReceiverFixes(NamedTuple):
    """Fixes of one file.

    ``time_s`` (N,) is Unix time when `is_dated`; ``place`` (N, 3) holds longitude, latitude
    [deg] and height [m], or easting, northing and height [m] where not `is_geodetic`;
    ``sigma_m`` (N,) is the horizontal standard deviation in each axis.
    """

    time_s: FloatArray
    place: FloatArray
    sigma_m: FloatArray | None = None
    is_geodetic: bool = True
    is_dated: bool = True
    n_without_fix: int = 0
    vertical_datum: str = UNSTATED
    notes: tuple[str, ...] = ()


def axis_sigma_m(radius_m: FloatArray) -> FloatArray:
    """Return the standard deviation in each axis of a radius that holds 68 % of the positions.

    Examples
    --------
    >>> axis_sigma_m(np.array([3.02])).round(2).tolist()
    [2.0]
    """
    sigma_m: FloatArray = np.asarray(radius_m, dtype=np.float64) / _RADIUS_OF_68_PERCENT
    return sigma_m
