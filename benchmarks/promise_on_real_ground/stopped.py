"""Adaptive surveys of random terrain that are looked at after every swath and stop by themselves."""

from dataclasses import dataclass

import numpy as np

from benchmarks.promise_on_real_ground.surveys import SHARED_M, STEP_M, map_error_m
from benchmarks.promise_on_real_ground.windows import SEED, Site
from planners.guarantee.adaptive import AdaptiveConfig, survey_adaptively
from planners.guarantee.guarantee import posterior_of
from planners.guarantee.requirement import MapRequirement
from survey import Grid, SurveyArea
from survey.core.arrays import FloatArray
from survey.core.streams import stream
from survey.terrain import random_dem, satellite_copy

ASKED = 0.95
_SIDE_M = 200.0
_CRS = "EPSG:32608"
_KINDS = (("squared-exponential", 47.0), ("matern-5/2", 60.0), ("matern-3/2", 100.0))
_NOISES_M = (0.05, 0.1, 0.2)


@dataclass(frozen=True)
class Stopped:
    """Whether a survey stopped by its rule, and the error of its map [m]."""

    stopped: bool
    rmse_m: float
    n_swaths: int


def stopped(index: int) -> Stopped:
    """Survey one random terrain until the rule stops it, and judge the map against Class 3."""
    site, noise_m = _site(index), _NOISES_M[index % len(_NOISES_M)]
    wanted = MapRequirement(
        site.limit_m, ASKED, noise_m=noise_m, shared_m=SHARED_M, sample_step_m=STEP_M, prior_sigma_m=0.5
    )
    rng = stream(SEED, "stopped", "noise", index)
    shared_m = SHARED_M * rng.standard_normal()
    heights: list[FloatArray] = []

    def drive(xy: FloatArray) -> FloatArray:
        heights.append(site.terrain.at(xy) + noise_m * rng.standard_normal(len(xy)) + shared_m)
        return heights[-1]

    posterior = posterior_of(site.area, site.prior, wanted)
    made = survey_adaptively(site.area, posterior, AdaptiveConfig.of(wanted), drive)
    if not made.holds or made.route is None:
        return Stopped(False, float("inf"), 0)
    error_m = map_error_m(site, made.samples, np.concatenate(heights), noise_m)
    return Stopped(True, error_m, len(made.route.swaths))


def _site(index: int) -> Site:
    """Return random terrain with a prior of 40 m cells."""
    family, length_m = _KINDS[index // len(_NOISES_M) % len(_KINDS)]
    grid = Grid((0.0, 0.0, _SIDE_M, _SIDE_M), 5.0, _CRS)
    terrain = random_dem(family, grid, stream(SEED, "stopped", index), 10.0, length_scale_m=length_m)
    prior = satellite_copy(terrain, rng=stream(SEED, "stopped", "prior", index), cell_m=40.0, sigma_m=0.5)
    return Site(terrain, SurveyArea.rectangle((0.0, 0.0, _SIDE_M, _SIDE_M), _CRS), prior, 0.4572)
