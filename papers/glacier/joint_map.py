"""Comparison of joint with separate estimates of map and path: surveys of 2.7 km with correlated receiver errors.

The site is 600 × 600 m with 25 m of relief: a plane, a squared exponential of 140 m and 3 m,
one of 55 m and 0.5 m, and micro-relief of 4 m and 0.15 m. Four swaths, GPS of 3 m that stays
wrong for minutes and 1 m of white noise, visual odometry with 0.5° of heading, 0.4° of tilt
and 1.2 % of scale error, landmarks up to 25 m to either side, satellite cells of 75 m ± 1 m.
"""

import csv
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np

import planners
from planners import LawnmowerConfig
from planners.routes.replanning import with_way_home
from sim.config.mission import AidsConfig, MissionConfig, SensorConfig
from sim.config.world import RandomTerrain
from sim.simulate.simulation import simulate_statistical
from survey import Dem, Grid, SurveyArea, Trajectory
from survey.core import FloatArray, Progress, projected_crs, stream
from survey.data.sensors.odometry import Sightings
from survey.reconstruction import GaussianProcessConfig, Reconstruction, reconstruct
from survey.reconstruction.gp.config import JointConfig
from survey.reconstruction.gp.kernels import SquaredExponential
from survey.reconstruction.joint.joint_map import JointTerrain
from survey.reconstruction.joint.solution import JointMap
from survey.reconstruction.prior import SatelliteErrors
from survey.terrain import satellite_copy
from survey.terrain.random_fields import kernel_field
from vision_slam import LocalizationConfig, localize

CRS = projected_crs("EPSG:32608", "the study")
SIDE_M, RELIEF_M, MICRO_RELIEF_M = 600.0, 25.0, 0.15
AREA = SurveyArea.rectangle((0.0, 0.0, SIDE_M, SIDE_M), CRS)
NODES = Grid((3.75, 3.75, 596.25, 596.25), 7.5, CRS)
ODOMETRY: dict[str, Any] = {
    "yaw_sigma_deg": 0.5,
    "tilt_sigma_deg": 0.4,
    "scale_sigma": 0.012,
    "step_sigma_m": 0.012,
}
RECEIVER: dict[str, Any] = {"gps_bias_sigma_m": 3.0, "gps_white_sigma_m": 1.0}
ASSUMED_TAU_S = 300.0
"""Correlation time of the receiver that the estimator assumes: the longer one is the safer."""
KERNEL = GaussianProcessConfig(
    fit=False,
    family="two-scale",
    variance_m2=9.0,
    length_scale_m=140.0,
    second_variance_m2=0.25,
    second_length_scale_m=55.0,
    nugget_m=MICRO_RELIEF_M,
    mean="plane",
    tolerance_m=5e-3,
)
STATED = JointConfig(satellite=SatelliteErrors(product="unbiased", sigma_m=1.0))
"""Error of the satellite prior as its product states it."""


@dataclass(frozen=True)
class Case:
    """One way to survey and to map."""

    name: str
    errors: Literal["independent", "inflated", "joint"] = "joint"
    satellite: bool = True
    aids: dict[str, Any] = field(default_factory=lambda: {"barometer": False})
    satellite_offset_m: float = 0.0
    assumed: dict[str, Any] = field(default_factory=dict)
    joint: JointConfig = STATED
    gp: GaussianProcessConfig = KERNEL
    swaths: int = 4
    tie_lines: int = 0


GRAVITY = {"accelerometer": True, "barometer": True}
STAKES = {**GRAVITY, "stakes": 4}
CASES = (
    Case("per-landmark noise", "independent", satellite=False),
    Case("inflated noise", "inflated", satellite=False),
    Case("joint", satellite=False),
    Case("joint + satellite"),
    Case("+ gravity, barometer", aids=GRAVITY),
    Case("+ 4 stakes", aids=STAKES),
)
"""The steps of the comparison."""


_LATERAL_M = np.array([-25.0, -16.0, -9.0, -4.0, 0.0, 4.0, 9.0, 16.0, 25.0])
_PER_GROUP = 6


@dataclass(frozen=True)
class SurveyOutcome:
    """Result of one survey: errors of the map [m], never debiased, its coverage, and the path's vertical error [m]."""

    rmse_m: float
    offset_m: float
    coverage: float
    path_before_m: float
    path_after_m: float


@lru_cache(maxsize=2)
def site(seed: int) -> tuple[Dem, Dem]:
    """Return the terrain of a seed, 40 m beyond the site, and the satellite's cells."""
    rng = stream(seed, "joint study", "terrain")
    grid = Grid((-40.0, -40.0, SIDE_M + 40.0, SIDE_M + 40.0), 2.0, CRS)
    smooth = kernel_field(grid, rng, SquaredExponential(9.0, 140.0))
    smooth = smooth + kernel_field(grid, rng, SquaredExponential(0.25, 55.0))
    direction = rng.uniform(0.0, 2.0 * np.pi)
    across = (grid.xy - 0.5 * SIDE_M) @ [np.cos(direction), np.sin(direction)] / SIDE_M
    smooth = smooth + _tilt_for_relief(grid, smooth, across.reshape(grid.shape)) * across.reshape(grid.shape)
    fine = kernel_field(grid, rng, SquaredExponential(MICRO_RELIEF_M**2, 4.0))
    terrain = Dem.on(grid, smooth + fine)
    inner = terrain.window((-1.0, -1.0, SIDE_M + 1.0, SIDE_M + 1.0))
    cells = satellite_copy(inner, rng=stream(seed, "joint study", "satellite"), cell_m=75.0, sigma_m=1.0)
    return terrain, Dem(cells.elevation, cells.transform, cells.crs)


def _tilt_for_relief(grid: Grid, heights: FloatArray, across: FloatArray) -> float:
    """Return, by bisection, the tilt that brings the site's relief to 25 m; 0 where it is larger already."""
    x, y = grid.xy.T
    inside = ((x >= 0.0) & (x <= SIDE_M) & (y >= 0.0) & (y <= SIDE_M)).reshape(grid.shape)
    low, high = 0.0, 60.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        relief = np.ptp((heights + middle * across)[inside])
        low, high = (middle, high) if relief < RELIEF_M else (low, middle)
    return low


def mission_of(seed: int, tau_s: float, case: Case) -> MissionConfig:
    """Return the mission of one survey."""
    inset = 20.0 / (SIDE_M / case.swaths)
    return MissionConfig(
        schema_version=1,
        name="joint-study",
        seed=seed,
        terrain=RandomTerrain(source="random"),
        planner=LawnmowerConfig(swaths=case.swaths, inset_share=inset, tie_lines=case.tie_lines),
        sensors=SensorConfig(gps_correlation_time_s=tau_s, **ODOMETRY, **RECEIVER),
        aids=AidsConfig(**case.aids),
        localization=LocalizationConfig(
            **{"gps_correlation_time_s": ASSUMED_TAU_S, **ODOMETRY, **RECEIVER, **case.assumed}
        ),
    )


def survey_once(seed: int, tau_s: float, case: Case) -> SurveyOutcome:
    """Drive, localize and map one survey, and judge it."""
    terrain, cells = site(seed)
    mission = mission_of(seed, tau_s, case)
    route = planners.plan(AREA, None, mission.planner)
    if mission.aids.way_home:
        route = with_way_home(route, AREA)
    recording, real = simulate_statistical(terrain, route, mission)
    sightings = _landmarks(terrain, real.trajectory, stream(seed, "joint study", "landmarks"))
    localized = localize(replace(recording, sightings=sightings), mission.assumed)
    trajectory, points = localized.trajectory, localized.points
    offset = case.satellite_offset_m * stream(seed, "joint study", "offset").standard_normal()
    prior = Dem(cells.elevation + offset, cells.transform, cells.crs) if case.satellite else None
    if case.errors == "joint":
        assert trajectory.error is not None
        found = JointTerrain(trajectory.error, prior, case.gp, case.joint).map(points, NODES)
        return judged(found, terrain, trajectory, real.trajectory)
    before = _vertical_rms(trajectory, real.trajectory)
    if case.errors == "independent":
        points = replace(points, covariance=points.own_covariance)
    return _judged(reconstruct(points, NODES, prior, config=case.gp), terrain, before, before)


def _landmarks(terrain: Dem, trajectory: Trajectory, rng: np.random.Generator) -> Sightings:
    """Return landmarks in groups of six every 10 m at nine distances to the side, each group good to 6 to 12 cm."""
    from scipy.spatial.transform import Rotation

    travel = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(trajectory.position, axis=0), axis=1))]
    poses = np.searchsorted(travel, np.arange(5.0, travel[-1], 10.0)).clip(0, len(travel) - 1)
    pose = np.repeat(poses, len(_LATERAL_M) * _PER_GROUP)
    lateral = np.tile(np.repeat(_LATERAL_M, _PER_GROUP), len(poses))
    rotation = Rotation.from_quat(trajectory.quaternion[pose]).as_matrix()
    heading = np.arctan2(rotation[:, 1, 0], rotation[:, 0, 0])
    wide = np.where(np.abs(lateral) < 6.0, 2.0, 4.0)
    along = rng.uniform(-5.0, 5.0, len(pose))
    across = lateral + wide * rng.uniform(-1.0, 1.0, len(pose))
    turn = np.column_stack([np.cos(heading), np.sin(heading)])
    left = np.column_stack([-turn[:, 1], turn[:, 0]])
    xy = trajectory.position[pose, :2] + along[:, None] * turn + across[:, None] * left
    xmin, ymin, xmax, ymax = AREA.bounds
    here = ((xy > [xmin - 5.0, ymin - 5.0]) & (xy < [xmax + 5.0, ymax + 5.0])).all(axis=1)
    place = np.column_stack([xy, terrain.at(xy)])[here]
    offset = np.einsum("nji,nj->ni", rotation[here], place - trajectory.position[pose[here]])
    sigma = np.sqrt(_PER_GROUP) * (0.06 + 0.0025 * np.abs(lateral[here]))
    offset = offset + sigma[:, None] * rng.standard_normal(offset.shape) * [0.0, 0.0, 1.0]
    covariance = np.zeros((len(offset), 3, 3))
    covariance[:, range(3), range(3)] = sigma[:, None] ** 2 * np.array([1e-4, 1e-4, 1.0])
    return Sightings(pose[here], offset, covariance, np.full(len(offset), 10.0))


def _vertical_rms(trajectory: Trajectory, real: Trajectory) -> float:
    height = np.interp(trajectory.time_s, real.time_s, real.position[:, 2])
    return float(np.sqrt(np.mean((trajectory.position[:, 2] - height) ** 2)))


def judged(found: JointMap, terrain: Dem, trajectory: Trajectory, real: Trajectory) -> SurveyOutcome:
    """Compare map and path of a joint estimate with the truth."""
    before, after = (_vertical_rms(path, real) for path in (trajectory, found.correction.applied(trajectory)))
    return _judged(found.reconstruction, terrain, before, after)


def _judged(result: Reconstruction, terrain: Dem, before: float, after: float) -> SurveyOutcome:
    """Compare a map with the real terrain, micro-relief included."""
    error = result.mean.elevation - terrain.at(result.mean.xy).reshape(result.mean.shape)
    within = np.abs(error) <= 1.959964 * result.std.elevation
    rmse = float(np.sqrt(np.mean(error**2)))
    return SurveyOutcome(rmse, float(error.mean()), float(within.mean()), before, after)


def outcomes(
    cases: tuple[Case, ...], taus_s: tuple[float, ...], seeds: range
) -> Iterator[tuple[Case, float, int, SurveyOutcome]]:
    """Yield every case on the same terrain, odometry, receiver and satellite, seed by seed."""
    for seed in seeds:
        for tau_s in taus_s:
            for case in cases:
                yield case, tau_s, seed, survey_once(seed, tau_s, case)


def comparison(folder: Path, *, quick: bool, progress: Progress) -> None:
    """Write the figure and the table: error, site-mean error apart, and coverage, step by step."""
    seeds = range(4100, 4103 if quick else 4120)
    taus_s = (60.0, 300.0)
    n_total = len(seeds) * len(taus_s) * len(CASES)
    rows: list[dict[str, Any]] = []
    for n_done, (case, tau_s, seed, out) in enumerate(outcomes(CASES, taus_s, seeds), start=1):
        progress("surveys", n_done, n_total)
        rows.append(
            {
                "case": case.name,
                "gps_tau_s": tau_s,
                "seed": seed,
                "rmse_m": round(out.rmse_m, 4),
                "site_mean_error_m": round(out.offset_m, 4),
                "coverage_95": round(out.coverage, 4),
            }
        )
    with (folder / "joint_map_comparison.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    _figure(folder / "joint_map_comparison.png", rows, taus_s)


def _figure(path: Path, rows: list[dict[str, Any]], taus_s: tuple[float, ...]) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    names = [case.name for case in CASES]
    for k, tau_s in enumerate(taus_s):
        for place, name in enumerate(names):
            mine = [row for row in rows if row["case"] == name and row["gps_tau_s"] == tau_s]
            rmse = np.array([row["rmse_m"] for row in mine])
            y = place + 0.18 * (2 * k - 1)
            colour = ("tab:blue", "tab:orange")[k]
            label = f"errors of the GPS last {tau_s:.0f} s" if place == 0 else None
            left.plot(rmse, np.full(len(rmse), y), ".", ms=4, alpha=0.5, color=colour)
            left.plot(np.median(rmse), y, "|", ms=14, mew=2.5, color=colour, label=label)
            offset = float(np.sqrt(np.mean([row["site_mean_error_m"] ** 2 for row in mine])))
            left.plot(
                offset, y, "x", ms=5, color="black", label="site-mean error, RMS" if k + place == 0 else None
            )
            right.plot(np.mean([row["coverage_95"] for row in mine]), y, "o", color=colour)
    left.set(xscale="log", xlabel="RMSE of the map [m]", yticks=range(len(names)), yticklabels=names)
    left.axvline(0.4572, color="grey", lw=0.8, ls="--")
    left.invert_yaxis()
    left.legend(loc="upper left", fontsize=7)
    right.axvline(0.95, color="grey", lw=0.8, ls="--")
    right.set(xlabel="share within the claimed 95 %", xlim=(0.0, 1.0))
    figure.savefig(path, dpi=110)
