"""Cost of an update of the live map, and its difference from the batch map of the same covariance."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

import planners
from benchmarks.report import Row, fastest
from live.watch.live_map import LiveMap
from papers.glacier.joint_map import CASES, CRS, KERNEL, mission_of
from sim.simulate.simulation import simulate_statistical
from survey.core.streams import stream
from survey.data.area import SurveyArea
from survey.data.grid import Grid
from survey.reconstruction.gp.config import JointConfig
from survey.reconstruction.joint.joint_map import JointTerrain
from survey.terrain import random_dem
from vision_slam import localize

SEED = 20_293
_SIDE_M, _STEP_M, _N_POINTS = 1198.0, 2.0, 10_000
_SHARED_M, _SIGMA_M = 0.1, 0.05
_LIMIT_S, _LIMIT_M, _LIMIT_SHARE = 1.0, 5e-3, 0.02


def map_rows(quick: bool) -> Iterator[Row]:
    """Yield cost and difference for samples that share one error, and for landmarks with the error of their path."""
    side = 298.0 if quick else _SIDE_M
    grid = Grid((0.0, 0.0, side, side), _STEP_M, CRS)
    ground = random_dem(
        "squared-exponential",
        Grid((-20.0, -20.0, side + 22.0, side + 22.0), 4.0, CRS),
        stream(SEED, "ground"),
        9.0,
        length_scale_m=140.0,
    )
    live = LiveMap(KERNEL.stated_kernel(), KERNEL.nugget_m or 0.0, grid)
    area = SurveyArea.rectangle((0.0, 0.0, side, side), CRS)
    route = planners.plan(area, None, planners.LawnmowerConfig(swaths=6))
    mission = mission_of(SEED, 300.0, CASES[4])
    recording, _ = simulate_statistical(ground, route, mission)
    found = localize(recording, mission.assumed)
    points, error = found.points, found.trajectory.error
    assert error is not None
    xyz = points.xyz[:_N_POINTS]
    sigma = np.full(len(xyz), _SIGMA_M)
    name = f"update with {len(xyz)} samples, {grid.shape[0]}² nodes"
    (mean, std), taken_s = fastest(lambda: live.of_samples(xyz, sigma, _SHARED_M), 3)
    wide = replace(live, memory_mb=2.0 * live.memory_mb)
    yield from _rows(name, taken_s, (mean, std), wide.of_samples(xyz, sigma, _SHARED_M))
    name = f"update with {len(points)} landmarks of {len(error)} keyframes"
    (mean, std), taken_s = fastest(lambda: live.of_landmarks(points, error), 3)
    batch = JointTerrain(error, None, KERNEL, JointConfig()).solved(points, grid.bounds).terrain.fields(grid)
    yield from _rows(name, taken_s, (mean, std), batch)


def _rows(name: str, taken_s: float, live: tuple, batch: tuple) -> Iterator[Row]:  # type: ignore[type-arg]
    yield Row.of(f"{name}: CPU time", taken_s, "s", "<=", _LIMIT_S)
    yield Row.of(
        f"{name}: largest difference of heights from the batch map",
        float(np.abs(live[0] - batch[0]).max()),
        "m",
        "<=",
        _LIMIT_M,
    )
    yield Row.of(
        f"{name}: largest difference of σ",
        float(np.abs(live[1] / batch[1] - 1.0).max()),
        "1",
        "<=",
        _LIMIT_SHARE,
    )
