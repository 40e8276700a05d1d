"""Filter ground points of airborne clouds: the Simple Morphological Filter (SMRF) of Pingel, Clarke and McBride (2013).

T. J. Pingel, K. C. Clarke, W. A. McBride: An improved simple morphological filter for the terrain classification of airborne
LIDAR data. ISPRS Journal of Photogrammetry and Remote Sensing 77 (2013), 21-30. The settings are those that the paper gives
for all of its samples together, but for the largest distance from the surface.

The lowest height of each cell makes a raster. Openings with growing discs remove what is narrower than a disc and rises above
the opened raster by more than the slope allows. The cells that remain make a provisional surface, and a point is ground
where it lies near that surface.
"""

from typing import NamedTuple, Self

import numpy as np
from scipy.ndimage import map_coordinates, maximum_filter1d, minimum_filter1d
from scipy.spatial import cKDTree

from survey.core import BoolArray, CapacityError, FloatArray
from survey.io.point_classes import EARLIER, Chosen
from survey.io.point_table import PLACE

CELL_M, WINDOW_M, SLOPE, THRESHOLD_M, SLOPE_FACTOR = 1.0, 18.0, 0.15, 0.45, 1.25
"""Side of a cell, largest radius of the discs, slope, and distance from the surface: a part that is fixed, and one times the slope.

The fixed part is 0.5 m in the paper, where a point is compared with the surface at the middle of its cell. Here it is compared
with the surface at the point, which differs less from the ground: with 0.45 m as little ground is lost."""
WIDEST_SPACING_M = 4.0
"""Points farther apart on average are not filtered: objects hold too few of them."""
# A cell that lies in a pit by this slope holds a low outlier.
_LOW_SLOPE = 5.0
_N_FILL = 8
_COVER_M = 10.0
_MOST_CELLS = 50_000_000


def spacing_m(xy: FloatArray) -> float:
    """Return the mean distance between points (N, 2) [m] over the squares of 10 m that hold any.

    >>> east, north = np.meshgrid(np.arange(0.0, 40.0, 2.0), np.arange(0.0, 40.0, 2.0))
    >>> spacing_m(np.column_stack([east.ravel(), north.ravel()]))
    2.0
    """
    squares = np.floor((xy - xy.min(axis=0)) / _COVER_M).astype(np.int64)
    n_squares = len(np.unique(squares[:, 0] * (squares[:, 1].max() + 1) + squares[:, 1]))
    return float(_COVER_M * np.sqrt(n_squares / len(xy)))


def filter_ground(chosen: Chosen) -> Chosen:
    """Return the points of the ground among points of LAS that no class states; points of other files stay as they are.

    The table is in metres. Points farther apart than `WIDEST_SPACING_M` are not filtered, and the sentence about the points says so.
    """
    classes = chosen.table.classes
    if classes is None or chosen.how is not None:
        return chosen
    xyz = np.column_stack([chosen.table.columns[name] for name in PLACE])
    apart_m = spacing_m(xyz[:, :2])
    if apart_m > WIDEST_SPACING_M:
        how = f"not filtered: they are {apart_m:.1f} m apart, and the filter needs {WIDEST_SPACING_M:g} m or less"
        return chosen._replace(how=how)
    is_last = classes != EARLIER
    chosen, xyz = chosen.without(is_last, "earlier returns of a pulse"), xyz[is_last]
    surface = GroundSurface.through(xyz)
    how = f"filtered (SMRF on cells of {surface.cell_m:.2g} m) as no point is classified so; ground=all maps every point"
    return chosen.without(surface.is_ground(xyz), "off the ground")._replace(how=how)


class GroundSurface(NamedTuple):
    """Provisional surface of the ground on cells, and how far from it a point of the ground may lie.

    Parameters
    ----------
    corner : (2,) ndarray
        Easting and northing of the south-western corner [m].
    cell_m : float
        Side of a cell [m].
    height_m, allowed_m : (rows, columns) ndarray
        Height at the middle of each cell and largest distance from it [m]; the first row is the southern one.
    """

    corner: FloatArray
    cell_m: float
    height_m: FloatArray
    allowed_m: FloatArray

    @classmethod
    def through(cls, xyz: FloatArray) -> Self:
        """Find the surface through the ground among points.

        Parameters
        ----------
        xyz : (N, 3) ndarray
            Easting, northing and height [m].

        Returns
        -------
        GroundSurface
            On cells of 1 m, or of the mean distance between points where that is larger.
        """
        cell_m, corner = max(CELL_M, spacing_m(xyz[:, :2])), xyz[:, :2].min(axis=0)
        column, row = np.floor((xyz[:, :2] - corner) / cell_m).astype(np.int64).T
        shape = int(row.max()) + 1, int(column.max()) + 1
        if shape[0] * shape[1] > _MOST_CELLS:
            raise CapacityError(
                f"the filter of ground has {_MOST_CELLS:,} cells at most, and the points spread over {shape[0]:,} × {shape[1]:,} of {cell_m:.3g} m; "
                "cut off the points that are far from the others, or map in tiles."
            )
        lowest = np.full(shape, np.inf)
        np.minimum.at(lowest, (row, column), xyz[:, 2])
        height_m = _provisional(lowest, cell_m)
        north, east = (_gradient(height_m, axis) / cell_m for axis in (0, 1))
        return cls(corner, cell_m, height_m, THRESHOLD_M + SLOPE_FACTOR * np.hypot(north, east))

    def is_ground(self, xyz: FloatArray) -> BoolArray:
        """Return which points are of the ground.

        Parameters
        ----------
        xyz : (N, 3) ndarray
            Easting, northing and height [m].

        Returns
        -------
        (N,) ndarray of bool
            True where a point lies no farther from the surface than is allowed there.
        """
        place = ((xyz[:, :2] - self.corner) / self.cell_m - 0.5).T[::-1]
        height_m = map_coordinates(self.height_m, place, order=3, mode="nearest")
        allowed_m = map_coordinates(self.allowed_m, place, order=1, mode="nearest")
        found: BoolArray = np.abs(xyz[:, 2] - height_m) <= allowed_m
        return found


def _gradient(height_m: FloatArray, axis: int) -> FloatArray:
    """Return the rise per cell along an axis; 0 where there is one cell alone."""
    if height_m.shape[axis] < 2:
        return np.zeros(height_m.shape)
    rise: FloatArray = np.gradient(height_m, axis=axis)
    return rise


def _provisional(lowest_m: FloatArray, cell_m: float) -> FloatArray:
    """Return the surface of the ground from the lowest heights of the cells; infinite where a cell holds no point."""
    empty = ~np.isfinite(lowest_m)
    height_m = _filled(lowest_m, empty)
    is_low = _objects(-height_m, _LOW_SLOPE * cell_m, 1)
    is_object = _objects(height_m, SLOPE * cell_m, int(np.ceil(WINDOW_M / cell_m)))
    left_out = empty | is_low | is_object
    return height_m if left_out.all() else _filled(height_m, left_out)


def _filled(height_m: FloatArray, is_missing: BoolArray) -> FloatArray:
    """Return heights in which a missing one is the mean of the eight nearest known ones."""
    if not is_missing.any():
        return height_m
    known = np.argwhere(~is_missing)
    _, near = cKDTree(known).query(np.argwhere(is_missing), min(_N_FILL, len(known)))
    filled = height_m.copy()
    filled[is_missing] = height_m[~is_missing][near.reshape(int(is_missing.sum()), -1)].mean(axis=1)
    return filled


def _objects(height_m: FloatArray, rise_m: float, most_cells: int) -> BoolArray:
    """Return the cells that rise above an opening by more than `rise_m` for each cell of its radius.

    The radius grows from one cell to `most_cells`, and each opening is applied to the one before. The raster is continued level
    beyond its edges: discs that end there would cut off the upper edge of a slope.
    """
    surface = np.pad(height_m, most_cells, mode="edge")
    found = np.zeros(surface.shape, dtype=np.bool_)
    for radius in range(1, most_cells + 1):
        opened = _over_disc(_over_disc(surface, radius, dilates=False), radius, dilates=True)
        found |= surface - opened > rise_m * radius
        surface = opened
    return found[most_cells:-most_cells, most_cells:-most_cells]


def _over_disc(height_m: FloatArray, radius: int, *, dilates: bool) -> FloatArray:
    """Return the highest or the lowest height within a disc about each cell, by running filters over its rows."""
    filter1d, pick = (maximum_filter1d, np.maximum) if dilates else (minimum_filter1d, np.minimum)
    rows = len(height_m)
    found: FloatArray | None = None
    for up in range(min(radius, rows - 1) + 1):
        half = int(np.sqrt(radius**2 - up**2))
        along = filter1d(height_m, 2 * half + 1, axis=1, mode="nearest")
        if found is None:
            found = along
            continue
        pick(found[up:], along[: rows - up], out=found[up:])
        pick(found[: rows - up], along[up:], out=found[: rows - up])
    assert found is not None
    return found
