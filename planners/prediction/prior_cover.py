"""Share of an area on which a prior DEM has a height."""

import logging

import numpy as np
import shapely

from survey.core.arrays import BoolArray, FloatArray
from survey.core.errors import InputError
from survey.data.area import SurveyArea
from survey.data.dem import Dem

logger = logging.getLogger(__name__)

_N_ALONG = 64
_NOTABLE = 1e-3
"""Share of the area without a height that is warned of."""


def covered_share(area: SurveyArea, prior: Dem) -> float:
    """Return the share of the area's free ground that lies on cells with a height.

    Parameters
    ----------
    area : SurveyArea
        What is to be surveyed.
    prior : Dem
        Elevations in the area's CRS.

    Returns
    -------
    float
        Between 0 and 1, from 64 places along the longer side of the area.

    Raises
    ------
    InputError
        A prior in another CRS.

    Examples
    --------
    >>> from survey.data.grid import Grid
    >>> dem = Dem.on(Grid((5.0, 5.0, 45.0, 95.0), 10.0, "EPSG:32608"), np.zeros((10, 5)))
    >>> covered_share(SurveyArea.rectangle((0.0, 0.0, 100.0, 100.0), "EPSG:32608"), dem)
    0.5
    """
    area.require_crs(prior.crs, "the prior")
    share = float(_has_height(prior, _places(area)).mean())
    return share if share > 0.0 else _small_share(area, prior)


def require_cover(area: SurveyArea, prior: Dem) -> float:
    """Return the covered share; warn where some of the area has no height, refuse where all of it has none.

    Parameters
    ----------
    area : SurveyArea
        What is to be surveyed.
    prior : Dem
        Elevations in the area's CRS.

    Returns
    -------
    float
        As `covered_share` returns it.

    Raises
    ------
    InputError
        A prior in another CRS, or without a height on the area.
    """
    share = covered_share(area, prior)
    if share == 0.0:
        inner, outer = (tuple(round(b, 1) for b in bounds) for bounds in (area.bounds, prior.bounds))
        raise InputError(
            f"the prior has no height on the area: the area's bounds are {inner} and those of the prior {outer}; "
            "give a prior that covers the area, or none."
        )
    if share < 1.0 - _NOTABLE:
        logger.warning(
            "the prior covers %.1f %% of the area; the terrain of the rest counts as unknown.", 100.0 * share
        )
    return share


def cell_centres(area: SurveyArea, n_along: int) -> FloatArray:
    """Return the centres of square cells on the free ground.

    Parameters
    ----------
    area : SurveyArea
        What is to be surveyed.
    n_along : int
        Number of cells along the longer side of its bounds.

    Returns
    -------
    (M, 2) ndarray
        Easting and northing [m].

    Raises
    ------
    InputError
        No centre lies on the free ground.

    Examples
    --------
    >>> cell_centres(SurveyArea.rectangle((0.0, 0.0, 20.0, 10.0), "EPSG:32608"), 2).tolist()
    [[5.0, 5.0], [15.0, 5.0]]
    """
    xmin, ymin, xmax, ymax = area.bounds
    cell = max(xmax - xmin, ymax - ymin) / n_along
    x, y = np.arange(xmin + 0.5 * cell, xmax, cell), np.arange(ymin + 0.5 * cell, ymax, cell)
    centres = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    inside: FloatArray = centres[area.contains(centres)]
    if not len(inside):
        raise InputError(
            f"the area is too narrow for {n_along} cells along its longer side; give a wider one."
        )
    return inside


def _places(area: SurveyArea) -> FloatArray:
    """Return places (N, 2) over the free ground, however narrow it is."""
    try:
        return cell_centres(area, _N_ALONG)
    except InputError:
        corners: FloatArray = shapely.get_coordinates(area.free)
        return corners


def _small_share(area: SurveyArea, prior: Dem) -> float:
    """Return the share of cells that lie between all places."""
    try:
        near = prior.window(area.bounds)
    except InputError:
        return 0.0
    n_known = int((area.contains(near.xy) & np.isfinite(near.elevation).ravel()).sum())
    return min(n_known * prior.step_m**2 / float(area.free.area), 1.0)


def _has_height(dem: Dem, places: FloatArray) -> BoolArray:
    """Return which places (N, 2) lie on cells with a height."""
    rows, columns = dem.shape
    column = np.floor((places[:, 0] - dem.transform.c) / dem.transform.a).astype(np.int64)
    row = np.floor((places[:, 1] - dem.transform.f) / dem.transform.e).astype(np.int64)
    inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
    known: BoolArray = np.zeros(len(places), dtype=np.bool_)
    known[inside] = np.isfinite(dem.elevation[row[inside], column[inside]])
    return known
