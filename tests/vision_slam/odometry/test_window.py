"""Bundle adjustment in a sliding window against least squares and wrong corners."""

from itertools import pairwise

import gtsam
import numpy as np
from scipy.optimize import least_squares

from survey.core.arrays import FloatArray
from survey.data.camera import Camera
from tests.vision_slam.odometry.poses import pose_at
from vision_slam.config import VisualOdometryConfig
from vision_slam.motion import RelativeMotion
from vision_slam.odometry.tracks import Track
from vision_slam.odometry.window import Window


def test_the_window_finds_what_plain_least_squares_finds(camera: Camera) -> None:
    """Four poses, forty points: full bundle adjustment by scipy over poses and points is the judge."""
    rng = np.random.default_rng(6)
    real = [pose_at(0.25 * k, 1.0 * k) for k in range(4)]
    points = np.column_stack(
        [rng.uniform(2.0, 8.0, 40), rng.uniform(-2.0, 2.0, 40), rng.uniform(-0.2, 0.2, 40)]
    )
    eyes = [pose @ camera.T_body_camera for pose in real]
    sigma = 0.5 / 240.0
    seen = np.array([(points - eye[:3, 3]) @ eye[:3, :3] for eye in eyes])
    plane = seen[:, :, :2] / seen[:, :, 2:] + sigma * rng.normal(size=(4, 40, 2))
    config = VisualOdometryConfig()
    window = Window(camera, config)
    window.begin(real[0])
    for before, pose in pairwise(real):
        step = np.linalg.inv(before) @ pose
        guess = pose.copy()
        guess[:3, 3] += rng.normal(0.0, 0.01, 3)
        window.add(guess, RelativeMotion(0.25, step[:3, :3], float(np.linalg.norm(step[:3, 3]))))
    between = list(window._between)
    rays = np.concatenate([plane, np.ones((4, 40, 1))], axis=2)
    rays /= np.linalg.norm(rays, axis=2, keepdims=True)
    tracks = [Track(np.zeros(2), [0, 1, 2, 3], [rays[k, j] for k in range(4)]) for j in range(40)]
    for _ in range(4):
        window.solve(tracks)

    def residual(x: FloatArray) -> FloatArray:
        bodies = [
            gtsam.Pose3(real[0]),
            *(gtsam.Pose3(real[k]).retract(x[6 * k - 6 : 6 * k]) for k in (1, 2, 3)),
        ]
        place = x[18:].reshape(40, 3)
        parts = []
        for k, body in enumerate(bodies):
            eye = body.matrix() @ camera.T_body_camera
            inside = (place - eye[:3, 3]) @ eye[:3, :3]
            weight = (rays[:, :, 2].mean(axis=0) ** 1.5)[:, None] / sigma
            parts.append(((inside[:, :2] / inside[:, 2:] - plane[k]) * weight).ravel())
        for k in range(3):
            off = between[k].pose.localCoordinates(bodies[k].between(bodies[k + 1]))
            travel = float(np.linalg.norm(between[k].pose.translation()))
            aside = config.lateral_sigma * travel + 0.005
            parts.append(off[:3] / np.radians(config.gyro_sigma_deg * 0.25**0.5))
            for shift in (off[3:4] / (config.wheel_sigma * travel + 0.002), off[4:] / aside):
                length = np.linalg.norm(shift) + 1e-12  # Cauchy's loss as a residual: c √ln(1 + |e|²/c²)
                parts.append(shift / length * 3.0 * np.sqrt(np.log1p((length / 3.0) ** 2)))
        return np.concatenate(parts)

    judge = least_squares(residual, np.r_[np.zeros(18), points.ravel()], xtol=1e-12, ftol=1e-12)
    for k in (1, 2, 3):
        expected = gtsam.Pose3(real[k]).retract(judge.x[6 * k - 6 : 6 * k]).translation()
        # Points are triangulated linearly before they are eliminated: a tenth of the noise's effect (2 mm).
        assert np.linalg.norm(window.poses[k][:3, 3] - expected) < 1e-3


def test_corners_that_jump_do_not_bend_the_window(camera: Camera) -> None:
    """Five of forty corners leap by twenty pixels in the last image, as those of a shadow do."""
    rng = np.random.default_rng(8)
    real = [pose_at(0.25 * k) for k in range(4)]
    points = np.column_stack(
        [rng.uniform(2.0, 8.0, 40), rng.uniform(-2.0, 2.0, 40), rng.uniform(-0.2, 0.2, 40)]
    )
    eyes = [pose @ camera.T_body_camera for pose in real]
    rays = np.array([(points - eye[:3, 3]) @ eye[:3, :3] for eye in eyes])
    rays /= rays[:, :, 2:]
    rays[3, :5, 0] += 20.0 / 240.0
    rays /= np.linalg.norm(rays, axis=2, keepdims=True)
    window = Window(camera, VisualOdometryConfig())
    window.begin(real[0])
    for pose in real[1:]:
        window.add(pose.copy(), RelativeMotion(0.25, np.eye(3), 0.25))
    tracks = [Track(np.zeros(2), [0, 1, 2, 3], [rays[k, j] for k in range(4)]) for j in range(40)]
    agree = window.solve(tracks)
    # All else is exact: what the leaping corners bend shows in full.
    assert max(np.abs(found - pose).max() for found, pose in zip(window.poses, real, strict=True)) < 1e-4
    assert all(agree[5:])


def test_a_horizon_that_turns_with_the_camera_leaves_the_poses_and_is_mostly_given_up(camera: Camera) -> None:
    """Drops on the lens or noise: twenty corners stay where they are in the image while the gyro turns by 170 degrees."""
    window = Window(camera, VisualOdometryConfig())
    window.begin(pose_at(0.0))
    window.add(pose_at(0.25, 170.0), RelativeMotion(0.25, pose_at(0.0, 170.0)[:3, :3], 0.25))
    ahead = np.column_stack([np.ones(20), 0.005 * np.arange(20), np.full(20, 0.05)])
    rays = ahead / np.linalg.norm(ahead, axis=1, keepdims=True) @ camera.T_body_camera[:3, :3]
    agree = window.solve([Track(np.zeros(2), [0, 1], [ray, ray]) for ray in rays])
    assert np.array_equal(window.poses[1], pose_at(0.25, 170.0))
    assert sum(agree) < 10
