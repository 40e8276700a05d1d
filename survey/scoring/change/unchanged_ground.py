"""Cells that may have changed, by outline, and the unchanged ground from which errors are estimated."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from survey.core.arrays import BoolArray, FloatArray
from survey.core.errors import InputError
from survey.data.dem import Dem
from survey.data.grid import Grid

BLUNDER = 5.0
"""Unchanged cells farther from their median than this many robust deviations hold blunders, not errors."""
_NMAD = 1.4826
_N_LEAST_STABLE = 100

Outlines = Mapping[str, Polygon | MultiPolygon]


class ComparedGround(NamedTuple):
    """Masks (H, W) of the outlines and of the unchanged ground on a grid."""

    grid: Grid
    outlines: Outlines
    inside: tuple[BoolArray, ...]
    stable: BoolArray

    @classmethod
    def of(cls, grid: Grid, outlines: Outlines, stable: Polygon | MultiPolygon | None) -> "ComparedGround":
        """Rasterize outlines; without `stable`, all ground outside them counts as unchanged.

        Raises
        ------
        InputError
            No outline, or one that holds no cell.
        """
        if not outlines:
            raise InputError("there is no outline; name at least one polygon over which to compute change.")
        x, y = grid.xy.T
        inside = tuple(shapely.contains_xy(shape, x, y).reshape(grid.shape) for shape in outlines.values())
        for name, shape, mask in zip(outlines, outlines.values(), inside, strict=True):
            if not mask.any():
                raise InputError(
                    f"the outline {name!r} ({shape.area:.0f} m²) holds no cell of the surveys' common grid; check that they overlap."
                )
        rest = ~np.logical_or.reduce(inside)
        if stable is not None:
            rest &= shapely.contains_xy(stable, x, y).reshape(grid.shape)
        return cls(grid, outlines, inside, rest)

    def stable_on(self, dem: Dem) -> BoolArray:
        """Return the unchanged ground (H, W) on the cells of another raster."""
        stable = Dem.on(self.grid, self.stable.astype(np.float64))
        calm: BoolArray = (stable.at(dem.xy) > 0.99).reshape(dem.shape)
        return calm


def without_blunders(difference: FloatArray, stable: BoolArray) -> BoolArray:
    """Return the unchanged cells (H, W) without blunders.

    Raises
    ------
    InputError
        Fewer than 100 unchanged cells.
    """
    if stable.sum() < _N_LEAST_STABLE:
        raise InputError(
            f"both surveys know {int(stable.sum())} cells of unchanged ground; {_N_LEAST_STABLE} are needed to learn their errors, "
            "survey some ground around the outline, or compare two terrain models (.npz)."
        )
    e = difference[stable]
    spread = max(float(_NMAD * np.median(np.abs(e - np.median(e)))), 1e-9)
    calm: BoolArray = stable & (np.abs(np.where(stable, difference, 0.0) - np.median(e)) <= BLUNDER * spread)
    return calm
