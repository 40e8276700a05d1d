"""Correction of scale drift by wheels and by the ground below the body."""

import numpy as np
import pytest

from survey.core.arrays import FloatArray, IntArray
from survey.data.sensors.odometry import Sightings
from vision_slam.odometry.scale_drift import camera_height_ratio, scale_corrections, scale_sightings

N, STEP_M = 500, 0.2
HEIGHT_M = 0.7
NO_GROUND = np.full(N + 1, np.nan)


def _poses(length: FloatArray, heading_rad: FloatArray | None = None) -> FloatArray:
    """Keyframes on level ground, so far from one another, heading so at the beginning of each step."""
    heading = np.zeros(len(length)) if heading_rad is None else heading_rad
    poses = np.tile(np.eye(4), (len(length) + 1, 1, 1))
    poses[1:, 0, 3] = np.cumsum(length * np.cos(heading))
    poses[1:, 1, 3] = np.cumsum(length * np.sin(heading))
    after = np.r_[heading, heading[-1]]
    poses[:, 0, 0] = poses[:, 1, 1] = np.cos(after)
    poses[:, 1, 0] = np.sin(after)
    poses[:, 0, 1] = -poses[:, 1, 0]
    return poses


def _ground(too_large: FloatArray) -> FloatArray:
    """Return the log scale from the ground for a map that is too large by these factors, step by step."""
    log_scale: FloatArray = np.r_[np.nan, -np.log(too_large)]
    return log_scale


def test_a_map_that_creeps_gets_its_size_from_wheels_and_ground() -> None:
    creep = np.linspace(1.02, 0.97, N)
    factor = scale_corrections(_poses(STEP_M * creep), np.full(N, STEP_M), _ground(creep))
    # It creeps by 0.05 % a metre; the memory of some metres misses that at the ends alone.
    np.testing.assert_allclose(factor[:-1] * creep, 1.0, atol=0.001)


def test_wheels_that_count_too_much_all_along_are_found_out_by_the_ground() -> None:
    creep = np.linspace(1.04, 1.0, N)
    factor = scale_corrections(_poses(STEP_M * creep), np.full(N, 1.03 * STEP_M), _ground(creep))
    # Before, wheels are known to 3 % and the height to 0.5 %: by (0.5 / 3)² of 3 % the wheels win.
    np.testing.assert_allclose(factor[:-1] * creep, 1.03 ** (1.0 / 37.0), atol=0.001)


def test_where_ground_is_missing_the_wheels_give_the_scale() -> None:
    creep = np.linspace(1.02, 0.99, N)
    ground = _ground(creep)
    ground[100:300] = np.nan
    factor = scale_corrections(_poses(STEP_M * creep), np.full(N, STEP_M), ground)
    np.testing.assert_allclose(factor[:-1] * creep, 1.0, atol=0.001)


def test_where_wheels_are_missing_the_ground_gives_the_scale() -> None:
    creep = np.linspace(1.02, 0.97, N)
    rolled = np.full(N, STEP_M)
    rolled[100:300] = np.nan
    factor = scale_corrections(_poses(STEP_M * creep), rolled, _ground(creep))
    np.testing.assert_allclose(factor[:-1] * creep, 1.0, atol=0.001)


def test_without_wheels_or_ground_the_size_stays_what_it_is() -> None:
    poses, rolled = _poses(np.full(N, STEP_M)), np.full(N, 1.1 * STEP_M)
    assert scale_corrections(poses, np.full(N, np.nan), _ground(np.full(N, 1.1))).tolist() == [1.0] * (N + 1)
    assert scale_corrections(poses, rolled, NO_GROUND).tolist() == [1.0] * (N + 1)
    assert scale_corrections(poses, rolled, np.where(np.arange(N + 1) < 40, -0.1, np.nan)).tolist() == [
        1.0
    ] * (N + 1)
    assert scale_corrections(poses[:1], np.zeros(0), NO_GROUND[:1]).tolist() == [1.0]


def test_wheels_that_skid_in_a_turn_or_spin_are_rejected() -> None:
    turn = (np.arange(N) >= 200) & (np.arange(N) < 250)
    spin = (np.arange(N) >= 350) & (np.arange(N) < 375)
    heading = np.cumsum(np.where(turn, np.pi / 50, 0.0))
    rolled = STEP_M * np.where(turn, 1.05, np.where(spin, 2.0, 1.0))
    factor = scale_corrections(_poses(np.full(N, STEP_M), heading), rolled, _ground(np.ones(N)))
    # Cauchy's loss leaves steps that are off by log 2, 20 sigma, a forty-fifth of their say: 0.69 / 45 = 1.5 %.
    np.testing.assert_allclose(factor, 1.0, atol=0.02)
    np.testing.assert_allclose(factor[:340], 1.0, atol=0.002)


def test_a_mounting_that_cannot_be_is_rejected() -> None:
    factor = scale_corrections(_poses(np.full(N, STEP_M)), np.full(N, STEP_M), _ground(np.full(N, 1.3)))
    np.testing.assert_allclose(
        factor, np.exp(-0.06), rtol=1e-3
    )  # the loss lets wheels and ground disagree a little


def test_standing_turning_on_the_spot_and_reversing_change_no_size() -> None:
    stands, ground = np.arange(N) // 50 % 3 == 1, _ground(np.full(N, 1.01))
    length = STEP_M * np.where(stands, 0.0, 1.0)
    rolled = length / 1.01 * np.where(np.arange(N) > 300, -1.0, 1.0)
    np.testing.assert_allclose(scale_corrections(_poses(length), rolled, ground), 1.0 / 1.01, rtol=1e-3)
    on_the_spot = _poses(np.full(N, 1e-4), 0.05 * np.arange(N, dtype=np.float64))
    assert scale_corrections(on_the_spot, np.full(N, 0.03), ground).tolist() == [1.0] * (N + 1)


def _strip(z_m: float) -> FloatArray:
    """Ground along the way at one height, a point every 10 cm to either side."""
    x = np.arange(0.0, 20.0, 0.1)
    return np.column_stack([np.tile(x, 2), np.repeat([-0.2, 0.2], len(x)), np.full(2 * len(x), z_m)])


def _seen(points: FloatArray, poses: FloatArray) -> tuple[Sightings, IntArray]:
    """Sightings of points from the keyframe 1 m before them."""
    k = np.searchsorted(poses[:, 0, 3], points[:, 0] - 1.0).clip(max=len(poses) - 1)
    offset = points - poses[k, :3, 3]
    return Sightings(k, offset, np.tile(np.eye(3), (len(k), 1, 1)), np.ones(len(k))), k


def test_the_ground_below_the_body_gives_the_scale_of_the_map() -> None:
    poses = _poses(np.full(100, STEP_M))
    log_scale = camera_height_ratio(poses, *_seen(_strip(-0.07), poses), HEIGHT_M)
    np.testing.assert_allclose(log_scale[5:-5], np.log(0.7 / 0.77))
    raised = camera_height_ratio(poses, *_seen(np.vstack([_strip(0.0), _strip(-0.36)]), poses), HEIGHT_M)
    np.testing.assert_allclose(raised[5:-5], 0.0)  # what lies deeper than half the height is no ground


@pytest.mark.parametrize("height_m", [0.0, -1.0])
def test_a_camera_without_height_gives_no_scale(height_m: float) -> None:
    poses = _poses(np.full(100, STEP_M))
    assert np.isnan(camera_height_ratio(poses, *_seen(_strip(0.0), poses), height_m)).all()


def test_what_was_seen_long_ago_or_hardly_is_no_ground() -> None:
    poses = _poses(np.full(100, STEP_M))
    sightings, k = _seen(_strip(0.0), poses)
    early = Sightings(0 * k, sightings.offset + poses[k, :3, 3], sightings.covariance, sightings.range_m)
    log_scale = camera_height_ratio(poses, early, 0 * k, HEIGHT_M)
    assert np.isfinite(log_scale[5:41]).all()
    assert np.isnan(log_scale[41:]).all()
    few = Sightings(k[:3], sightings.offset[:3], sightings.covariance[:3], sightings.range_m[:3])
    assert np.isnan(camera_height_ratio(poses, few, k[:3], HEIGHT_M)).all()


def test_sightings_grow_with_their_pose() -> None:
    seen = Sightings(np.arange(2), np.ones((2, 3)), np.tile(np.eye(3), (2, 1, 1)), np.full(2, 4.0))
    grown = scale_sightings(seen, np.array([1.0, 1.1]))
    np.testing.assert_allclose(grown.offset, [[1.0] * 3, [1.1] * 3])
    np.testing.assert_allclose(grown.covariance[1], 1.21 * np.eye(3))
    np.testing.assert_allclose(grown.range_m, [4.0, 4.4])
