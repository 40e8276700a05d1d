"""The one entry: from an area and what is wanted to a route."""

from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from planners.base import swath_route
from planners.choose import choose
from planners.config import BestConfig, PlannerConfig, SteeredConfig, VarianceDrivenConfig, WavyConfig
from planners.energy import Mobility, predicted
from planners.informative import variance_driven
from planners.predict import ErrorModel, terrain_kernel
from planners.wavy import slope_length_m
from survey.area import SurveyArea
from survey.dem import Dem
from survey.errors import InputError
from survey.reconstruction.kernels import Kernel
from survey.route import Route


def plan(
    area: SurveyArea,
    prior: Dem | None,
    config: PlannerConfig,
    *,
    kernel: Kernel | None = None,
    noise_m: float = 0.1,
    sample_step_m: float = 10.0,
    mobility: Mobility | None = None,
) -> Route:
    """Plan the route of a survey.

    Parameters
    ----------
    area : SurveyArea
        What is to be surveyed.
    prior : Dem or None
        Elevations known beforehand, in the area's CRS.
    config : LawnmowerConfig, WavyConfig, PiecewiseContinuousConfig, RandomWanderConfig, VarianceDrivenConfig or BestConfig
        The pattern and its settings.
    kernel : survey.reconstruction.kernels.Kernel, optional
        Covariance of what is not yet known of the terrain. Patterns that need one fit it
        to the prior (`terrain_kernel`) when it is left out.
    noise_m, sample_step_m : float
        Standard deviation of a sample of the terrain and the distance between samples
        [m], for the predicted error.
    mobility : Mobility, optional
        How the rover drives, for the predicted time and energy.

    Returns
    -------
    Route
        With ``prediction`` of ``length_m``, ``n_turns``, ``time_s``, ``energy_j`` and
        ``transit_share``, and where a kernel is known ``rmse_m``, the error of the map.
        Slopes enter time and energy where the prior knows the whole way; else the ground
        is taken as level. The piecewise-continuous pattern and the random wander are
        steered while driving: their route holds the reference swaths, which `rollout`
        or the rover turns into a path, and no ``rmse_m``.

    Raises
    ------
    InputError
        A prior in another CRS than the area; an area that no swath meets or whose parts
        no way joins; no prior and no kernel where the pattern needs one.
    ConfigError
        A negative noise, a sample spacing that is not greater than 0.

    Examples
    --------
    >>> from planners import LawnmowerConfig
    >>> area = SurveyArea.rectangle((0.0, 0.0, 600.0, 600.0), "EPSG:32608")
    >>> route = plan(area, None, LawnmowerConfig(swaths=4))
    >>> route.length_m, route.prediction["n_turns"]
    (2850.0, 6.0)
    """
    if prior is not None:
        area.require_crs(prior.crs, "the prior")
    if kernel is None and _needs_kernel(config):
        kernel = _kernel_of(prior, area)
    model = None
    if kernel is not None:
        model = ErrorModel.of(area, kernel, noise_m=noise_m, sample_step_m=sample_step_m)
    with threadpool_limits(1):  # matrices of some hundred rows: spinning threads would only slow them down
        route = _route(area, config, model)
        facts = predicted(route.legs, mobility or Mobility(), _if_whole(prior, route))
        if model is not None and not isinstance(config, SteeredConfig):
            facts["rmse_m"] = model.rmse_m(route)
    return replace(route, prediction=facts)


def _route(area: SurveyArea, config: PlannerConfig, model: ErrorModel | None) -> Route:
    if isinstance(config, VarianceDrivenConfig | BestConfig):
        if model is None:
            raise InputError(
                f"the pattern {config.pattern} needs a covariance of the terrain; give a prior or a kernel."
            )
        if isinstance(config, BestConfig):
            return choose(area, config, model).route
        return Route(variance_driven(area, config, model), area.crs, config.pattern)
    scale_m = None if model is None else slope_length_m(model.kernel)
    return swath_route(area, config, slope_length_m=scale_m)


def _needs_kernel(config: PlannerConfig) -> bool:
    if isinstance(config, WavyConfig):
        return config.wavelength_m is None
    return isinstance(config, VarianceDrivenConfig | BestConfig)


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
