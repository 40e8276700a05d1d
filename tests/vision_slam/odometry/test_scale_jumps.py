"""Jumps of the scale of the images' map, found by wheels and confirmed by the ground."""

import numpy as np
import pytest

from survey.core.arrays import FloatArray
from survey.data.sensors.odometry import Sightings
from survey.data.sensors.records import Wheels
from vision_slam.odometry.health import FrameHealth
from vision_slam.odometry.scale_drift import bridge_scale_jumps, scale_jumps, travel_between

N, STEP_M, HEIGHT_M = 200, 0.25, 0.7
JUMPED = slice(80, 92)


def seen_ground(depth_m: FloatArray, per_pose: int = 4) -> Sightings:
    """Landmarks 1.5 m ahead of each pose, at a depth below it."""
    pose = np.repeat(np.arange(len(depth_m)), per_pose)
    offset = np.column_stack([np.full(len(pose), 1.5), np.zeros(len(pose)), -depth_m[pose]])
    covariance = np.tile(1e-4 * np.eye(3), (len(pose), 1, 1))
    return Sightings(pose, offset, covariance, np.full(len(pose), 6.0))


def jumped(factor: float, where: slice = JUMPED) -> tuple[FloatArray, Sightings]:
    """Return steps of a map that is too large by a factor somewhere, and the ground that it shows there."""
    step, depth = np.full(N, STEP_M), np.zeros(N + 1)
    step[where] *= factor
    depth[where] = (factor - 1.0) * HEIGHT_M
    return step, seen_ground(depth)


@pytest.mark.parametrize("factor", [1.3, 2.1])
def test_steps_of_a_map_that_is_too_large_get_the_length_of_the_wheels(factor: float) -> None:
    step, ground = jumped(factor)
    found = scale_jumps(step, np.full(N, STEP_M), ground, HEIGHT_M)
    inside = slice(JUMPED.start + 3, JUMPED.stop - 3)
    np.testing.assert_allclose(found[inside] * step[inside], STEP_M, rtol=1e-6)
    assert (found[: JUMPED.start - 4] == 1.0).all()
    assert (found[JUMPED.stop + 4 :] == 1.0).all()


def test_wheels_that_slip_or_skid_change_nothing() -> None:
    rolled = np.full(N, STEP_M)
    rolled[JUMPED] *= 2.5
    assert (scale_jumps(np.full(N, STEP_M), rolled, seen_ground(np.zeros(N + 1)), HEIGHT_M) == 1.0).all()


def test_a_body_that_slides_with_its_wheels_at_rest_keeps_its_steps() -> None:
    rolled = np.full(N, STEP_M)
    rolled[JUMPED] *= 0.3  # and the ground stays where it is
    assert (scale_jumps(np.full(N, STEP_M), rolled, seen_ground(np.zeros(N + 1)), HEIGHT_M) == 1.0).all()


def test_wheels_that_count_too_little_for_long_are_wrong_themselves() -> None:
    rolled = np.full(N, STEP_M)
    rolled[: N // 4] *= 0.5
    none = seen_ground(np.zeros(0))
    assert (scale_jumps(np.full(N, STEP_M), rolled, none, HEIGHT_M) == 1.0).all()
    assert (scale_jumps(np.full(N, STEP_M), 0.5 * np.full(N, STEP_M), none, HEIGHT_M) == 1.0).all()


def test_gaps_of_the_wheels_are_no_jumps() -> None:
    step, ground = jumped(2.0)
    rolled = np.full(N, STEP_M)
    rolled[JUMPED.start - 5 : JUMPED.stop + 5] = np.nan
    assert (scale_jumps(step, rolled, ground, HEIGHT_M) == 1.0).all()


def test_the_first_metre_has_the_scale_of_a_jump_that_follows_it() -> None:
    # Wheels spin when a rover sets off: wheels and map both count too much there.
    step, ground = jumped(2.0, slice(0, 14))
    rolled = np.full(N, STEP_M)
    rolled[:2] *= 2.0
    found = scale_jumps(step, rolled, ground, HEIGHT_M)
    assert (found[:12] < 0.65).all()


def test_landmarks_beside_a_jump_are_left_out_and_its_steps_rest_on_the_wheels() -> None:
    step, ground = jumped(2.0)
    steps = np.column_stack([step, np.zeros((N, 2))])
    health = tuple(FrameHealth(6.0, 0.0, 15.0, 200, 200, is_visual=True) for _ in range(N + 1))
    corrected, seen, bridged = bridge_scale_jumps(steps, np.full(N, STEP_M), ground, health, HEIGHT_M)
    assert corrected[:, 0].sum() == pytest.approx(N * STEP_M, abs=0.5)
    assert (np.abs(seen.offset[:, 2]) < 1e-9).all()
    assert len(seen.pose) > 0.85 * len(ground.pose)
    is_visual = np.array([frame.is_visual for frame in bridged])
    assert not is_visual[JUMPED.start + 1 : JUMPED.stop + 1].any()
    assert is_visual.mean() > 0.9


def test_travel_beyond_the_record_of_the_wheels_is_not_known() -> None:
    wheels = Wheels([1.0, 2.0, 3.0], [0.0, 1.0, 2.0], [0.0, 1.2, 2.4])
    np.testing.assert_allclose(travel_between(wheels, np.array([0.0, 1.0, 2.5, 4.0])), [np.nan, 1.65, np.nan])


def test_wheels_that_are_read_too_seldom_show_no_jump() -> None:
    images_s = np.arange(0.0, 4.0, 0.25)
    every_second = Wheels(np.arange(5.0), np.arange(5.0), np.arange(5.0))
    assert np.isnan(travel_between(every_second, images_s)).all()
    with_a_gap = Wheels(
        np.r_[0.0:1.0:0.1, 3.0:4.1:0.1], np.r_[0.0:1.0:0.1, 3.0:4.1:0.1], np.r_[0.0:1.0:0.1, 3.0:4.1:0.1]
    )
    measured = np.isfinite(travel_between(with_a_gap, images_s))
    np.testing.assert_array_equal(measured, (images_s[1:] < 0.95) | (images_s[:-1] > 3.05))
