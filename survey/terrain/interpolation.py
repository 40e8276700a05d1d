"""Interpolate coarse cells to a smooth surface with the same cell means."""

import numpy as np
from scipy.interpolate import make_interp_spline

from survey.core.arrays import FloatArray
from survey.core.crs.agreement import same_crs
from survey.core.errors import InputError
from survey.data.dem import Dem
from survey.data.grid import Grid

_LEAST_CELLS = 5


def smooth_interpolation(coarse: Dem, grid: Grid) -> Dem:
    r"""Return the smooth surface whose mean over each coarse cell is that cell's value.

    Along each axis a quartic spline F runs through the heights summed up to each cell edge;
    its derivative is a cubic spline f with continuous second derivative and

    .. math::  \frac{1}{d} \int_{x_i}^{x_i + d} f(x) \, dx = \frac{F(x_i + d) - F(x_i)}{d} = z_i .

    The surface is the product of both axes. It rises above the highest cell and falls below
    the lowest one, as the terrain does whose means they are.

    Parameters
    ----------
    coarse : Dem
        Cell means [m], without nodata; a margin of two or more cells around the grid keeps the
        free ends of the splines away from it.
    grid : Grid
        Where the surface is wanted, within the cells' outer edges.

    Returns
    -------
    Dem
        On the grid, with the coarse cells' vertical datum.

    Raises
    ------
    InputError
        Nodata among the cells, fewer than 5 × 5 of them, another CRS, a grid that reaches
        beyond them.

    Notes
    -----
    A step in the terrain makes the surface swing beside it (Gibbs). What is smaller than a
    cell cannot come back.

    Examples
    --------
    >>> x, y = np.meshgrid(np.arange(6.0), np.arange(5.0))
    >>> coarse = Dem.on(Grid((0.0, 0.0, 5.0, 4.0), 1.0), x + 2.0 * y)
    >>> smooth_interpolation(coarse, Grid((1.0, 1.0, 2.0, 2.0), 0.5)).elevation[0]
    array([5. , 5.5, 6. ])
    """
    same_crs(coarse.crs, grid.crs, "the coarse cells and the grid")
    _check_cells(coarse, grid)
    left, _, _, top = coarse.bounds
    along_x = _mean_preserving(coarse.elevation.T, coarse.step_m, grid.x - left).T
    return Dem.on(grid, _mean_preserving(along_x, coarse.step_m, top - grid.y), coarse.vertical_datum)


def _mean_preserving(cells: FloatArray, width_m: float, places_m: FloatArray) -> FloatArray:
    """Evaluate the mean-preserving spline of each column of cells at distances from the first edge."""
    # Distances in cells and sums about the first cell keep the arithmetic near 1.
    base = cells[:1]
    edges = np.arange(len(cells) + 1.0)
    sums = np.vstack([np.zeros_like(base), np.cumsum(cells - base, axis=0)])
    values: FloatArray = make_interp_spline(edges, sums, k=4).derivative()(places_m / width_m)
    return values + base


def _check_cells(coarse: Dem, grid: Grid) -> None:
    n_empty = int(np.isnan(coarse.elevation).sum())
    if n_empty:
        raise InputError(
            f"{n_empty} of the coarse cells hold no height; choose a window without nodata or fill them first."
        )
    if min(coarse.shape) < _LEAST_CELLS:
        raise InputError(
            f"there are {coarse.shape[0]} × {coarse.shape[1]} coarse cells; at least {_LEAST_CELLS} × {_LEAST_CELLS} are needed."
        )
    inner, outer, slack = grid.bounds, coarse.bounds, 1e-6 * coarse.step_m
    if any(i < o - slack for i, o in zip(inner[:2], outer[:2], strict=True)) or any(
        i > o + slack for i, o in zip(inner[2:], outer[2:], strict=True)
    ):
        raise InputError(
            f"the grid {inner} reaches beyond the coarse cells {tuple(round(o, 2) for o in outer)}; widen the window of cells."
        )
