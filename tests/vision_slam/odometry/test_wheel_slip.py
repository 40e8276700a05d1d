"""Detection of spinning wheels by the scale of the map."""

import numpy as np
import pytest

from vision_slam.odometry.health import WheelSlipDetector

GROUND = np.column_stack([np.linspace(0.5, 2.0, 12), np.zeros(12), np.zeros(12)])


def _settled() -> WheelSlipDetector:
    watch = WheelSlipDetector(0.7)
    for _ in range(20):
        assert watch.travel_m(0.25, 0.25) == 0.25
        watch.observe(GROUND, 0.25)
    return watch


def test_wheel_spin_is_detected_at_once_and_its_end_too() -> None:
    watch = _settled()
    assert watch.travel_m(0.25, 0.05) == pytest.approx(0.05)
    assert watch.is_slipping
    assert watch.travel_m(0.25, 0.24) == 0.25
    assert not watch.is_slipping


def test_a_map_that_shrinks_slowly_is_left_to_the_wheels() -> None:
    watch = _settled()
    for k in range(30):
        assert watch.travel_m(0.25, 0.25 * 0.99**k) == 0.25


def test_before_the_map_has_a_size_the_wheels_give_it() -> None:
    assert WheelSlipDetector(0.7).travel_m(0.25, 0.1) == 0.25


def test_after_blind_frames_slip_is_unknown() -> None:
    watch = _settled()
    assert watch.travel_m(0.25, None) == 0.25
    assert watch.travel_m(0.25, 0.1) == 0.25


def test_while_wheels_spin_the_height_of_the_camera_mends_the_size() -> None:
    """The map is a third too small when the wheels begin to spin; it grows with the travel of each step."""
    watch, size = _settled(), 2.0 / 3.0
    for _ in range(300):
        seen = 0.1 * size
        travel_m = watch.travel_m(0.25, seen)
        size *= travel_m / seen
        watch.observe(GROUND + [0.0, 0.0, 0.7 * (1.0 - size)], travel_m)
    assert watch.is_slipping
    # Three times 10 m later; the mean of the height lags behind, and the size swings about its goal.
    assert travel_m == pytest.approx(0.1, rel=0.06)


def test_the_height_of_the_camera_gives_the_scale_of_the_wheels() -> None:
    """Wheels count 3 % too much; the map follows them, and the ground lies 3 % too low in it."""
    watch = WheelSlipDetector(0.7)
    for _ in range(1200):
        travel_m = watch.travel_m(0.2575, 0.25)
        size = travel_m / 0.25
        watch.observe(GROUND - [0.0, 0.0, 0.7 * (size - 1.0)], travel_m)
    # Known to 3 % before, to 1.6 % / √12 by 300 m: 0.016² / 12 / 0.03² = 2.4 % of the error is left.
    assert travel_m == pytest.approx(0.25, rel=0.03 * 0.05)


def test_a_height_that_cannot_be_is_rejected() -> None:
    watch = WheelSlipDetector(0.7)
    for _ in range(1200):
        watch.travel_m(0.25, 0.25)
        watch.observe(GROUND - [0.0, 0.0, 0.3], 0.25)
    assert watch.scale == pytest.approx(0.94, abs=0.003)


def test_wheels_that_spin_are_expected_to_go_on_spinning() -> None:
    watch = _settled()
    assert watch.share == watch.scale
    watch.travel_m(0.25, 0.05)
    assert watch.share == pytest.approx(0.2 * watch.scale, rel=0.01)
    watch.travel_m(0.25, 0.25)
    assert watch.share == watch.scale
