"""The one entry: from an area and what is wanted to a route."""

import logging
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from planners.config import PatternConfig
from planners.driving.energy import predicted
from planners.driving.fleet import departures
from planners.driving.rover import Crew, Fleet, Rover, depots
from planners.ground.traversability import Drivable, drivable
from planners.patterns.planner import LayoutTask, Planner
from planners.prediction.predict import ErrorModel, terrain_kernel
from planners.registry import PLANNERS, planner_of
from survey.core.arguments import check_types
from survey.core.arrays import Progress
from survey.core.errors import ConfigError, InputError
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.route import Route
from survey.reconstruction.gp.covariance.kernels import Kernel

logger = logging.getLogger(__name__)

_LEAST_TOLD = 1e-3
"""Share of the area below which ground that is left out is not worth a warning."""


@check_types
def plan(
    area: SurveyArea,
    prior: Dem | None,
    config: PatternConfig,
    *,
    rover: Rover | None = None,
    fleet: Fleet | None = None,
    kernel: Kernel | None = None,
    noise_m: float = 0.1,
    sample_step_m: float = 10.0,
    progress: Progress | None = None,
) -> Route:
    """Plan the route of a survey.

    Parameters
    ----------
    area : SurveyArea
        What is to be surveyed, and where rovers start.
    prior : Dem or None
        Elevations known beforehand, in the area's CRS.
    config : LawnmowerConfig, WavyConfig, PiecewiseContinuousConfig, RandomWanderConfig, VarianceDrivenConfig or BestConfig
        The pattern and its settings.
    rover : Rover, optional
        What the rover can stand, how it turns and what driving takes. No metre of the
        route lies on ground of the prior that is too steep or too rough for it.
    fleet : Fleet, optional
        How many rovers, and where they finish.
    kernel : survey.reconstruction.gp.kernels.Kernel, optional
        Covariance of what is not yet known of the terrain. Patterns that need one fit it
        to the prior (`terrain_kernel`) when it is left out.
    noise_m, sample_step_m : float
        Standard deviation of a sample of the terrain and the distance between samples
        [m], for the predicted error.
    progress : callable, optional
        Told what is done, how much of it, and of how much.

    Returns
    -------
    Route
        With ``prediction`` of ``length_m``, ``n_turns``, ``time_s``, ``energy_j`` and
        ``transit_share``, ``left_out_share`` of the area where no rover can be, and where
        a kernel is known ``rmse_m``, the error of the map over the whole area. Slopes
        enter time and energy where the prior knows the whole way; else the ground is
        taken as level. The piecewise-continuous pattern and the random wander are
        steered while driving: their route holds the reference swaths, which `rollout`
        or the rover turns into a path, and no ``rmse_m``.

    Raises
    ------
    InputError
        A prior in another CRS than the area; an area that no swath meets or on which the
        rover can drive nowhere; a start where it cannot be; starts that do not fit the
        fleet; no prior and no kernel where they are needed.
    ConfigError
        A negative noise, a sample spacing that is not greater than 0; a pattern that the
        rover or the fleet cannot drive.

    Notes
    -----
    Ground that is too steep, too rough, too narrow or cut off from every start is left
    out; a warning is logged with its share, and with place and reason of its largest
    pieces. `drivable` returns all of them.

    Examples
    --------
    >>> from planners import LawnmowerConfig
    >>> area = SurveyArea.rectangle((0.0, 0.0, 600.0, 600.0), "EPSG:32608")
    >>> route = plan(area, None, LawnmowerConfig(swaths=4))
    >>> route.length_m, route.prediction["n_turns"]
    (2850.0, 6.0)
    """
    crew = Crew(rover or Rover(), fleet or Fleet(), prior)
    planner = planner_of(config)
    _require_able(planner, crew)
    depots(area, crew.fleet)  # starts that do not fit the fleet are refused before any work
    if prior is not None:
        area.require_crs(prior.crs, "the prior")
    if kernel is None and planner.needs_kernel(config):
        kernel = _kernel_of(prior, area)
    model = None
    if kernel is not None:
        model = ErrorModel.of(area, kernel, noise_m=noise_m, sample_step_m=sample_step_m)
    site, left_out_share = _site(area, crew)
    # Matrices of some hundred rows: spinning threads would only slow them down.
    with nullcontext() if model is None else threadpool_limits(1):
        route = planner.layout(config, LayoutTask(site.within(area), crew, model, progress))
        facts = _facts(route, crew) | {"left_out_share": left_out_share}
        if model is not None and planner.steering is None:
            facts["rmse_m"] = model.rmse_m(route)
    return replace(route, prediction=facts)


def _site(area: SurveyArea, crew: Crew) -> tuple[Drivable, float]:
    """Return where the rover can be, and the share of the area where it cannot, which is told."""
    site = drivable(area, crew.rover, crew.dem)
    left_out_share = site.left_out_share(area)
    if left_out_share > _LEAST_TOLD:
        logger.warning("%.1f %% of the area is left out: %s", min(100.0 * left_out_share, 99.9), site)
    return site, left_out_share


def _require_able(planner: Planner, crew: Crew) -> None:
    """Refuse patterns that this rover or fleet cannot drive."""
    if planner.is_for_fleets or crew.is_unbound:
        return
    able = ", ".join(other.name for other in PLANNERS if other.is_for_fleets)
    raise ConfigError(
        f"the pattern {planner.name} is for one rover that pivots, has no battery to watch and may finish anywhere; "
        f"choose one of {able}."
    )


def _facts(route: Route, crew: Crew) -> dict[str, float]:
    """Return what driving the route takes, waiting included."""
    separation_m = crew.fleet.separation_m
    waits_s = None if separation_m is None else departures(route.legs, crew.rover, separation_m)
    return predicted(route.legs, crew.rover, _if_whole(crew.dem, route), waits_s=waits_s)


def _kernel_of(prior: Dem | None, area: SurveyArea) -> Kernel:
    if prior is None:
        raise InputError(
            "this pattern needs to know how the terrain varies; give a prior DEM, a kernel or (for wavy swaths) a wavelength."
        )
    return terrain_kernel(prior, area)


def _if_whole(prior: Dem | None, route: Route) -> Dem | None:
    """Return the prior if it has a height everywhere along the route."""
    if prior is None:
        return None
    paths = [route.sample(0.5 * prior.step_m, rover).xy for rover in range(route.n_rovers)]
    ends = [leg.xy for leg in route.legs]
    return prior if np.isfinite(prior.at(np.vstack(paths + ends))).all() else None
