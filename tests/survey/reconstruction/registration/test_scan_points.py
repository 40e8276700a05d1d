"""Scans and a path become surface points that share the errors of the path."""

import numpy as np
import pytest
from scipy import sparse

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.path_error import PathError
from survey.data.sensors.lidar import SensorScan
from survey.data.trajectory import Trajectory
from survey.reconstruction.registration.config import ScanPointsConfig
from survey.reconstruction.registration.poses import PathInterpolator
from survey.reconstruction.registration.scan_points import (
    BeamErrors,
    RegisteredReturns,
    best_of_visits,
    registered,
    representatives_of_stretches,
    scan_points,
)

ERRORS = BeamErrors(0.03, 0.05)
SENSOR = np.array([0.0, 0.0, 1.5])


def path(error: PathError | None = None) -> Trajectory:
    """A straight drive to the east at 1 m/s over level ground at 100 m."""
    n = 41
    place = np.column_stack([np.arange(n), np.full(n, 50.0), np.full(n, 100.0)])
    level = np.tile([0.0, 0.0, 0.0, 1.0], (n, 1))
    return Trajectory(
        np.arange(n), place, level, np.tile(0.04 * np.eye(3), (n, 1, 1)), "EPSG:32608", None, error
    )


def shared() -> PathError:
    return PathError(np.array([0.0, 20.0, 40.0]), sparse.identity(18, format="csr") * 1e4, 6)


def ring(time_s: float, *, n: int = 120, lift_m: float = 0.0, seed: int = 0) -> SensorScan:
    """Level ground within 20 m, as seen from the moving vehicle."""
    rng = np.random.default_rng([seed, int(10 * time_s)])
    away, turn = rng.uniform(4.0, 20.0, n), rng.uniform(-np.pi, np.pi, n)
    place: FloatArray = np.column_stack([away * np.cos(turn), away * np.sin(turn), np.full(n, lift_m)])
    return SensorScan(np.full(n, time_s), place, SENSOR)


def scans() -> list[SensorScan]:
    return [ring(float(t)) for t in range(40)]


def test_points_lie_on_the_ground_and_name_their_keyframes() -> None:
    points = scan_points(scans(), path(shared()), ERRORS)
    assert points.z == pytest.approx(np.full(len(points), 100.0), abs=1e-9)
    assert points.keyframe is not None
    assert points.keyframe.min() >= 0.0
    assert points.keyframe.max() <= 2.0
    assert points.own_covariance is not None
    assert (points.sigma_z > np.sqrt(points.own_covariance[:, 2, 2])).all()


def test_a_path_without_shared_error_gives_points_of_no_keyframe_with_its_variance() -> None:
    points = scan_points(scans(), path(), ERRORS)
    assert points.keyframe is None
    assert (points.sigma_z >= 0.2).all()


def test_one_in_ten_wrong_returns_does_not_move_the_points() -> None:
    wrong = [ring(float(t), n=13, lift_m=0.8, seed=1) for t in range(40)]
    both = [
        SensorScan(np.r_[a.time_s, b.time_s], np.vstack([a.xyz, b.xyz]), SENSOR)
        for a, b in zip(scans(), wrong, strict=True)
    ]
    points = scan_points(both, path(), ERRORS, config=ScanPointsConfig(least_returns=9))
    assert np.mean(np.abs(points.z - 100.0) < 1e-9) > 0.98


def test_points_have_the_relief_of_the_ground_within_their_cells() -> None:
    """Of returns chosen by their height, the points would have less relief than the ground, and a map too small an error."""
    rough = []
    for t in range(40):
        scan, rng = ring(float(t), n=400), np.random.default_rng(t)
        lifted = scan.xyz + 0.1 * rng.standard_normal(400)[:, None] * [0.0, 0.0, 1.0]
        rough.append(scan._replace(xyz=lifted))
    points = scan_points(rough, path(), ERRORS)
    assert len(points) > 100
    assert points.z.std() == pytest.approx(0.1, rel=0.15)


def test_a_vehicle_that_stands_still_gives_stretches_of_fifty_scans() -> None:
    n = 200
    level, place = np.tile([0.0, 0.0, 0.0, 1.0], (n, 1)), np.tile([5.0, 50.0, 100.0], (n, 1))
    parked = Trajectory(np.arange(n), place, level, np.zeros((n, 3, 3)), "EPSG:32608")
    poses, config = PathInterpolator(parked), ScanPointsConfig()
    placed = registered((ring(float(t), n=30) for t in range(120)), poses, config)
    sizes = [int(part.n_returns.sum()) for part in representatives_of_stretches(placed, config)]
    assert len(sizes) == 3


def test_scans_without_a_usable_return_are_passed_over() -> None:
    none, near = ring(3.0, n=0), SensorScan(np.array([4.0]), np.array([[0.5, 0.0, 1.0]]), SENSOR)
    assert len(scan_points([*scans(), none, near], path(), ERRORS)) == len(
        scan_points(scans(), path(), ERRORS)
    )


def test_points_are_no_more_than_wanted() -> None:
    assert len(scan_points(scans(), path(), ERRORS, config=ScanPointsConfig(most_points=100))) <= 100


def test_scans_of_another_time_are_refused() -> None:
    with pytest.raises(InputError, match="same drive"):
        scan_points([ring(100.0)], path(), ERRORS)


def test_each_visit_of_a_cell_gives_the_view_of_the_most_returns() -> None:
    origin = np.column_stack([np.r_[0.0, 5.0, 10.0, 200.0, 205.0], np.zeros(5), np.ones(5)])
    place = np.column_stack([np.full(5, 8.0), np.full(5, 0.5), np.zeros(5)])
    views = RegisteredReturns(np.arange(5.0), place, origin, np.array([30, 90, 4, 7, 7]))
    assert best_of_visits(views, 4.0).tolist() == [1, 3]
