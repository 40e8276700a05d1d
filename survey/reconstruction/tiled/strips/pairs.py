"""Overlaps of two strips: how far one lies above the other, and what a difference of their rasters shows."""

from typing import Any, NamedTuple, Self

import numpy as np
import numpy.typing as npt

from survey.core.arrays import FloatArray
from survey.reconstruction.tiled.cells.pieces import strip_name
from survey.reconstruction.tiled.strips.strip_errors import StripErrors

_COLUMNS = ("x", "y", "e", "v", "raw", "placed")


class StripPairs(NamedTuple):
    """Overlapping strips.

    Parameters
    ----------
    table : (N, 9) ndarray
        Keys of the two strips; number of blocks of cells that both have seen; means over the cells: easting and northing
        [m], slopes [m/m], difference of the cells' mean heights [m], and the part of it that other places of the points in
        the cell make [m].
    """

    table: FloatArray

    @classmethod
    def of(cls, blocks: npt.NDArray[np.void]) -> Self:
        """Return the pairs that blocks of cells belong to."""
        keys = np.column_stack([blocks["first"], blocks["second"]]).astype(np.float64).reshape(-1, 2)
        pairs, index = np.unique(keys, axis=0, return_inverse=True)
        cells = np.bincount(index.ravel(), blocks["n"])
        # Places are means of a block, the others sums over its cells.
        sums = [
            np.bincount(index.ravel(), blocks[name] * (blocks["n"] if name in "xy" else 1.0))
            for name in _COLUMNS
        ]
        n_blocks = np.bincount(index.ravel(), minlength=len(pairs))
        return cls(np.column_stack([pairs, n_blocks, *(total / cells for total in sums)]))

    @property
    def n_blocks(self) -> int:
        """Number of blocks of cells that two strips have seen."""
        return int(self.table[:, 2].sum())

    def facts(self, strips: StripErrors) -> list[dict[str, Any]]:
        """Return how far each strip lies above another one at the middle of their overlap, for the record.

        ``cell_difference_m`` is the mean difference of the cells' mean heights as measured, and
        ``expected_cell_difference_m`` what offset, tilts, shifts and the places of the points in the cells make of it.
        """
        found = []
        for first, second, n, x, y, east, north, raw, placed in self.table.tolist():
            keys, place = (int(first), int(second)), np.array([x, y])
            offset_m, sigma_m = strips.offset_between(*keys, place)
            expected_m, expected_sigma_m = strips.offset_between(*keys, place, (east, north))
            found.append(
                {
                    "strips": [strip_name(key) for key in keys],
                    "n_blocks": int(n),
                    "offset_m": offset_m,
                    "offset_m_sigma": sigma_m,
                    "cell_difference_m": raw,
                    "expected_cell_difference_m": expected_m + placed,
                    "expected_cell_difference_m_sigma": expected_sigma_m,
                }
            )
        return found
