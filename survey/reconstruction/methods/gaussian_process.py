"""Gaussian processes: the Fourier engine (gp), the dense one (dense), and map and path as one estimate (joint).

With gp and dense the points have independent errors; with joint they share the errors of the poses they were seen from.
A map from points alone gets larger standard deviations far beyond them, and a fitted map around a prior subtracts the
prior's estimated errors first. Every map that was not divided into tiles claims the posterior of its error.
"""

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from survey.core import InputError
from survey.data import Dem, SurveyArea
from survey.reconstruction.beyond_points import widened_beyond
from survey.reconstruction.capacity import require_length_scale
from survey.reconstruction.checks import RmseClaim, sampled_nodes
from survey.reconstruction.gp.config import GaussianProcessConfig, JointConfig
from survey.reconstruction.gp.mean import Mean, estimated_prior
from survey.reconstruction.method import MappedTerrain, MappingTask, ReconstructionMethod, ScanSettings
from survey.reconstruction.prior import PriorErrors
from survey.reconstruction.terrain_map import BEYOND, CLAIM, ELEVATION, Reconstruction

if TYPE_CHECKING:
    from survey.reconstruction.gp.engine_choice import EngineName
    from survey.reconstruction.gp.fit import Learned


def check_length_scale(settings: ScanSettings) -> None:
    """Refuse stated length scales far below the step of the map."""
    if settings.step_m is not None:
        config = settings.configs.get(GaussianProcessConfig)
        require_length_scale(config.stated_length_m, settings.step_m)


def _run(task: MappingTask, *, engine: "EngineName") -> MappedTerrain:
    from survey.reconstruction.gp.engine_choice import DividedSiteError
    from survey.reconstruction.gp.gp_terrain import GaussianProcessTerrain, MapWatch

    config, errors, facts = task.config(GaussianProcessConfig), _prior_errors(task), {}
    watch = MapWatch(task.grid, task.progress)
    prior = task.prior
    model = GaussianProcessTerrain(
        config, prior, engine, task.quantity, task.grid.bounds, watch, errors=errors
    )
    try:
        fitted = model.fit(task.points)
    except DividedSiteError:
        # Cells as measurements need one solve for the site; the map in parts is built around the corrected prior.
        assert errors is not None
        assert isinstance(prior, Dem)
        estimated = estimated_prior(prior, task.points, errors)
        prior, facts = estimated.dem, estimated.facts
        config = config.model_copy(update={"prior_level": "estimated"})
        model = GaussianProcessTerrain(config, prior, engine, task.quantity, task.grid.bounds, watch)
        fitted = model.fit(task.points)
    assert fitted.learned_ is not None
    result = fitted.grid(task.grid)
    if config.fit and prior is None:
        data = fitted.learned_.process.data
        result = widened_beyond(result, data.xy, data.values, task.area)
    result = with_claim(result, fitted.learned_, task.area)
    return MappedTerrain(replace(result, diagnostics={**result.diagnostics, **facts}))


def _prior_errors(task: MappingTask) -> PriorErrors | None:
    """Return the error model of a prior whose cells are measurements; a stated kernel takes a prior as exact."""
    config, errors = task.config(GaussianProcessConfig), task.config(JointConfig).satellite
    is_exact = not config.fit or errors.product == "unbiased" or task.quantity != ELEVATION
    return errors.model() if isinstance(task.prior, Dem) and not is_exact else None


def with_claim(result: Reconstruction, learned: "Learned", area: SurveyArea | None) -> Reconstruction:
    """Return a map with the posterior of its error in the record; maps in tiles have no joint covariance, and none."""
    grid, std = result.mean.grid(), result.std.elevation
    inside = np.isfinite(std)
    if area is not None:
        inside &= area.contains(grid.xy).reshape(grid.shape)
    if learned.process.divides_site or not inside.any():
        return result
    rows = sampled_nodes(inside)
    covariance = learned.process.joint_covariance(grid.xy[rows])
    covariance[np.diag_indices(len(rows))] += learned.hyperparameters.nugget_m**2
    untested_share = result.diagnostics.get(BEYOND, {}).get("share", 0.0)
    claim = replace(RmseClaim.of(covariance, std.ravel()[rows]), untested_share=untested_share)
    return replace(result, diagnostics={**result.diagnostics, CLAIM: claim.facts()})


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


def _run_joint(task: MappingTask) -> MappedTerrain:
    from survey.reconstruction.joint.joint_map import JointTerrain

    if task.path is None:
        raise InputError(
            "the joint map needs the error that the points share through their path, and none was given; give a "
            "trajectory with its .error.npz (`path=trajectory.error`), or take the method gp."
        )
    if isinstance(task.prior, Mean):
        raise InputError(
            f"the joint map takes a prior's cells as measurements, and a {type(task.prior).__name__} has none; "
            "give the prior as a Dem or leave it out."
        )
    model = JointTerrain(task.path, task.prior, task.config(GaussianProcessConfig), task.config(JointConfig))
    made = model.map(task.points, task.grid, task.area)
    return MappedTerrain(made.reconstruction, made.correction, solution=made.solution)


JOINT = ReconstructionMethod(
    "joint",
    "Gaussian process and path as one estimate",
    _run_joint,
    {"gp": GaussianProcessConfig, "joint": JointConfig},
    needs_path=True,
    check=check_length_scale,
)
