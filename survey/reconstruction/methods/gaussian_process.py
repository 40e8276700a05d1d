"""Gaussian processes with independent errors: the Fourier engine (gp) and the dense one (dense)."""

from dataclasses import replace
from functools import partial
from typing import Any

from survey.core.crs.agreement import same_crs
from survey.core.crs.vertical_datum import same_vertical_datum
from survey.data.dem import Dem
from survey.reconstruction.base import ELEVATION
from survey.reconstruction.beyond_points import widened_beyond
from survey.reconstruction.capacity import require_length_scale
from survey.reconstruction.gp.config import GaussianProcessConfig, JointConfig
from survey.reconstruction.gp.mean import Mean
from survey.reconstruction.gp.process import EngineName
from survey.reconstruction.method import (
    MappedTerrain,
    MappingTask,
    ReconstructionMethod,
    ScanSettings,
    config_of,
)


def check_length_scale(settings: ScanSettings) -> None:
    """Refuse stated length scales far below the step of the map."""
    if settings.step_m is not None:
        config = config_of(settings.configs, GaussianProcessConfig)
        require_length_scale(config.stated_length_m, settings.step_m)


def _run(task: MappingTask, *, engine: EngineName) -> MappedTerrain:
    from survey.reconstruction.gp.claimed_error import with_claim
    from survey.reconstruction.gp.gp_terrain import GaussianProcessTerrain
    from survey.reconstruction.gp.progress.map_watch import MapWatch

    config, prior, facts = _with_estimated_prior(task)
    watch = MapWatch(task.grid, task.progress)
    model = GaussianProcessTerrain(config, prior, engine, task.quantity, task.grid.bounds, watch)
    fitted = model.fit(task.points)
    assert fitted.learned_ is not None
    result = fitted.grid(task.grid)
    if config.fit and prior is None:
        data = fitted.learned_.process.data
        result = widened_beyond(result, data.xy, data.values, task.area)
    result = with_claim(result, fitted.learned_, task.area)
    return MappedTerrain(replace(result, diagnostics={**result.diagnostics, **facts}))


def _with_estimated_prior(
    task: MappingTask,
) -> tuple[GaussianProcessConfig, Dem | Mean | None, dict[str, Any]]:
    """Return the settings, the prior less its estimated errors, and their record; a stated kernel takes a prior as exact."""
    from survey.reconstruction.gp.estimated_prior import estimated_prior

    config, errors = task.config(GaussianProcessConfig), task.config(JointConfig).satellite
    prior = task.prior
    if (
        not isinstance(prior, Dem)
        or not config.fit
        or errors.product == "unbiased"
        or task.quantity != ELEVATION
    ):
        return config, prior, {}
    same_crs(prior.crs, task.points.crs, "the prior and the points")
    same_vertical_datum(prior.vertical_datum, task.points.vertical_datum, "the prior and the points")
    estimated = estimated_prior(prior, task.points, errors.model())
    return config.model_copy(update={"prior_level": "estimated"}), estimated.dem, estimated.facts


GP = ReconstructionMethod(
    "gp",
    "Gaussian process in Fourier waves, in tiles where the site is large",
    partial(_run, engine="gp"),
    {"gp": GaussianProcessConfig, "joint": JointConfig},
    maps_values=True,
    check=check_length_scale,
)
DENSE = ReconstructionMethod(
    "dense",
    "exact Gaussian process by one dense factorization, for some thousand points",
    partial(_run, engine="dense"),
    {"gp": GaussianProcessConfig, "joint": JointConfig},
    maps_values=True,
    check=check_length_scale,
)
