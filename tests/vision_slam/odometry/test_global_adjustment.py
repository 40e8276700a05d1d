"""Global bundle adjustment on a drawn street whose path and lens are known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from survey.core.arrays import BoolArray, FloatArray
from survey.data.camera import Camera
from vision_slam.config import VisualOdometryConfig
from vision_slam.evaluation import absolute_errors_m
from vision_slam.motion import RelativeMotion
from vision_slam.odometry.global_adjustment import adjusted_path
from vision_slam.odometry.landmarks import EndedTrack
from vision_slam.odometry.self_calibration import estimate_lens
from vision_slam.readers.calibrations import FORWARD

_MATRIX = np.array([[720.0, 0.0, 619.5], [0.0, 720.0, 187.5], [0.0, 0.0, 1.0]])
_GIVEN = Camera("pinhole", 1240, 376, _MATRIX, np.zeros(5), FORWARD, distortion_is_assumed=True)
_REAL = replace(_GIVEN, distortion=np.array([0.022, -0.008, 0.0, 0.0, 0.0]), distortion_is_assumed=False)
_NOISE_PX = 0.3
_CONFIG = VisualOdometryConfig()
_SIGHTS = 12
pytestmark = pytest.mark.long


def _path() -> FloatArray:
    """Poses of a body that drives 300 m in steps of 1.5 m, with a turn of 90 degrees to the left and one to the right."""
    rate = np.zeros(200)
    rate[60:75], rate[130:145] = np.pi / 30.0, -np.pi / 30.0
    yaw = np.cumsum(rate)
    poses = np.tile(np.eye(4), (200, 1, 1))
    poses[:, :3, :3] = Rotation.from_euler("z", yaw[:, None]).as_matrix()
    poses[1:, :2, 3] = 1.5 * np.cumsum(np.column_stack([np.cos(yaw), np.sin(yaw)])[:-1], axis=0)
    return poses


def _points(poses: FloatArray, rng: np.random.Generator, n_beyond: int) -> FloatArray:
    """Points on the ground and on façades 12 m to either side, up to some steps beyond the last pose, and on a ridge 8 km away."""
    n = 2800
    beyond = np.repeat(poses[-1:], n_beyond, axis=0)
    beyond[:, :3, 3] += 1.5 * np.arange(1, n_beyond + 1)[:, None] * poses[-1, :3, 0]
    every = np.concatenate([poses, beyond])
    at = every[rng.integers(0, len(every), 2 * n)]
    aside = np.r_[rng.uniform(-8.0, 8.0, n), rng.choice([-12.0, 12.0], n)]
    local = np.column_stack(
        [rng.uniform(0.0, 1.5, 2 * n), aside, np.r_[np.full(n, -1.6), rng.uniform(0.0, 8.0, n)]]
    )
    near = at[:, :3, 3] + np.einsum("nij,nj->ni", at[:, :3, :3], local)
    bearing = rng.uniform(-np.pi, np.pi, 1200)
    ridge = 8000.0 * np.column_stack([np.cos(bearing), np.sin(bearing), rng.uniform(0.02, 0.15, 1200)])
    return np.concatenate([near, ridge])


def _seen(eye: FloatArray, points: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, BoolArray]:
    local = (points - eye[:3, 3]) @ eye[:3, :3]
    ahead = (local[:, 2] > 2.0) & ((local[:, 2] < 40.0) | (local[:, 2] > 1000.0))
    local[~ahead] = [0.0, 0.0, 1.0]
    pixel = _REAL.project(local) + rng.normal(0.0, _NOISE_PX, (len(points), 2))
    return pixel, ahead & ((pixel > 0) & (pixel < [1239, 375])).all(axis=1)


def _tracks(poses: FloatArray, read_by: Camera, n_beyond: int = 25) -> list[EndedTrack]:
    """Tracks of at most twelve keyframes, drawn by the real lens and read by another."""
    rng = np.random.default_rng(3)
    points = _points(poses, rng, n_beyond)
    pixel, inside = (
        np.array(part)
        for part in zip(*(_seen(p @ _REAL.T_body_camera, points, rng) for p in poses), strict=True)
    )
    tracks = []
    for j in range(len(points)):
        keyframes = np.flatnonzero(inside[:, j])
        for part in np.split(keyframes, np.flatnonzero(np.diff(keyframes) > 1) + 1):
            for first in range(0, len(part), _SIGHTS):
                own = part[first : first + _SIGHTS]
                if len(own) >= 3:
                    tracks.append(EndedTrack(own, read_by.rays(pixel[own, j]), False))
    return tracks


def _bent(poses: FloatArray) -> FloatArray:
    """Return the path of a window whose scale creeps by 25 % in each turn."""
    step = (
        np.diff(poses[:, :3, 3], axis=0)
        * np.interp(np.arange(199), [60, 75, 130, 145], [1.0, 1.25, 1.25, 1.56])[:, None]
    )
    bent = poses.copy()
    bent[1:, :3, 3] = np.cumsum(step, axis=0)
    return bent


def _motions(n_rolled: int) -> list[RelativeMotion]:
    """Wheels over the first steps."""
    return [RelativeMotion(0.1, None, 1.5 if k < n_rolled else None) for k in range(199)]


def _end_per_cent(found: FloatArray, real: FloatArray) -> float:
    return float(100.0 * np.linalg.norm(found[-1, :3, 3] - real[-1, :3, 3]) / 300.0)


def test_scale_that_crept_in_turns_is_found_with_the_lens() -> None:
    real = _path()
    lens, path = estimate_lens(_GIVEN, _bent(real), _tracks(real, _GIVEN), _motions(10), _CONFIG)
    assert path is not None
    assert lens.is_accepted
    assert np.abs(lens.lens[1:] - [0.022, -0.008]).max() < 0.004
    assert _end_per_cent(path.poses, real) < 2.0  # of a path that ends 50 % too long
    assert absolute_errors_m(path.poses[:, :3, 3], real[:, :3, 3], "sim3").mean() < 0.6


def _nees(n_beyond: int) -> FloatArray:
    """Return the squared errors of positions over their covariances (K - 1,)."""
    real = _path()
    path = adjusted_path(_REAL, _bent(real), _tracks(real, _REAL, n_beyond), _motions(10), _CONFIG)
    assert path is not None
    error = path.poses[1:, :3, 3] - real[1:, :3, 3]
    nees: FloatArray = np.einsum(
        "ni,ni->n", error, np.linalg.solve(path.covariance[1:], error[:, :, None])[..., 0]
    )
    return nees


def test_the_covariance_covers_the_error_of_an_adjusted_path() -> None:
    nees = _nees(25)
    assert 0.1 < nees[-1] < 14.2  # χ² with 3 degrees
    assert 0.3 < nees.mean() < 9.0


@pytest.mark.xfail(
    strict=True,
    reason="poses that see little near claim too little: NEES ten keyframes before the end is 37, 3 is true",
)
def test_the_covariance_covers_poses_that_see_nothing_near() -> None:
    assert _nees(0)[-11] < 14.2


def test_a_step_that_no_corner_shows_is_as_uncertain_as_its_guess() -> None:
    real = _path()
    parts = [
        EndedTrack(track.keyframes[side], track.rays[side], False)
        for track in _tracks(real, _REAL)
        for side in (track.keyframes < 100, track.keyframes >= 100)
        if np.count_nonzero(side) >= 3
    ]
    path = adjusted_path(_REAL, real, parts, _motions(10), _CONFIG)
    assert path is not None
    sigma_m = np.sqrt(np.einsum("kii->k", path.covariance))
    assert sigma_m[99] < 1.0
    assert sigma_m[100] > 3.0  # of a step of 1.5 m


def test_without_wheels_the_shape_is_found_and_the_size_stays() -> None:
    real = _path()
    path = adjusted_path(_REAL, _bent(real), _tracks(real, _REAL), _motions(0), _CONFIG)
    assert path is not None
    assert absolute_errors_m(path.poses[:, :3, 3], real[:, :3, 3], "sim3").mean() < 0.6
    assert np.linalg.norm(path.poses[5, :3, 3]) == pytest.approx(7.5, rel=0.02)


def test_few_corners_leave_the_path_as_it_is() -> None:
    real = _path()
    assert adjusted_path(_REAL, real, _tracks(real[:20], _REAL)[:30], _motions(10), _CONFIG) is None
