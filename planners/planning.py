"""Planning of a survey: from an area, a pattern and rovers to a route.

`plan` checks the request, finds the ground that the rover can drive on, lays the pattern of the registry over it, and
predicts length, time, energy and map error of the route. `planned_on` does the same on ground that is already found
drivable, without checks. A prior DEM need not cover the area: `prior_covered_share` is the share of the free ground on
which it has a height.
"""

import logging
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import shapely
from threadpoolctl import threadpool_limits

from planners.config import PatternConfig, in_grid_metres, settings_factor
from planners.patterns.planner import LayoutTask, Planner
from planners.prediction.assumptions import MapAssumptions
from planners.prediction.error_model import ErrorModel
from planners.registry import PLANNERS, PlannerConfig, planner_of
from planners.routes.fleet import departures
from planners.routes.rover import Crew, Fleet, Rover, crew_in_grid_metres, depots, predicted
from planners.routes.traversability import Drivable, drivable, on_free_ground
from survey import ConfigError, Dem, InputError, Route, SurveyArea
from survey.core import BoolArray, FloatArray, Progress, check_types
from survey.core.map_scale import MapScale
from survey.reconstruction.gp.kernels import Kernel

logger = logging.getLogger(__name__)

_NOTABLE_SHARE = 1e-3
"""Share of the area above which ground that is left out, or has no height, is warned of."""


@check_types
def plan(
    area: SurveyArea,
    prior: Dem | None,
    config: PlannerConfig,
    *,
    rover: Rover | None = None,
    fleet: Fleet | None = None,
    kernel: Kernel | None = None,
    noise_m: float = 0.1,
    sample_step_m: float = 10.0,
    model: ErrorModel | None = None,
    progress: Progress | None = None,
) -> Route:
    """Plan the route of a survey.

    Parameters
    ----------
    area : SurveyArea
        What is to be surveyed, and where rovers start.
    prior : Dem or None
        Elevations known beforehand, in the area's CRS; beyond them the terrain counts as unknown.
    config : LawnmowerConfig, WavyConfig, PiecewiseContinuousConfig, RandomWanderConfig, VarianceDrivenConfig or BestConfig
        The pattern and its settings, in metres on the ground.
    rover : Rover, optional
        Limits of slope and roughness, turning, and what driving takes; no metre of the route is beyond its limits.
    fleet : Fleet, optional
        How many rovers, and where they finish.
    kernel : survey.reconstruction.gp.kernels.Kernel, optional
        Known covariance of the terrain, in metres of the CRS, that is mapped without a prior.
    noise_m, sample_step_m : float
        Standard deviation of a sample and distance between samples [m], with a kernel.
    model : ErrorModel, optional
        Predictor of the map's error, in place of a kernel; that of the prior (`prior_model`) where the pattern needs one.
    progress : callable, optional
        Called with what is done, how much of it, and of how much.

    Returns
    -------
    Route
        With ``prediction``: ``length_m``, ``n_turns``, ``time_s``, ``energy_j`` and ``transit_share`` on the ground;
        ``map_scale`` (grid metres for each metre on the ground); ``left_out_share`` and ``prior_covered_share`` of the
        area; and, where a kernel or model is given, ``rmse_m`` of the complete map, which lies between ``rmse_low_m`` and
        ``rmse_high_m`` with 80 %. Slopes enter time and energy where the prior
        covers the route. Patterns that are steered while driving return their reference swaths (see `rollout`).

    Raises
    ------
    TypeError
        ``config`` is no configuration of a planner.
    InputError
        A prior in another CRS or without a height; an area that no swath meets, or on which the rover can drive
        nowhere; starts that do not fit; no prior and no kernel where they are needed.
    CapacityError
        More swaths, waypoints, cells or rovers than `planners.capacity` allows.
    ConfigError
        A negative noise, a sample spacing of 0; a pattern that the rover or the fleet cannot drive.

    Notes
    -----
    Settings are converted to grid metres where the scale factor of the CRS differs from 1 by more than 1 %, with a
    warning. ``Route.length_m`` and ``Route.spacing_m`` are grid metres. Ground that cannot be driven is left out with a warning; `drivable` returns its pieces.

    Examples
    --------
    >>> from planners import LawnmowerConfig
    >>> area = SurveyArea.rectangle((0.0, 0.0, 600.0, 600.0), "EPSG:32608")
    >>> route = plan(area, None, LawnmowerConfig(swaths=4))
    >>> route.length_m, route.prediction["n_turns"]
    (2850.0, 6.0)
    """
    planner = planner_of(config)
    crew = Crew(rover or Rover(), fleet or Fleet(), prior)
    _require_able(planner, crew)
    depots(area, crew.fleet)  # starts that do not fit the fleet are refused before any work
    facts = _map_facts(area, prior)
    site = _site(area, crew)
    route = planned_on(
        site,
        area,
        config,
        crew=crew,
        model=_known_model(area, kernel, noise_m, sample_step_m) if model is None else model,
        progress=progress,
    )
    return replace(route, prediction={**route.prediction, **facts})


def planned_on(
    site: Drivable,
    area: SurveyArea,
    config: PatternConfig,
    *,
    crew: Crew | None = None,
    model: ErrorModel | None = None,
    progress: Progress | None = None,
) -> Route:
    """Plan a route on ground that was found drivable, without checks and warnings."""
    planner, crew, factor = planner_of(config), crew or Crew(), settings_factor(area)
    if model is None and planner.needs_kernel(config):
        model = _model_of(crew.dem, area)
    task = LayoutTask(site.within(area), crew_in_grid_metres(crew, factor), model, progress)
    # Matrices of some hundred rows: spinning threads would only slow them down.
    with nullcontext() if model is None else threadpool_limits(1):
        route = on_free_ground(planner.layout(in_grid_metres(config, factor), task), area.free)
        facts = _effort(route, crew, task.crew) | {"left_out_share": site.left_out_share(area)}
        if model is not None and planner.steering is None:
            facts |= _error_facts(model, route)
    return replace(route, prediction=facts)


def _map_facts(area: SurveyArea, prior: Dem | None) -> dict[str, float]:
    """Return the map scale and the share of the area that the prior covers; warn of what is notable."""
    scale = MapScale.over(area.crs, area.bounds)
    if scale.warning:
        logger.warning("%s.", scale.warning)
    facts = {"map_scale": scale.linear.mean}
    return facts if prior is None else facts | {"prior_covered_share": require_cover(area, prior)}


def _site(area: SurveyArea, crew: Crew) -> Drivable:
    """Return where the rover can be; warn of the share of the area where it cannot."""
    site = drivable(area, crew.rover, crew.dem)
    left_out_share = site.left_out_share(area)
    if left_out_share > _NOTABLE_SHARE:
        logger.warning("%.1f %% of the area is left out: %s", min(100.0 * left_out_share, 99.9), site)
    return site


def _require_able(planner: Planner, crew: Crew) -> None:
    """Refuse patterns that this rover or fleet cannot drive."""
    if planner.is_for_fleets or crew.is_unbound:
        return
    able = ", ".join(other.name for other in PLANNERS if other.is_for_fleets)
    raise ConfigError(
        f"the pattern {planner.name} is for one rover that pivots, has no battery to watch and may finish anywhere; "
        f"choose one of {able}."
    )


def _effort(route: Route, crew: Crew, crew_on_grid: Crew) -> dict[str, float]:
    """Return what driving the route takes on the ground, waiting included."""
    waits_s = None
    if crew_on_grid.fleet.separation_m is not None:
        waits_s = departures(route.legs, crew_on_grid.rover, crew_on_grid.fleet.separation_m)
    return predicted(route.legs, crew.rover, _if_covering(crew.dem, route), waits_s=waits_s, crs=route.crs)


def _error_facts(model: ErrorModel, route: Route) -> dict[str, float]:
    """Return the expected error of the map, the bounds that it lies between with 80 %, and what its level makes of it [m]."""
    beside = model.beside_level(route)
    found = beside.with_shared(model.errors.shared_m)
    facts = {
        "rmse_m": found.rmse_m,
        "rmse_low_m": found.quantile_m(0.1),
        "rmse_high_m": found.quantile_m(0.9),
    }
    if model.level_m is None:
        return facts
    levels = beside.by_level(model.level_m)
    return {
        **facts,
        "shared_m": model.errors.shared_m,
        "prior_level_m": model.level_m,
        "prior_level_share": levels["prior"].shared_share,
        **{f"rmse_{name}_level_m": one.rmse_m for name, one in levels.items()},
    }


def _known_model(
    area: SurveyArea, kernel: Kernel | None, noise_m: float, sample_step_m: float
) -> ErrorModel | None:
    """Return the model of a known covariance, if one is given."""
    if kernel is None:
        return None
    step_m = settings_factor(area) * sample_step_m
    return ErrorModel.of(area, kernel, noise_m=noise_m, sample_step_m=step_m)


def _model_of(prior: Dem | None, area: SurveyArea) -> ErrorModel:
    if prior is None:
        raise InputError(
            "this pattern needs a covariance of the terrain; give a prior DEM, a kernel or (for wavy swaths) a wavelength."
        )
    return ErrorModel.from_prior(area, prior)


def _if_covering(prior: Dem | None, route: Route) -> Dem | None:
    """Return the prior if it has a height everywhere along the route."""
    if prior is None or not shapely.box(*prior.bounds).covers(route.line):
        return None
    paths = [route.sample(0.5 * prior.step_m, rover).xy for rover in range(route.n_rovers)]
    ends = [leg.xy for leg in route.legs]
    return prior if np.isfinite(prior.at(np.vstack(paths + ends))).all() else None


_N_ALONG = 64


def prior_model(prior: Dem, area: SurveyArea, assumed: MapAssumptions | None = None) -> ErrorModel | None:
    """Return the predictor of errors of maps with a prior; None where it lies off the area, which `plan` refuses.

    Parameters
    ----------
    prior : Dem
        Coarse elevations.
    area : SurveyArea
        Area of the survey.
    assumed : MapAssumptions, optional
        Errors of samples and prior, and the class of surface.

    Returns
    -------
    ErrorModel or None
        Predicts the distribution of a map's error for any route.

    Raises
    ------
    InputError
        A prior that is too coarse for the area.
    """
    return None if prior_covered_share(area, prior) == 0.0 else ErrorModel.from_prior(area, prior, assumed)


def prior_covered_share(area: SurveyArea, prior: Dem) -> float:
    """Return the share of the area's free ground that lies on cells with a height.

    Returns: between 0 and 1, from 64 places along the longer side of the area.

    >>> from survey.data.grid import Grid
    >>> dem = Dem.on(Grid((5.0, 5.0, 45.0, 95.0), 10.0, "EPSG:32608"), np.zeros((10, 5)))
    >>> prior_covered_share(SurveyArea.rectangle((0.0, 0.0, 100.0, 100.0), "EPSG:32608"), dem)
    0.5
    """
    area.require_crs(prior.crs, "the prior")
    share = float(_has_height(prior, _places(area)).mean())
    return share if share > 0.0 else _small_share(area, prior)


def require_cover(area: SurveyArea, prior: Dem) -> float:
    """Return the covered share; warn where some of the area has no height, refuse where all of it has none."""
    share = prior_covered_share(area, prior)
    if share == 0.0:
        inner, outer = (tuple(round(b, 1) for b in bounds) for bounds in (area.bounds, prior.bounds))
        raise InputError(
            f"the prior has no height on the area: the area's bounds are {inner} and those of the prior {outer}; "
            "give a prior that covers the area, or none."
        )
    if share < 1.0 - _NOTABLE_SHARE:
        logger.warning(
            "the prior covers %.1f %% of the area; the terrain of the rest counts as unknown.", 100.0 * share
        )
    return share


def _cell_centres(area: SurveyArea, n_along: int) -> FloatArray:
    """Return the centres of square cells on the free ground.

    Returns (M, 2): easting and northing [m].

    >>> _cell_centres(SurveyArea.rectangle((0.0, 0.0, 20.0, 10.0), "EPSG:32608"), 2).tolist()
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
        return _cell_centres(area, _N_ALONG)
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
