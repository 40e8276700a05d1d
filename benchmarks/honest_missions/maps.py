"""Maps of one mission in images with every kind of prior, with stakes and without."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from benchmarks.honest_missions.missions import (
    PRODUCT,
    ending_of,
    mission_of,
    real_prior,
    survey_of,
    without_stakes,
)
from benchmarks.image_surveys import Survey
from benchmarks.report import cpu_seconds
from survey.data.dem import Dem
from survey.reconstruction.checks import PredictiveScores
from survey.reconstruction.gp.config import JointConfig
from survey.reconstruction.joint.joint_map import JointTerrain
from survey.reconstruction.joint.solution import JointSolution, checked_map, held_out_swaths
from survey.reconstruction.prior import SatelliteErrors
from survey.reconstruction.terrain_map import CLAIM, Reconstruction
from survey.scoring import certificate
from vision_slam import localize
from vision_slam.drive_estimate import Localization

UNBIASED, REAL, NONE = "unbiased prior, stated so", f"prior with the errors of {PRODUCT}", "no prior"
PRIORS = (UNBIASED, REAL, NONE)
_FAR_M = 5.0


@dataclass(frozen=True)
class Outcome:
    """Error, claim and coverage of one map [m], its certificates, and its swaths left out beyond 5 m of other points.

    ``offset_sigma_m`` is the stated standard deviation of the map's level [m], ``kernel_s`` the CPU time of the fit of the
    kernels [s].
    """

    rmse_m: float
    claimed_m: float
    offset_m: float
    offset_sigma_m: float
    coverage: float
    n_certified: int
    n_false: int
    contradicts: bool
    n_far: int
    far_coverage: float
    landmarks: int
    kernel_s: float


def outcomes_of(pattern: str, seed: int) -> list[dict[str, Any]]:
    """Localize a mission with stakes and without, map it with every prior, and return the outcomes as plain facts."""
    survey, ending = survey_of(pattern, seed), ending_of(pattern, seed)
    cells = {UNBIASED: survey.prior, REAL: real_prior(pattern, seed), NONE: None}
    classes = {UNBIASED: "unbiased", REAL: PRODUCT, NONE: "unknown"}
    found = []
    for n_stakes, one in ((4, survey), (0, without_stakes(survey))):
        localized = localize(one.recording, mission_of(pattern, seed).localization, visual=one.found)
        for prior, solution, kernel_s in _solutions(localized, one, cells, classes):
            named = {"pattern": pattern, "seed": seed, "ending": ending, "prior": prior, "n_stakes": n_stakes}
            found.append(named | asdict(_judged(solution, one, kernel_s)))
    return found


def _solutions(
    localized: Localization, survey: Survey, cells: dict[str, Dem | None], classes: dict[str, str]
) -> Iterator[tuple[str, JointSolution, float]]:
    """Yield the joint estimate for every prior, and the CPU time of the fit of kernels, which is done once."""
    assert localized.trajectory.error is not None
    model, points = JointTerrain(localized.trajectory.error), localized.points
    fitted, kernel_s = cpu_seconds(lambda: model.from_points(points, survey.nodes.bounds))
    for prior, dem in cells.items():
        joint = JointConfig(satellite=SatelliteErrors(product=classes[prior]))
        yield prior, replace(model, satellite=dem, joint=joint).complete(fitted), kernel_s


def _judged(solution: JointSolution, survey: Survey, kernel_s: float) -> Outcome:
    result = checked_map(solution, survey.nodes, None, is_tested=True).reconstruction
    error = result.mean.elevation - survey.real.dem.at(survey.nodes.xy).reshape(survey.nodes.shape)
    rmse, relative = float(np.sqrt(np.mean(error**2))), float(error.std())
    n_certified, n_false = _certificates(result, rmse, relative)
    far = _far_scores(solution)
    return Outcome(
        rmse,
        float(np.sqrt(np.mean(result.std.elevation**2))),
        float(error.mean()),
        float(result.diagnostics[CLAIM]["offset_sigma_m"]),
        float(np.mean(np.abs(error) <= 1.959964 * result.std.elevation)),
        n_certified,
        n_false,
        result.check is not None and result.check.contradicts,
        far.n,
        far.coverage_95,
        len(solution.points),
        kernel_s,
    )


def _certificates(result: Reconstruction, rmse_m: float, relative_m: float) -> tuple[int, int]:
    """Count the classes that a map states with a probability of 95 %, and those of them that it does not meet."""
    certified = certificate(result)
    assert certified is not None
    claims = [(rmse_m, verdict) for verdict in certified.absolute if verdict.met]
    claims += [(relative_m, verdict) for verdict in certified.relative if verdict.met]
    return len(claims), sum(value > verdict.limit_m for value, verdict in claims)


def _far_scores(solution: JointSolution) -> PredictiveScores:
    """Score points of swaths left out that lie more than 5 m from all others."""
    held_out = held_out_swaths(solution)
    assert held_out is not None
    far = held_out.distance_m > _FAR_M
    return PredictiveScores.of(held_out.error_m[far], held_out.sigma_m[far])
