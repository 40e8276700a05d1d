"""Places of strips: their middles and half-lengths, to which tilts refer."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from survey.core.arrays import FloatArray, IntArray
from survey.core.errors import CapacityError

N_TERMS = 5
"""Errors of a strip: offset, tilt eastwards and northwards, shift eastwards and northwards."""
_MOST_STRIPS = 1000


class StripPlaces(NamedTuple):
    """Keys of the strips (S,), their middles (S, 2) [m], and their half-lengths (S,) [m]."""

    keys: npt.NDArray[np.uint32]
    middle: FloatArray
    half_m: FloatArray

    @classmethod
    def of(cls, tables: list[npt.NDArray[np.float64]]) -> "StripPlaces":
        """Return the places by tables of the tiles: key, number of cells, sums of x, y, x², y² [m].

        Raises
        ------
        CapacityError
            More strips than can be solved together.
        """
        rows = np.concatenate(tables)
        keys, index = np.unique(rows[:, 0], return_inverse=True)
        if len(keys) > _MOST_STRIPS:
            raise CapacityError(
                f"the points come from {len(keys):,} strips; {_MOST_STRIPS:,} are solved together, map parts of the survey."
            )
        n, x, y, xx, yy = (np.bincount(index.ravel(), rows[:, k]) for k in range(1, 6))
        middle = np.column_stack([x, y]) / n[:, None]
        spread = np.maximum((xx + yy) / n - np.sum(middle**2, axis=1), 0.0)
        return cls(keys.astype(np.uint32), middle, np.maximum(np.sqrt(3.0 * spread), 50.0))

    def design(self, strip: IntArray, xy: FloatArray, slope: FloatArray) -> FloatArray:
        """Return the rows (N, 5) that make the error of a strip at places (N, 2) [m] with slopes (N, 2) [m/m]."""
        tilts = (xy - self.middle[strip]) / self.half_m[strip, None]
        return np.column_stack([np.ones(len(xy)), tilts, -slope])

    def numbers(self, keys: npt.NDArray[np.uint32]) -> IntArray:
        """Return the numbers (N,) of strips by their keys."""
        numbers: IntArray = np.searchsorted(self.keys, keys)
        return numbers
