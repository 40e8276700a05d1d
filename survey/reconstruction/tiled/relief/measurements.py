"""Cells of a window as measurements of the fine relief: residuals to the long relief, errors of strips removed."""

from typing import NamedTuple

import numpy as np

from survey.core.arrays import BoolArray, FloatArray
from survey.reconstruction.nodes import bilinear
from survey.reconstruction.tiled.cells.rasters import mean_heights, slopes
from survey.reconstruction.tiled.cells.statistics import cells_in
from survey.reconstruction.tiled.job import TiledJob
from survey.reconstruction.tiled.layout import CellWindow, MapTile
from survey.reconstruction.tiled.relief.fine_relief import CellPoints
from survey.reconstruction.tiled.relief.noise import chosen
from survey.reconstruction.tiled.relief.shared import Shared
from survey.reconstruction.tiled.strips.overlaps import shrunk_variance, slopes_at

WITHHELD_SIDE = 2
"""Cells along a side of the squares that are withheld together."""
# Points of a cell agree to no less than this [m²].
_LEAST_M2 = 1e-4**2


class Measurements(NamedTuple):
    """Measurements in a window, which of them are withheld, long relief and slopes at the middles of its cells."""

    points: CellPoints
    withheld: BoolArray
    long_m: FloatArray
    long_std_m: FloatArray
    slope: FloatArray


def measurements(
    job: TiledJob, shared: Shared, tile: MapTile, window: CellWindow, share: float
) -> Measurements:
    """Return the measurements of a window about a tile.

    Parameters
    ----------
    job : TiledJob
        The map.
    shared : Shared
        Errors of strips and long relief.
    tile : MapTile
        The tile in or about which the window lies.
    window : CellWindow
        Cells.
    share : float
        Share of the cells that is withheld.
    """
    cell_m = job.layout.cell_m
    cells = cells_in(job.work / "cells", job.layout, tile, window)
    long_m, long_std_m = shared.relief.on(window, cell_m)
    uv = np.column_stack(
        [cells["column"] - window.west + cells["x"] - 0.5, cells["row"] - window.south + cells["y"] - 0.5]
    ).astype(np.float64)
    inside = np.clip(uv, 0.0, (window.columns - 1, window.rows - 1))
    slope = slopes_at(cells, window) / cell_m
    xy = (uv + 0.5 + [window.west, window.south]) * cell_m
    strip_m = shared.strips.at(cells["strip"], xy, slope)
    variance = shrunk_variance(cells["variance"], cells["n"], shared.usual_m2) / cells["n"]
    points = CellPoints(
        inside,
        cells["z"] - strip_m - bilinear(long_m, inside),
        1.0 / np.maximum(variance + shared.strips.cell_m**2, _LEAST_M2),
        cells["strip"].astype(np.int64),
        cells["row"].astype(np.int64),
        cells["column"].astype(np.int64),
    )
    withheld = chosen(points.column, points.row, WITHHELD_SIDE, share) > 0
    heights = mean_heights(cells, window, strip_m)
    return Measurements(points, withheld, long_m, long_std_m, _node_slopes(heights, cell_m))


def _node_slopes(heights: FloatArray, cell_m: float) -> FloatArray:
    """Return the slopes eastwards and northwards (rows, columns, 2) [m/m]."""
    return np.stack(slopes(heights), axis=-1) / cell_m
