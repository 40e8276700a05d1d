"""Health of frames."""

import numpy as np
import pytest

from vision_slam.odometry.health import FrameHealth, bridged_errors, is_lost


def _blind_from_the_third(n: int = 6) -> tuple[FrameHealth, ...]:
    return tuple(FrameHealth(5.0, 0.0, 2.0, is_visual=0 < index < 3) for index in range(n))


def test_without_wheels_a_pose_that_no_image_shows_is_lost_at_once() -> None:
    poses = np.tile(np.eye(4), (6, 1, 1))
    poses[:, 0, 3] = np.arange(6.0)
    health = _blind_from_the_third()
    assert is_lost(poses, health, has_wheels=False).tolist() == [False] * 3 + [True] * 3
    assert not is_lost(poses, health, has_wheels=True).any()


def test_a_gap_without_wheels_errs_by_half_of_its_length_and_by_an_unknown_turn() -> None:
    steps, seconds = np.tile([1.0, 0.0, 0.0], (4, 1)), np.array([0.5, 4.0, 4.0, 0.5])
    seen, blind = FrameHealth(5.0, 0.0, 20.0, 200, 180, is_visual=True), FrameHealth(5.0, 0.0, 20.0)
    health = (seen, seen, blind, blind, seen)
    guessed = bridged_errors(steps, seconds, health, has_wheels=False, has_gyro=False)
    assert float(np.sqrt((guessed.step_m**2).sum())) == pytest.approx(0.5 * 2.0)
    assert float(np.sqrt((guessed.turn_rad**2).sum())) == pytest.approx(1.0)
    assert guessed.step_m[[0, 3]].tolist() == guessed.turn_rad[[0, 3]].tolist() == [0.0, 0.0]
    rolled = bridged_errors(steps, seconds, health, has_wheels=True, has_gyro=True)
    assert float(np.sqrt((rolled.step_m**2).sum())) == pytest.approx(0.05 * 2.0)
    assert not rolled.turn_rad.any()
