"""One statistical survey, mapped with every kind of prior, by the estimator and by an oracle."""

import time
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from scipy.special import ndtr

import planners
from benchmarks.honesty.priors import KINDS as PRIORS
from benchmarks.honesty.priors import prior
from benchmarks.honesty.terrains import CRS, KINDS, SIDE_M, terrain
from benchmarks.mismatched import mismatched
from planners import LawnmowerConfig
from sim.config.mission import MissionConfig, SensorConfig
from sim.config.world import RandomTerrain
from sim.simulate.simulation import simulate_statistical
from survey.core.arrays import FloatArray, IntArray
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.data.recording import Recording
from survey.data.surface_points import SurfacePoints
from survey.reconstruction import GaussianProcessConfig
from survey.reconstruction.gp.config import JointConfig
from survey.reconstruction.gp.marginal_likelihood import Hyperparameters, likeliest
from survey.reconstruction.joint.joint_map import JointTerrain
from survey.reconstruction.joint.kernel_choice import PointsOnly
from survey.reconstruction.joint.shared_errors import SharedError
from survey.reconstruction.joint.solution import checked_map
from survey.reconstruction.prior import SatelliteErrors
from vision_slam import LocalizationConfig, localize

AREA = SurveyArea.rectangle((0.0, 0.0, SIDE_M, SIDE_M), CRS)
NODES = Grid((4.0, 4.0, SIDE_M - 4.0, SIDE_M - 4.0), 8.0, CRS)
TAUS_S = (60.0, 120.0, 300.0, 600.0, 900.0)
ASSUMED_TAU_S = 120.0
FIRST_SEED = 7101
NO_PRIOR, NAME_BEFORE = "no prior", "isotropic, by points alone"
NAME_MISMATCHED, PRIOR_MISMATCHED = "all together, other sensors", "all together"
"""Maps whose estimator assumes errors of the sensors that are wrong by factors of up to two."""
BEFORE = ("anisotropic ridges", "moraine ridges", "SRTM windows")
"""Kinds of terrain that are mapped as before anisotropic kernels, too."""
CANDIDATES_BEFORE = ("matern-3/2", "two-scale-matern", "two-scale-mixed", "three-scale")
CLASS_3_M = 0.4572
_PROBABILITIES = np.linspace(0.1, 0.9, 9)
MEMORY_MB, TOLERANCE_M, NODE_SPACING_M = 6.0, 5e-3, 30.0
_LANDMARKS_PER_M = 0.25
_N_BEFORE, _ORACLE_EVERY, _MISMATCHED_EVERY = 4, 3, 6
_TESTED = (NO_PRIOR, "truthful", "all together")


@dataclass(frozen=True)
class Outcome:
    """Errors of one map: RMSE and its claim [m], coverage of 95 %, nodes in each tenth of the probability integral.

    ``found`` is the record of the map, in which a certificate stands where there is one.
    """

    prior: str
    is_oracle: bool
    rmse_m: float
    claimed_m: float
    offset_m: float
    coverage: float
    tenths: list[float]
    cpu_s: float
    found: dict[str, Any]
    landmarks: int
    kernel_cpu_s: float = 0.0


def survey_of(kind: str, seed: int) -> list[dict[str, Any]]:
    """Survey a terrain once, and return the outcomes of all its maps as plain facts."""
    real, mission, recording = recorded(kind, seed)
    tau_s = mission.sensors.gps_correlation_time_s
    ordinary = _Localized.of(recording, mission, ASSUMED_TAU_S)
    start = time.process_time()
    fitted = ordinary.fitted()
    seconds = time.process_time() - start
    outcomes = [replace(_mapped(ordinary, fitted, real, NO_PRIOR), kernel_cpu_s=seconds)]
    if kind in BEFORE and seed - FIRST_SEED < _N_BEFORE:
        outcomes.append(_before(ordinary, real, prior("truthful", real, kind, seed)))
    for name, what in PRIORS.items():
        cells = prior(name, real, kind, seed)
        outcomes.append(_mapped(ordinary, fitted, real, name, cells=cells, errors=what.assumed(seed)))
    turn = seed + KINDS.index(kind)
    if turn % _MISMATCHED_EVERY == 1:
        outcomes.append(_mismatched(mission, real, kind, seed))
    if turn % _ORACLE_EVERY == 0:
        oracle = _Localized.of(recording, mission, tau_s)
        outcomes += _of_oracle(oracle, oracle.fitted(fitted.candidates), real, kind, seed)
    return [asdict(one) | {"terrain": kind, "seed": seed, "tau_s": tau_s} for one in outcomes]


def recorded(kind: str, seed: int) -> tuple[Dem, MissionConfig, Recording]:
    """Return a terrain, the mission that surveys it, and its recording."""
    real = terrain(kind, seed)
    tau_s = TAUS_S[(seed + KINDS.index(kind)) % len(TAUS_S)]
    mission = _mission(100 * seed + KINDS.index(kind), tau_s)
    recording, _ = simulate_statistical(real, planners.plan(AREA, None, mission.planner), mission)
    return real, mission, recording


def _mismatched(mission: MissionConfig, real: Dem, kind: str, seed: int) -> Outcome:
    """Survey with the same errors, of which other sizes are assumed and claimed, and map with a bad prior."""
    other = mismatched(mission, seed)
    recording, _ = simulate_statistical(real, planners.plan(AREA, None, other.planner), other)
    localized = _Localized.of(recording, other, ASSUMED_TAU_S)
    cells, errors = prior(PRIOR_MISMATCHED, real, kind, seed), PRIORS[PRIOR_MISMATCHED].assumed(seed)
    return _mapped(localized, localized.fitted(), real, NAME_MISMATCHED, cells=cells, errors=errors)


def _of_oracle(oracle: "_Localized", fitted: PointsOnly, real: Dem, kind: str, seed: int) -> list[Outcome]:
    """Map with every kind of prior by its error model."""
    return [
        _mapped(
            oracle,
            fitted,
            real,
            name,
            cells=prior(name, real, kind, seed),
            errors=what.oracle,
            is_oracle=True,
        )
        for name, what in PRIORS.items()
        if what.reference == name
    ]


@dataclass(frozen=True)
class _Localized:
    """Landmarks and path of one survey, and the joint map of them without a prior."""

    points: SurfacePoints
    model: JointTerrain

    @classmethod
    def of(cls, recording: Recording, mission: MissionConfig, tau_s: float) -> "_Localized":
        """Localize with an assumed memory of the receiver's errors."""
        found = localize(recording, mission.assumed.model_copy(update={"gps_correlation_time_s": tau_s}))
        assert found.trajectory.error is not None
        config = GaussianProcessConfig(tolerance_m=TOLERANCE_M)
        return cls(found.points, JointTerrain(found.trajectory.error, None, config, _joint(None)))

    def fitted(self, candidates: list[Hyperparameters] | None = None) -> PointsOnly:
        """Fit kernels to the points, or take those that are given."""
        if candidates is None:
            return self.model.from_points(self.points, NODES.bounds)
        return self.model.from_points(self.points, NODES.bounds, candidates)


def _mission(seed: int, tau_s: float) -> MissionConfig:
    return MissionConfig(
        schema_version=1,
        name="honesty",
        seed=seed,
        terrain=RandomTerrain(source="random"),
        planner=LawnmowerConfig(swaths=4),
        sensors=SensorConfig(gps_correlation_time_s=tau_s, landmarks_per_m=_LANDMARKS_PER_M),
        localization=LocalizationConfig(node_spacing_m=NODE_SPACING_M),
    )


def _joint(errors: SatelliteErrors | None) -> JointConfig:
    stated = {} if errors is None else {"satellite": errors}
    return JointConfig(**stated, slope_passes=1, memory_mb=MEMORY_MB)


def _mapped(
    localized: _Localized,
    fitted: PointsOnly,
    real: Dem,
    name: str,
    *,
    cells: Dem | None = None,
    errors: SatelliteErrors | None = None,
    is_oracle: bool = False,
) -> Outcome:
    start = time.process_time()
    solution = replace(localized.model, satellite=cells, joint=_joint(errors)).complete(fitted)
    found = checked_map(solution, NODES, None, is_tested=name in _TESTED and not is_oracle)
    seconds = time.process_time() - start
    result = found.reconstruction
    mean, std = result.mean.elevation, result.std.elevation
    error = mean - real.at(NODES.xy).reshape(NODES.shape)
    share = ndtr(error / std)
    return Outcome(
        name,
        is_oracle,
        float(np.sqrt(np.mean(error**2))),
        float(np.sqrt(np.mean(std**2))),
        float(error.mean()),
        float(np.mean(np.abs(share - 0.5) <= 0.475)),
        np.diff(np.searchsorted(np.sort(share.ravel()), [0.0, *_PROBABILITIES, 1.0])).tolist(),
        seconds,
        {**result.hyperparameters, **result.diagnostics},
        len(localized.points),
    )


def _before(localized: _Localized, real: Dem, cells: Dem) -> Outcome:
    """Map with an isotropic kernel that the points alone choose, and cells of independent errors."""
    points, model = localized.points, localized.model
    assert points.own_covariance is not None
    plane = np.column_stack([np.ones(len(points)), points.xy])
    residual = points.z - plane @ np.linalg.lstsq(plane, points.z, rcond=None)[0]
    rows = SharedError.full(points, model.path, np.zeros((len(points), 2))).rows

    def shared(part: IntArray) -> FloatArray:
        return model.path.covariance(rows[part])

    noise_m2 = points.own_covariance[:, 2, 2]
    start = time.process_time()
    found = likeliest(points.xy, residual, noise_m2, model.config, shared, candidates=CANDIDATES_BEFORE)
    seconds = time.process_time() - start
    white = SatelliteErrors(product="unbiased")
    outcome = _mapped(localized, localized.fitted([found]), real, NAME_BEFORE, cells=cells, errors=white)
    return replace(outcome, kernel_cpu_s=seconds)
