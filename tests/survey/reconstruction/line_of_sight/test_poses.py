"""Poses between those of a path, and the errors that places have by them."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from survey.core.errors import InputError
from survey.data.trajectory import Trajectory
from survey.reconstruction.line_of_sight.scan_points import (
    PathInterpolator,
    covariance_by_pose,
    own_covariance,
)


def path(yaw_deg: list[float]) -> Trajectory:
    n = len(yaw_deg)
    place = np.column_stack([2.0 * np.arange(n), np.zeros((n, 2))])
    turns = Rotation.from_euler("z", np.array(yaw_deg)[:, None], degrees=True).as_quat(canonical=True)
    return Trajectory(np.arange(n), place, turns, np.zeros((n, 3, 3)), "EPSG:32608")


def test_position_and_heading_are_interpolated() -> None:
    at = PathInterpolator(path([0.0, 90.0])).at(np.array([0.5]))
    assert at.position == pytest.approx(np.array([[1.0, 0.0, 0.0]]))
    assert at.rotation[0, :, 0] == pytest.approx([0.5**0.5, 0.5**0.5, 0.0])


def test_a_steady_turn_is_interpolated_exactly_and_a_jerky_one_is_not() -> None:
    steady, jerky = (PathInterpolator(path(yaw)) for yaw in ([0.0, 10.0, 20.0], [0.0, 10.0, 0.0]))
    times = np.array([0.0, 0.5, 1.0])
    assert steady.at(times).turn_sigma_rad == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
    assert jerky.at(times).turn_sigma_rad == pytest.approx([0.0, np.radians(20.0) / 8.0, 0.0])


def test_a_path_of_one_pose_is_refused() -> None:
    with pytest.raises(InputError, match="single pose"):
        PathInterpolator(path([0.0]))


def test_the_covariance_by_the_pose_is_that_of_drawn_poses() -> None:
    attitude = np.array([0.05, -0.1, 0.8])
    turn = Rotation.from_euler("xyz", attitude)
    offset = np.array([12.0, 5.0, -1.0])
    sigma = np.array([0.1, 0.2, 0.3, 0.002, 0.003, 0.004])
    drawn = np.random.default_rng(0).standard_normal((40_000, 6)) * sigma
    turns = Rotation.from_euler("xyz", attitude + drawn[:, [5, 4, 3]])
    places = drawn[:, :3] + turns.apply(offset)
    expected = np.cov(places.T)
    found = covariance_by_pose(turn.apply(offset)[None], turn.as_matrix()[None], np.diag(sigma**2)[None])[0]
    assert found == pytest.approx(expected, abs=0.03 * float(np.trace(expected)))


def test_a_return_errs_along_its_ray_by_range_and_across_it_by_angle() -> None:
    covariance = own_covariance(np.array([[20.0, 0.0, 0.0]]), 0.03, np.array([0.001]))
    assert covariance[0] == pytest.approx(np.diag([0.03**2, 0.02**2, 0.02**2]))
