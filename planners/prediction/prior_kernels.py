"""Covariances of the terrain that are fitted to the cells of a coarse prior by their likelihood."""

import numpy as np
import shapely

from planners.capacity import require_cells
from survey import Dem, InputError, SurveyArea
from survey.core import BoolArray, IntArray
from survey.reconstruction import GaussianProcessConfig
from survey.reconstruction.gp.kernels import Kernel
from survey.reconstruction.gp.marginal_likelihood import SMOOTH_TO_ROUGH, likeliest

_LEAST_CELLS = 9
_LEAST_ABOUT = 36
# Of more cells than this, so many groups along each side are used, with cells at these offsets from their first.
_MOST_CELLS = 10_000
_N_GROUPS = 5
_OFFSETS = np.array([0, 1, 3, 9])


def terrain_kernel(prior: Dem, area: SurveyArea) -> Kernel:
    """Fit a covariance to the elevations that are known beforehand, by their likelihood.

    Parameters
    ----------
    prior : Dem
        Coarse elevations.
    area : SurveyArea
        Cells on its free ground, and next to it, are used; of fewer than 36, those within its bounds.

    Returns
    -------
    Kernel
        The likeliest of squared exponential, Matérn 5/2 and Matérn 3/2.

    Raises
    ------
    InputError
        Fewer than 9 known cells on the area.

    Notes
    -----
    Of more than 10,000 cells, 25 groups of 16 cells are used, spread evenly.

    Coarse cells show no relief finer than themselves, so errors predicted with this
    kernel are too small on rough ground; refit on the survey's first swaths.

    Examples
    --------
    >>> area = SurveyArea.rectangle((0.0, 0.0, 90.0, 90.0), "EPSG:32608")
    >>> heights = np.add.outer(np.sin(np.arange(7.0)), np.cos(np.arange(7.0)))
    >>> from survey.data.grid import Grid
    >>> kernel = terrain_kernel(Dem.on(Grid((0.0, 0.0, 90.0, 90.0), 15.0, "EPSG:32608"), heights), area)
    >>> 5.0 < kernel.length_scales_m[0] < 100.0
    True
    """
    area.require_crs(prior.crs, "the prior")
    xmin, ymin, xmax, ymax = area.bounds
    prior = _over(prior, area)
    require_cells(prior.elevation.size)
    xy, height = prior.xy, prior.elevation.ravel()
    near = (xy >= [xmin, ymin]).all(axis=1) & (xy <= [xmax, ymax]).all(axis=1) & np.isfinite(height)
    about = near & _about(area, prior)
    if about.sum() >= _LEAST_ABOUT:
        near = about
    if near.sum() < _LEAST_CELLS:
        raise InputError(
            f"{int(near.sum())} known cells of the prior lie on the area; at least {_LEAST_CELLS} are needed to fit a length scale."
        )
    some = near & _in_groups(prior.shape)
    if near.sum() > _MOST_CELLS and some.sum() > _LEAST_CELLS**2:
        near = some
    noise = np.full(int(near.sum()), 1e-4 * float(np.var(height[near])) + 1e-4)
    found = likeliest(xy[near], height[near], noise, GaussianProcessConfig(), candidates=SMOOTH_TO_ROUGH)
    return found.kernel


def _about(area: SurveyArea, prior: Dem) -> BoolArray:
    """Return which cells (R · C,) are on the free ground or next to it: valley sides are rougher than a glacier."""
    about = area.free.buffer(prior.step_m)
    shapely.prepare(about)
    inside: BoolArray = shapely.contains_xy(about, prior.xy)
    return inside


def _in_groups(shape: tuple[int, int]) -> BoolArray:
    """Return which cells (R · C,) of a grid lie in groups that are spread evenly over it."""
    rows, columns = (_group_indices(n) for n in shape)
    chosen = np.zeros(shape, dtype=np.bool_)
    chosen[np.ix_(rows, columns)] = True
    return chosen.ravel()


def _group_indices(n: int) -> IntArray:
    """Return the indices along a side of n cells that lie in groups."""
    first = np.linspace(0, max(n - 1 - _OFFSETS[-1], 0), _N_GROUPS).astype(int)
    indices: IntArray = np.unique(np.minimum(first[:, None] + _OFFSETS, n - 1))
    return indices


def _over(prior: Dem, area: SurveyArea) -> Dem:
    """Return the cells of a prior about an area; all of them where fewer than 2 × 2 lie on it."""
    xmin, ymin, xmax, ymax = area.bounds
    pad = 2.0 * prior.step_m
    try:
        return prior.window((xmin - pad, ymin - pad, xmax + pad, ymax + pad))
    except InputError:
        return prior
