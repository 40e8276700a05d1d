"""Bundle adjustment in a sliding window against least squares and wrong corners."""

from itertools import pairwise

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from survey.core.arrays import FloatArray
from survey.data.camera import Camera
from tests.vision_slam.odometry.poses import pose_at
from vision_slam.config import VisualOdometryConfig
from vision_slam.motion import RelativeMotion
from vision_slam.odometry.tracks import Track
from vision_slam.odometry.window import Window, half_turned


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
    rays = np.concatenate([plane, np.ones((4, 40, 1))], axis=2)
    rays /= np.linalg.norm(rays, axis=2, keepdims=True)
    tracks = [Track(np.zeros(2), [0, 1, 2, 3], [rays[k, j] for k in range(4)]) for j in range(40)]
    for _ in range(4):
        window.solve(tracks)

    def robust(off: FloatArray, width: float) -> FloatArray:
        """Return Cauchy's loss of vectors (N, D) as residuals: c √ln(1 + |e|²/c²) along e."""
        length = np.linalg.norm(off, axis=1, keepdims=True) + 1e-12
        residuals: FloatArray = off / length * width * np.sqrt(np.log1p((length / width) ** 2))
        return residuals.ravel()

    def moved(k: int, x: FloatArray) -> FloatArray:
        body = real[k].copy()
        body[:3, :3] = body[:3, :3] @ Rotation.from_rotvec(x[6 * k - 6 : 6 * k - 3]).as_matrix()
        body[:3, 3] += x[6 * k - 3 : 6 * k]
        return body

    def residual(x: FloatArray) -> FloatArray:
        bodies = [real[0], *(moved(k, x) for k in (1, 2, 3))]
        place = x[18:].reshape(40, 3)
        parts = []
        for k, body in enumerate(bodies):
            eye = body @ camera.T_body_camera
            inside = (place - eye[:3, 3]) @ eye[:3, :3]
            weight = rays[k, :, 2:] ** 1.5 / sigma
            off = (inside[:, :2] / inside[:, 2:] - plane[k]) * weight
            parts.append((off / np.sqrt(1.0 + (off**2).sum(axis=1, keepdims=True) / 25.0)).ravel())
        for k in range(3):
            step, measured = (np.linalg.inv(one[k]) @ one[k + 1] for one in (bodies, real))
            travel = float(np.linalg.norm(measured[:3, 3]))
            half = Rotation.from_matrix(measured[:3, :3]) ** 0.5
            off = half.inv().apply(step[:3, 3]) - [travel, 0.0, 0.0]
            turn = Rotation.from_matrix(measured[:3, :3].T @ step[:3, :3]).as_rotvec()
            parts.append(turn / np.radians(config.gyro_sigma_deg * 0.25**0.5))
            parts.append(robust(off[None, :1] / (config.wheel_sigma * travel + 0.002), 3.0))
            parts.append(robust(off[None, 1:] / (config.lateral_sigma * travel + 0.005), 3.0))
        return np.concatenate(parts)

    judge = least_squares(residual, np.r_[np.zeros(18), points.ravel()], xtol=1e-12, ftol=1e-12)
    for k in (1, 2, 3):
        # The effect of the noise is 2 mm.
        assert np.linalg.norm(window.poses[k][:3, 3] - moved(k, judge.x)[:3, 3]) < 5e-5


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


def _seen_from(camera: Camera, real: list[FloatArray], points: FloatArray, noise: float) -> list[Track]:
    """Return tracks of points (N, 3) that all poses saw, with so much noise [rad]."""
    rng = np.random.default_rng(9)
    eyes = [pose @ camera.T_body_camera for pose in real]
    rays = np.array([(points - eye[:3, 3]) @ eye[:3, :3] for eye in eyes])
    rays /= rays[:, :, 2:]
    rays[:, :, :2] += noise * rng.standard_normal(rays[:, :, :2].shape)
    rays /= np.linalg.norm(rays, axis=2, keepdims=True)
    return [Track(np.zeros(2), list(range(len(real))), [ray[j] for ray in rays]) for j in range(len(points))]


def test_facades_above_the_horizon_get_their_distance_and_ridges_are_directions(camera: Camera) -> None:
    """Twenty corners 40 m off and 6 m up, twenty at 8 km, and forty on the ground, over 8 m of travel."""
    rng = np.random.default_rng(7)
    real = [pose_at(k) for k in range(9)]
    aside = rng.uniform(-0.4, 0.4, 20)
    facade = np.column_stack([np.full(20, 40.0), 30.0 * aside, np.full(20, 6.0)])
    ridge = 8000.0 * np.column_stack([np.ones(20), aside, np.full(20, 0.05)])
    ground = np.column_stack([rng.uniform(12.0, 20.0, 40), rng.uniform(-5.0, 5.0, 40), np.zeros(40)])
    window = Window(camera, VisualOdometryConfig())
    window.begin(real[0])
    for pose in real[1:]:
        window.add(pose.copy(), RelativeMotion(1.0, np.eye(3), 1.0))
    noise = 0.25 / camera.matrix[0, 0]
    tracks = _seen_from(camera, real, np.vstack([facade, ridge, ground]), noise)
    assert all(window.solve(tracks))
    known = np.array([track.point for track in tracks[:20] if track.point is not None])
    assert len(known) >= 12
    assert abs(np.median(known[:, 0]) - 40.0) < 4.0
    assert not any(track.is_far for track in tracks[:20])
    assert all(track.point is None for track in tracks[20:40])


def test_a_first_step_of_slipping_wheels_does_not_settle_the_scale(camera: Camera) -> None:
    """The wheels spin at the start and count twice the first step; the map begins at twice its size."""
    rng = np.random.default_rng(10)
    real = [pose_at(0.0), *(pose_at(0.125 + 0.25 * k) for k in range(7))]
    points = np.column_stack(
        [rng.uniform(3.0, 9.0, 60), rng.uniform(-2.0, 2.0, 60), rng.uniform(-0.2, 0.2, 60)]
    )
    all_tracks = _seen_from(camera, real, points, 0.0)
    window = Window(camera, VisualOdometryConfig())
    window.begin(real[0])
    tracks = [Track(np.zeros(2), [0], track.rays[:1]) for track in all_tracks]
    for k in range(1, len(real)):
        guess = window.poses[-1].copy()
        guess[0, 3] += 2.0 * (real[k][0, 3] - real[k - 1][0, 3])
        window.add(guess, RelativeMotion(0.25, np.eye(3), 0.25))
        for track, complete in zip(tracks, all_tracks, strict=True):
            track.add_observation(k, complete.rays[k])
        window.solve(tracks)
    assert abs(window.poses[-1][0, 3] - real[-1][0, 3]) < 0.02


def test_a_horizon_that_turns_with_the_camera_is_given_up_and_leaves_the_pose_to_wheels_and_gyro(
    camera: Camera,
) -> None:
    """Drops on the lens or noise: twenty corners stay where they are in the image while the gyro turns by 170 degrees."""
    window = Window(camera, VisualOdometryConfig())
    window.begin(pose_at(0.0))
    measured = pose_at(0.0, 170.0)
    measured[:3, 3] = half_turned(measured[:3, :3]) @ [0.25, 0.0, 0.0]
    window.add(measured.copy(), RelativeMotion(0.25, measured[:3, :3], 0.25))
    ahead = np.column_stack([np.ones(20), 0.005 * np.arange(20), np.full(20, 0.05)])
    rays = ahead / np.linalg.norm(ahead, axis=1, keepdims=True) @ camera.T_body_camera[:3, :3]
    agree = window.solve([Track(np.zeros(2), [0, 1], [ray, ray]) for ray in rays])
    np.testing.assert_allclose(window.poses[1], measured, atol=1e-12)
    assert sum(agree) < 10
