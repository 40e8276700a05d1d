"""Design of checkpoints: spread over the area, on gentle ground, within reach of the route."""

from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from survey.core.arrays import BoolArray, FloatArray, frozen, lattice_places
from survey.core.errors import InputError
from survey.core.map_scale import MapScale
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.route import Route
from survey.scoring.standards.checkpoints import within_reach

LEAST_SHARE = 0.20
"""Share of the points in each quarter of the area (NSSDA)."""
LEAST_SPACING = 0.10
"""Least distance between two points over the diagonal of the area (NSSDA)."""
_N_CANDIDATES_A_SIDE = 120
_N_TRIES = 60


def design_checkpoints(
    area: SurveyArea,
    n: int,
    rng: np.random.Generator,
    *,
    terrain: Dem | None = None,
    max_slope_deg: float = 10.0,
    route: Route | None = None,
    reach_m: float = 50.0,
) -> FloatArray:
    """Choose n places for checkpoints.

    Each quarter of the area's bounding rectangle holds at least 20 % of them, no two are
    nearer than 10 % of its diagonal, all lie on ground that is gentle and within reach of
    the route. Within these bounds places are drawn at random, so that their errors represent
    the area.

    Parameters
    ----------
    area : SurveyArea
        Places lie on its free ground.
    n : int
        Number of places.
    rng : numpy.random.Generator
        For the draw.
    terrain : Dem, optional
        Coarse heights; steeper ground is left out, for there an error in place is one in height.
    max_slope_deg : float
        Steepest ground [deg]; the scale factor of the CRS is applied where it differs from 1 by more than 1 %.
    route : Route, optional
        Places too far from it are left out.
    reach_m : float
        Largest distance from the route [m].

    Returns
    -------
    (n, 2) ndarray
        Easting and northing [m], from south-west to north-east by quarters.

    Raises
    ------
    InputError
        That many places do not fit; the message states how many candidates each bound leaves.

    Notes
    -----
    A tenth of the diagonal between neighbours leaves room for at most about 60 points in a square.

    Examples
    --------
    >>> area = SurveyArea.rectangle((0.0, 0.0, 600.0, 600.0), "EPSG:32608")
    >>> places = design_checkpoints(area, 30, np.random.default_rng(1))
    >>> from survey.scoring.standards.checkpoint_errors import Spread
    >>> spread = Spread.of(places, area)
    >>> min(spread.quadrant_shares) >= 0.2, spread.spacing_share >= 0.1
    (True, True)
    """
    if n < 1:
        raise InputError(f"{n} checkpoints were asked for; one or more can be placed.")
    candidates = _candidates(area, terrain, max_slope_deg, route, reach_m)
    quarter = _quarter(candidates, area)
    xmin, ymin, xmax, ymax = area.bounds
    apart_m = LEAST_SPACING * float(np.hypot(xmax - xmin, ymax - ymin))
    least = int(np.ceil(LEAST_SHARE * n - 1e-9)) if n >= 4 else 0
    best = 0
    for _ in range(_N_TRIES):
        chosen = _drawn(candidates, quarter, n, least=least, apart_m=apart_m, rng=rng)
        if len(chosen) == n:
            order = np.argsort(quarter[chosen], kind="stable")
            places: FloatArray = frozen(candidates[chosen[order]])
            return places
        best = max(best, len(chosen))
    counts = np.bincount(quarter, minlength=4)
    raise InputError(
        f"{n} checkpoints do not fit: {best} were placed at {apart_m:.0f} m from one another, with {counts.tolist()} candidates in the "
        "four quarters on gentle ground within reach; ask for fewer, allow steeper ground or a longer reach."
    )


def _candidates(
    area: SurveyArea, terrain: Dem | None, max_slope_deg: float, route: Route | None, reach_m: float
) -> FloatArray:
    """Return the places of a fine grid over the area that can be stood on and reached."""
    xmin, ymin, xmax, ymax = area.bounds
    x, y = (
        low + (np.arange(_N_CANDIDATES_A_SIDE) + 0.5) * (high - low) / _N_CANDIDATES_A_SIDE
        for low, high in ((xmin, xmax), (ymin, ymax))
    )
    places = lattice_places(x, y)
    fit = area.contains(places)
    factor = MapScale.over(area.crs, area.bounds).notable_factor
    if terrain is not None:
        area.require_crs(terrain.crs, "the terrain")
        # NaN, beyond the terrain, compares as false: unknown ground is not chosen.
        fit &= terrain.slope().at(places) <= _grid_slope_deg(max_slope_deg, factor)
    if route is not None:
        area.require_crs(route.crs, "the route")
        fit &= within_reach(places, route.line, reach_m * factor)
    return places[fit]


def _grid_slope_deg(slope_deg: float, factor: float) -> float:
    """Return the slope in the CRS of ground of a slope [deg], for a linear scale factor."""
    return (
        slope_deg if factor == 1.0 else float(np.degrees(np.arctan(np.tan(np.radians(slope_deg)) / factor)))
    )


def _quarter(places: FloatArray, area: SurveyArea) -> Any:
    """South-west 0, south-east 1, north-west 2, north-east 3."""
    xmin, ymin, xmax, ymax = area.bounds
    return 2 * (places[:, 1] >= 0.5 * (ymin + ymax)) + (places[:, 0] >= 0.5 * (xmin + xmax))


def _drawn(
    places: FloatArray, quarter: Any, n: int, *, least: int, apart_m: float, rng: np.random.Generator
) -> Any:
    """Draw places one by one, each far from those before; first the least number in every quarter."""
    free: BoolArray = np.ones(len(places), dtype=bool)
    tree = cKDTree(places)
    chosen: list[int] = []

    def take(mask: BoolArray) -> bool:
        left = np.flatnonzero(free & mask)
        if not len(left):
            return False
        index = int(rng.choice(left))
        chosen.append(index)
        free[tree.query_ball_point(places[index], apart_m * (1.0 - 1e-9))] = False
        return True

    for _ in range(least):
        if not all(take(quarter == k) for k in range(4)):
            return np.array(chosen)
    while len(chosen) < n and take(np.ones(len(places), dtype=bool)):
        pass
    return np.array(chosen)
