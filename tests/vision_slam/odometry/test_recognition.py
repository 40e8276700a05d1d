"""The last view before sight was lost, found again on ground that is known exactly."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from survey.core.arrays import FloatArray
from survey.data.camera import Camera
from tests.vision_slam.conftest import PlaneWorld
from vision_slam.config import VisualOdometryConfig
from vision_slam.motion import RelativeMotion
from vision_slam.odometry.resection import ViewRecognizer
from vision_slam.odometry.tracks import ContrastEnhancer
from vision_slam.odometry.visual_slam import VisualSlam

N_SEEN = 9
STEP_M = 0.2


def _pose(x_m: float, y_m: float = 0.0, yaw_deg: float = 0.0) -> FloatArray:
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("z", yaw_deg, degrees=True).as_matrix()
    pose[:2, 3] = x_m, y_m
    return pose


@pytest.fixture(scope="module")
def elsewhere(camera: Camera) -> PlaneWorld:
    return PlaneWorld(camera, seed=9)


def _views(world: PlaneWorld, camera: Camera) -> tuple[ViewRecognizer, list[FloatArray]]:
    """Views of a straight metre and a half, with exact poses."""
    config = VisualOdometryConfig()
    views, poses = ViewRecognizer(camera, config), [_pose(STEP_M * k) for k in range(N_SEEN)]
    enhance = ContrastEnhancer(config.clahe_clip, config.clahe_tiles)
    for k, pose in enumerate(poses):
        views.add_view(k, enhance(world.image(pose)), poses)
    return views, poses


def test_a_rover_that_was_moved_asleep_is_found_with_the_error_that_it_claims(
    plane_world: PlaneWorld, camera: Camera
) -> None:
    views, poses = _views(plane_world, camera)
    views.add_motion(RelativeMotion(60.0, None, None))
    enhance, rng = ContrastEnhancer(4.0, 8), np.random.default_rng(3)
    squared = []
    for _ in range(6):
        moved = poses[-1] @ _pose(rng.uniform(-0.3, 0.5), rng.uniform(-0.2, 0.2), rng.uniform(-8.0, 8.0))
        met = views.recognize(enhance(plane_world.image(moved)), poses[-1], poses)
        assert met is not None
        off = np.linalg.inv(met.pose) @ moved
        error = np.r_[Rotation.from_matrix(off[:3, :3]).as_rotvec(), off[:3, 3]]
        # Drawn images without noise, from exact poses: a centimetre is a pixel of the ground half a metre off.
        assert np.linalg.norm(error[3:]) < 0.02
        squared.append(error @ np.linalg.solve(met.covariance, error))
    # Six degrees of freedom; the errors of a map that was driven are claimed, but not in these poses.
    assert np.mean(squared) < 6.0


def test_other_ground_is_not_recognized(
    plane_world: PlaneWorld, elsewhere: PlaneWorld, camera: Camera
) -> None:
    views, poses = _views(plane_world, camera)
    views.add_motion(RelativeMotion(60.0, None, None))
    enhance = ContrastEnhancer(4.0, 8)
    for yaw_deg in (0.0, 20.0):
        image = enhance(elsewhere.image(poses[-1] @ _pose(0.1, yaw_deg=yaw_deg)))
        assert views.recognize(image, poses[-1], poses) is None
    blank = np.full((camera.height, camera.width), 90, np.uint8)
    assert views.recognize(blank, poses[-1], poses) is None


def test_a_gyro_that_went_on_is_not_contradicted(plane_world: PlaneWorld, camera: Camera) -> None:
    views, poses = _views(plane_world, camera)
    views.add_motion(RelativeMotion(1.0, np.eye(3), 0.1))
    image = ContrastEnhancer(4.0, 8)(plane_world.image(poses[-1] @ _pose(0.1, yaw_deg=6.0)))
    assert views.recognize(image, poses[-1] @ _pose(0.1), poses) is None
    assert views.recognize(image, poses[-1] @ _pose(0.1, yaw_deg=6.0), poses) is not None


def test_wheels_that_spin_in_a_white_out_are_found_out_after_it(
    plane_world: PlaneWorld, camera: Camera
) -> None:
    # Nine frames seen, four blank with wheels that count 0.6 m for 0.15 m, six seen.
    places = [*(STEP_M * k for k in range(9)), *(1.6 + 0.15 * k for k in range(1, 5))]
    places += [2.2 + STEP_M * k for k in range(1, 7)]
    slam = VisualSlam(camera)
    for k, x_m in enumerate(places):
        is_blank = 9 <= k < 13
        image = np.full((240, 320), 230, np.uint8) if is_blank else plane_world.image(_pose(x_m))
        rolled = 0.6 if is_blank else STEP_M
        slam.step(image, 0.25 * k, RelativeMotion(0.25, np.eye(3), rolled) if k else None)
    health = [frame.health for frame in slam.frames]
    assert not any(frame.is_visual for frame in health[9:13])
    assert health[13].is_recognized
    assert all(frame.is_visual and not frame.is_recognized for frame in health[14:])
    # The wheels alone would end 1.8 m too far; recognized is the last view to 4 % of 0.8 m.
    assert abs(slam.pose(slam.frames[-1])[0, 3] - places[-1]) < 0.06


def test_few_corners_that_deny_the_wheels_are_doubted(plane_world: PlaneWorld, camera: Camera) -> None:
    # Of 1200 corners that are wanted the ground gives fewer than a quarter; from the thirteenth frame on the wheels spin.
    slam = VisualSlam(camera, VisualOdometryConfig(n_features=1200))
    for k in range(20):
        motion = None if k == 0 else RelativeMotion(0.25, np.eye(3), 0.2 if k < 12 else 0.3)
        slam.step(plane_world.image(_pose(0.2 * k)), 0.25 * k, motion)
    is_visual = [frame.health.is_visual for frame in slam.frames]
    # It takes ten keyframes until the wheels' scale is known, and a frame until what is said counts.
    assert all(is_visual[1:13])
    assert not any(is_visual[18:])
