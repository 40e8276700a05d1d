"""Self-calibration on drawn points whose camera, path and lens are known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from survey.core.arrays import FloatArray
from survey.data.camera import Camera
from vision_slam.config import VisualOdometryConfig
from vision_slam.motion import RelativeMotion
from vision_slam.odometry.global_adjustment import LensChange
from vision_slam.odometry.self_calibration import estimate_lens
from vision_slam.odometry.tracks import Track
from vision_slam.readers.calibrations import FORWARD

_GIVEN = Camera(
    "pinhole",
    1240,
    376,
    np.array([[720.0, 0.0, 619.5], [0.0, 720.0, 187.5], [0.0, 0.0, 1.0]]),
    np.zeros(5),
    FORWARD,
    distortion_is_assumed=True,
)
_REAL = replace(_GIVEN, distortion=np.array([0.025, -0.008, 0.0, 0.0, 0.0]))
_CONFIG = VisualOdometryConfig(pixel_sigma=0.3)


def _path(turn_deg: float, n: int = 30) -> FloatArray:
    """Poses of a body that drives 1 m a step and turns evenly."""
    yaw = np.linspace(0.0, np.radians(turn_deg), n)
    poses = np.tile(np.eye(4), (n, 1, 1))
    poses[:, :3, :3] = Rotation.from_euler("z", yaw[:, None]).as_matrix()
    poses[1:, :2, 3] = np.cumsum(np.column_stack([np.cos(yaw), np.sin(yaw)])[:-1], axis=0)
    return poses


def _tracks(real: Camera, poses: FloatArray, read_by: Camera = _GIVEN, noise_px: float = 0.3) -> list[Track]:
    """Tracks of points beside the path, drawn by the real lens with pixel noise, read by another one."""
    rng = np.random.default_rng(5)
    points = poses[rng.integers(0, len(poses), 1500), :3, 3] + rng.uniform(-1, 1, (1500, 3)) * [
        15.0,
        15.0,
        2.0,
    ]
    eyes = poses @ real.T_body_camera
    seen: list[list[tuple[int, FloatArray]]] = [[] for _ in points]
    for k, eye in enumerate(eyes):
        local = (points - eye[:3, 3]) @ eye[:3, :3]
        pixel = real.project(local) + rng.normal(0.0, noise_px, (len(points), 2))
        inside = (local[:, 2] > 3.0) & ((pixel > 0) & (pixel < [1239, 375])).all(axis=1)
        for index in np.flatnonzero(inside):
            seen[index].append((k, read_by.rays(pixel[index : index + 1])[0]))
    return [Track(np.zeros(2), [k for k, _ in rows], [ray for _, ray in rows]) for rows in seen if rows]


def _unknown(poses: FloatArray) -> list[RelativeMotion]:
    return [RelativeMotion(0.1, None, None)] * (len(poses) - 1)


def test_a_turn_reveals_radial_distortion_that_was_assumed_to_be_zero() -> None:
    poses = _path(60.0)
    found, _ = estimate_lens(_GIVEN, poses, _tracks(_REAL, poses), _unknown(poses), _CONFIG)
    assert found.is_accepted
    assert found.camera.distortion[:2] == pytest.approx([0.025, -0.008], abs=0.006)
    assert (np.abs(found.lens[1:] - [0.025, -0.008]) < 3.0 * found.sigma[1:]).all()
    assert found.camera.matrix[0, 0] == pytest.approx(720.0, rel=0.01)
    assert "contradict the lens by" in found.note


def test_a_focal_length_that_is_off_by_a_fifth_is_found_in_a_turn() -> None:
    poses = _path(80.0)
    real = replace(_REAL, matrix=np.array([[864.0, 0.0, 619.5], [0.0, 864.0, 187.5], [0.0, 0.0, 1.0]]))
    found, _ = estimate_lens(_GIVEN, poses, _tracks(real, poses), _unknown(poses), _CONFIG)
    assert found.is_accepted
    assert found.camera.matrix[0, 0] == pytest.approx(864.0, rel=0.03)
    assert "focal length" in found.note


def test_an_estimate_over_tracks_of_the_estimated_lens_stays() -> None:
    """The second pass reads the images with a focal length that the first one found a fifth off."""
    poses = _path(80.0)
    real = replace(_REAL, matrix=np.array([[576.0, 0.0, 619.5], [0.0, 576.0, 187.5], [0.0, 0.0, 1.0]]))
    used = LensChange(float(np.log(0.81)), 0.02, -0.005)
    tracks = _tracks(real, poses, used.applied(_GIVEN))
    found, _ = estimate_lens(_GIVEN, poses, tracks, _unknown(poses), _CONFIG, used=used)
    assert found.is_accepted
    assert found.camera.matrix[0, 0] == pytest.approx(576.0, rel=0.03)


def test_a_straight_drive_leaves_the_lens_as_it_is_given() -> None:
    poses = _path(5.0)
    found, _ = estimate_lens(_GIVEN, poses, _tracks(_REAL, poses), _unknown(poses), _CONFIG)
    assert not found.is_accepted
    assert found.camera == _GIVEN
    assert found.scale_sigma == pytest.approx(0.16 * np.radians(5.0), rel=0.01)
    assert "turns by 5°" in found.note
    assert "assumed to be zero" in found.note


def test_a_lens_that_is_right_is_confirmed() -> None:
    poses = _path(60.0)
    found, _ = estimate_lens(_GIVEN, poses, _tracks(_GIVEN, poses), _unknown(poses), _CONFIG)
    assert not found.is_accepted
    assert found.scale_sigma < 0.2 * 0.16 * np.radians(60.0)  # of that of a lens that is not known
    assert "agree with the lens" in found.note


def test_few_corners_estimate_no_lens() -> None:
    poses = _path(60.0)
    found, _ = estimate_lens(_GIVEN, poses, _tracks(_REAL, poses)[:20], _unknown(poses), _CONFIG)
    assert not found.is_accepted
    assert found.scale_sigma > 0.1


def test_an_uncertain_estimate_is_better_than_a_distortion_that_nothing_states() -> None:
    """Of the border's 1.5 pixels the small image shows so little that zero is not excluded; a stated lens stays."""
    poses, given = _path(24.0), _GIVEN
    real = replace(_REAL, distortion=np.array([0.006, -0.002, 0.0, 0.0, 0.0]))
    tracks = _tracks(real, poses, noise_px=1.5)
    config = VisualOdometryConfig(pixel_sigma=1.5)
    assumed, _ = estimate_lens(given, poses, tracks, _unknown(poses), config)
    stated, _ = estimate_lens(
        replace(given, distortion_is_assumed=False), poses, tracks, _unknown(poses), config
    )
    assert "not significant" in stated.note
    assert not stated.is_accepted
    assert assumed.is_accepted
    assert abs(assumed.lens[1] - 0.006) < 3.0 * assumed.sigma[1]


def test_an_estimated_lens_leaves_a_part_of_the_drift_of_scale() -> None:
    """The errors of the estimate are those of a lens that is less unknown, and cause less drift."""
    poses = _path(60.0)
    found, _ = estimate_lens(_GIVEN, poses, _tracks(_REAL, poses), _unknown(poses), _CONFIG)
    short, _ = estimate_lens(_GIVEN, poses[:6], [], _unknown(poses[:6]), _CONFIG)
    unknown = short.scale_sigma / np.radians(short.turned_deg) * np.radians(found.turned_deg)
    assert 0.0 < found.scale_sigma < 0.3 * unknown
