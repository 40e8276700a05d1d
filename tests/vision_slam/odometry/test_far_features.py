"""The heading that far ridges hold, along drives and by ridges that are known."""

import numpy as np
from scipy.spatial.transform import Rotation

from survey.core.arrays import FloatArray
from survey.data.camera import Camera
from vision_slam.odometry.landmarks import FarFeatures
from vision_slam.odometry.tracks import Track

N, STEP_M = 1000, 0.2
PLACE = np.column_stack([STEP_M * np.arange(N), np.zeros(N), np.zeros(N)])
# As a window sees it that takes ridges for infinitely far: steadily to one side, and a little to and fro.
DRIFT_RAD = np.radians(1.5 * np.arange(N) / N + 0.2 * np.sin(np.arange(N) / 80.0))
TURN = Rotation.from_euler("z", DRIFT_RAD[:, None]).as_matrix()


def _ridge(camera: Camera, bearing_deg: float, distance_m: float, rng: np.random.Generator) -> Track:
    """A corner 3° above the horizon, followed for 40 m or more, good to 0.3 pixels, as the rover sees it that heads along x."""
    first = int(rng.integers(0, N - 200))
    seen = np.arange(first, min(N, first + int(rng.integers(200, 700))))
    bearing = np.radians(bearing_deg)
    point = PLACE[first] + distance_m * np.array([np.cos(bearing), np.sin(bearing), np.tan(np.radians(3.0))])
    rays = (point - PLACE[seen]) @ camera.T_body_camera[:3, :3]
    rays[:, :2] += rays[:, 2:] * rng.normal(0.0, 0.3 / camera.matrix[0, 0], (len(seen), 2))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    return Track(np.zeros(2), seen.tolist(), list(rays), is_far=True)


def _drift(camera: Camera, tracks: list[Track]) -> FloatArray:
    far_features = FarFeatures(camera)
    far_features.add(tracks)
    return far_features.drift_rad(TURN, PLACE, np.arange(N))


def _one_sided(camera: Camera, rng: np.random.Generator) -> list[Track]:
    return [
        _ridge(camera, float(bearing), float(distance), rng)
        for bearing, distance in zip(rng.uniform(-10.0, 32.0, 60), rng.uniform(5e3, 12e3, 60), strict=True)
    ]


def test_ridges_to_one_side_hold_the_heading(camera: Camera) -> None:
    drift = _drift(camera, _one_sided(camera, np.random.default_rng(3)))
    # A pixel is 0.14 degrees; ten ridges at a time and their parallax leave a third of it.
    np.testing.assert_allclose(np.degrees(drift - DRIFT_RAD), 0.0, atol=0.1)


def test_corners_that_creep_are_outvoted(camera: Camera) -> None:
    rng = np.random.default_rng(4)
    tracks = _one_sided(camera, rng)
    for track in tracks[::5]:
        for k, ray in enumerate(track.rays):
            ray[0] += 0.02 * (k / len(track.rays)) ** 2
    np.testing.assert_allclose(np.degrees(_drift(camera, tracks) - DRIFT_RAD), 0.0, atol=0.2)


def test_ground_and_corners_seen_for_a_moment_say_nothing(camera: Camera) -> None:
    rng = np.random.default_rng(5)
    near, short, low = (_ridge(camera, 20.0, 6000.0, rng) for _ in range(3))
    near.is_far = False
    short.keyframes, short.rays = short.keyframes[:50], short.rays[:50]
    low.rays = [ray + camera.T_body_camera[:3, :3].T @ [0.0, 0.0, -0.06] for ray in low.rays]
    np.testing.assert_array_equal(_drift(camera, [near, short, low]), np.zeros(N))
