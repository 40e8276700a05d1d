"""Thinning of landmarks: equally many, chosen by range as in the glacier paper or by their information for the map.

    python -m benchmarks.landmark_thinning [--json FILE] [--quick]

Missions of the statistical fidelity over terrain of the paper's length scale (17.75 m), and over terrain three
times as smooth, four swaths on 160 x 160 m, 20 landmarks per metre first seen from 1.5 to 25 m. Landmarks are
placed from the real poses, so that drift, which no choice among landmarks lessens, hides nothing. The map is
the Gaussian process with its hyperparameters fitted, about the satellite prior.
"""

from collections.abc import Iterator

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

import planners
import survey
from benchmarks.report import Row, main
from sim.config.mission import MissionConfig
from sim.simulate.simulation import simulate_statistical
from sim.world.site import World, build_world
from survey.core.arrays import IntArray
from survey.data.landmarks import most_informative
from survey.data.recording import Recording
from survey.data.truth import Truth

N_KEPT = 150
GRID_STEP_M = 4.0


def mission(seed: int, length_scale_m: float) -> MissionConfig:
    """Describe one mission."""
    return MissionConfig.model_validate(
        {
            "schema_version": 1,
            "name": "thinning",
            "seed": seed,
            "terrain": {
                "source": "random",
                "size_m": 180.0,
                "relief_m": 12.0,
                "length_scale_m": length_scale_m,
            },
            "area": {"bounds_m": (526010.0, 6478010.0, 526170.0, 6478170.0)},
            "planner": {"pattern": "lawnmower", "swaths": 4},
            "sensors": {"landmarks_per_m": 20.0, "landmark_range_m": (1.5, 25.0)},
        }
    )


def seen(world: World, recording: Recording, truth: Truth) -> survey.SurfacePoints:
    """Place the landmarks from the real poses, those inside the prior."""
    assert recording.odometry is not None
    assert recording.sightings is not None
    sightings, path = recording.sightings, truth.trajectory
    time_s = recording.odometry.time_s[sightings.pose].clip(*path.time_s[[0, -1]])
    place = np.column_stack([np.interp(time_s, path.time_s, axis) for axis in path.position.T])
    turn = Slerp(path.time_s, Rotation.from_quat(path.quaternion))(time_s).as_matrix()
    covariance = turn @ sightings.covariance @ turn.transpose(0, 2, 1)
    points = survey.SurfacePoints(
        place + np.einsum("nij,nj->ni", turn, sightings.offset),
        covariance=0.5 * (covariance + covariance.transpose(0, 2, 1)),
        range_m=sightings.range_m,
        crs=recording.crs,
    )
    return points.select(np.isfinite(world.prior.at(points.xy)))


def map_rmse_m(world: World, points: survey.SurfacePoints, kept: IntArray) -> float:
    """Error of the map of some of the points over the area [m]."""
    chosen = np.zeros(len(points), dtype=np.bool_)
    chosen[kept] = True
    grid = survey.Grid.over(world.area.bounds, GRID_STEP_M, world.area.crs)
    found = survey.reconstruct(points.select(chosen), grid, prior=world.prior, method="dense")
    error = found.mean.elevation.ravel() - world.terrain.at(grid.xy)
    return float(np.sqrt(np.nanmean(error[world.area.contains(grid.xy)] ** 2)))


def errors_m(seed: int, length_scale_m: float) -> tuple[float, float]:
    """Error of the map from landmarks thinned by range and by information [m]."""
    config = mission(seed, length_scale_m)
    world = build_world(config)
    route = planners.plan(world.area, world.prior, config.planner, rover=config.rover, fleet=config.fleet)
    recording, truth = simulate_statistical(world.terrain, route, config)
    points = seen(world, recording, truth)
    assert points.range_m is not None
    far = np.flatnonzero(points.range_m > 5.0)
    by_range = np.random.default_rng(seed).choice(far, N_KEPT, replace=False)
    by_information = most_informative(points, N_KEPT, world.area.bounds)
    return map_rmse_m(world, points, by_range), map_rmse_m(world, points, by_information)


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows of the table."""
    for name, length_scale_m, first in (("paper's terrain", 17.75, 201), ("smooth terrain", 55.0, 301)):
        pairs = np.array(
            [errors_m(seed, length_scale_m) for seed in range(first, first + (2 if quick else 6))]
        )
        ratio = pairs[:, 1] / pairs[:, 0]
        yield Row(f"{name}: map RMSE, first seen beyond 5 m, median", float(np.median(pairs[:, 0])), "m")
        yield Row(f"{name}: map RMSE, by information, median", float(np.median(pairs[:, 1])), "m")
        yield Row.of(f"{name}: information over range, median", float(np.median(ratio)), "1", "<=", 1.0)
        yield Row(f"{name}: information over range, worst", float(ratio.max()), "1")


if __name__ == "__main__":
    main("Landmark thinning", measure)
