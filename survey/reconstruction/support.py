"""Support codes of mapped heights: measured, interpolated or unseen."""

import numpy as np
import numpy.typing as npt

from survey.core.arrays import FloatArray
from survey.reconstruction.base import INTERPOLATED, MEASURED, UNSEEN

_NEAR_LENGTHS = 0.25
_UNSEEN_RATIO = 0.9


def support_codes(
    nearest_m: FloatArray, variance_ratio: FloatArray, *, shortest_length_m: float, step_m: float = 0.0
) -> npt.NDArray[np.uint8]:
    """Return the support code of every place.

    A place is measured when the nearest point (`nearest_m` away) lies within a quarter of
    the shortest length scale or half a cell's diagonal; unseen when the points took away
    less than a tenth of the prior variance (`variance_ratio`, posterior over prior, above
    0.9); interpolated otherwise.

    Examples
    --------
    >>> support_codes(np.array([0.0, 8.0, 90.0]), np.array([0.0, 0.4, 1.0]), shortest_length_m=10.0)
    array([3, 1, 0], dtype=uint8)
    """
    reach = max(_NEAR_LENGTHS * shortest_length_m, step_m / np.sqrt(2.0))
    codes = np.where(variance_ratio > _UNSEEN_RATIO, UNSEEN, INTERPOLATED)
    return np.where(nearest_m <= reach, MEASURED, codes).astype(np.uint8)
