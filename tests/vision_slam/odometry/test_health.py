"""Health of frames."""

import numpy as np

from vision_slam.odometry.health import FrameHealth, is_lost


def _blind_from_the_third(n: int = 6) -> tuple[FrameHealth, ...]:
    return tuple(FrameHealth(5.0, 0.0, 2.0, is_visual=0 < index < 3) for index in range(n))


def test_without_wheels_a_pose_that_no_image_shows_is_lost_at_once() -> None:
    poses = np.tile(np.eye(4), (6, 1, 1))
    poses[:, 0, 3] = np.arange(6.0)
    health = _blind_from_the_third()
    assert is_lost(poses, health, has_wheels=False).tolist() == [False] * 3 + [True] * 3
    assert not is_lost(poses, health, has_wheels=True).any()
