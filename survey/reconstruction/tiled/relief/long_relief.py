"""Relief longer than some blocks of cells, over the entire map at once: the mean that the fine relief departs from."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import RectBivariateSpline, RegularGridInterpolator

from survey.core.arrays import FloatArray
from survey.reconstruction.lattice.config import FieldLatticeConfig
from survey.reconstruction.lattice.field_posterior import FieldPosterior, Part
from survey.reconstruction.lattice.stiffness import Stiffness, likeliest
from survey.reconstruction.nodes import NodeWindow, bilinear
from survey.reconstruction.tiled.layout import CellWindow, TileLayout
from survey.reconstruction.tiled.strips.strip_errors import StripErrors

_N_DRAWS = 32
_SIGMA_M = 0.1
_LEARNT_FROM = 60_000
# With too few points to learn from: gentle ground.
_FALLBACK = Stiffness(1000.0, 2000.0)


class LongRelief(NamedTuple):
    """Heights and standard deviations on the nodes of a coarse lattice.

    Parameters
    ----------
    window : NodeWindow
        Nodes.
    height : (H, W) ndarray
        Heights [m], the first row the southern one.
    std : (H, W) ndarray
        Standard deviations [m].
    reach_m : float
        Distance from points beyond which the lattice says nothing of the ground [m].
    """

    window: NodeWindow
    height: FloatArray
    std: FloatArray
    reach_m: float

    def on(self, cells: CellWindow, cell_m: float) -> tuple[FloatArray, FloatArray]:
        """Return heights by cubic splines and standard deviations, linear, at the middles of cells (rows, columns) [m]."""
        x, y = self._axes()
        spline = RectBivariateSpline(y, x, self.height, kx=3, ky=3, s=0)
        linear = RegularGridInterpolator((y, x), self.std, bounds_error=False, fill_value=None)
        north, east = np.meshgrid(cells.y(cell_m), cells.x(cell_m), indexing="ij")
        return np.asarray(spline(cells.y(cell_m), cells.x(cell_m))), np.asarray(linear((north, east)))

    def _axes(self) -> tuple[FloatArray, FloatArray]:
        w = self.window
        columns, rows = np.arange(w.columns, dtype=np.float64), np.arange(w.rows, dtype=np.float64)
        return w.step_m * (w.west + columns), w.step_m * (w.south + rows)


def coarse_nodes(layout: TileLayout, coarse_cells: int) -> NodeWindow:
    """Return the nodes of the long relief, at least four a side, over all cells."""
    step_m = coarse_cells * layout.cell_m
    x, y = layout.extent.x(layout.cell_m), layout.extent.y(layout.cell_m)
    spare = 2.0 * step_m
    return NodeWindow.over((x[0] - spare, y[0] - spare, x[-1] + spare, y[-1] + spare), step_m)


def long_relief(
    layout: TileLayout, coarse_cells: int, blocks: FloatArray, strips: StripErrors, prior: FloatArray | None
) -> LongRelief:
    """Return the long relief through the means of blocks, about a prior where there is one.

    Parameters
    ----------
    layout : TileLayout
        Tiles of the map.
    coarse_cells : int
        Cells between neighbouring nodes.
    blocks : (N, 7) ndarray
        See `survey.reconstruction.tiled.summaries.relief_blocks`.
    strips : StripErrors
        Errors of the strips, which are subtracted.
    prior : (H, W) ndarray or None
        Heights of a coarse elevation model at the nodes [m], NaN where it has none.
    """
    window = coarse_nodes(layout, coarse_cells)
    about = np.zeros(window.shape) if prior is None else _complete(prior)
    keys = blocks[:, 0].astype(np.uint32)
    height = blocks[:, 4] - strips.at(keys, blocks[:, 2:4], blocks[:, 5:7])
    places = window.coordinates(blocks[:, 2:4])
    height = height - bilinear(about, places)
    level = float(np.median(height))
    weight = blocks[:, 1] / coarse_cells**2 / _SIGMA_M**2
    xyzw = np.column_stack([blocks[:, 2:4], height - level, weight])
    stiffness = likeliest(xyzw[:: -(-len(xyzw) // _LEARNT_FROM)], window.step_m) or _FALLBACK
    posterior = FieldPosterior.empty(window.shape, _N_DRAWS)
    posterior.information.add(np.column_stack([places, xyzw[:, 2:]]))
    whole = Part(slice(0, window.rows), slice(0, window.columns))
    posterior.solve(whole, window.step_m, stiffness, FieldLatticeConfig(tolerance=0.01))
    std = posterior.std(window, stiffness)
    return LongRelief(window, posterior.heights() + level + about, std, stiffness.range_m)


def _complete(prior: FloatArray) -> FloatArray:
    """Return a prior whose voids have its mean."""
    return np.where(np.isfinite(prior), prior, np.nanmean(prior))


def relief_arrays(relief: LongRelief) -> dict[str, Any]:
    """Return arrays from which `relief_of` makes the same long relief."""
    w = relief.window
    numbers = np.array([w.step_m, w.west, w.south, w.rows, w.columns, relief.reach_m])
    return {"relief_window": numbers, "relief_height": relief.height, "relief_std": relief.std}


def relief_of(arrays: Mapping[str, Any]) -> LongRelief:
    """Return the long relief from the arrays of `relief_arrays`."""
    step_m, west, south, rows, columns, reach_m = map(float, arrays["relief_window"])
    window = NodeWindow(step_m, int(west), int(south), int(rows), int(columns))
    return LongRelief(window, arrays["relief_height"], arrays["relief_std"], reach_m)
