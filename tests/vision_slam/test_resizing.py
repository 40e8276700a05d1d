"""Lengths of a map that creeps, by wheels whose scale is known in the end."""

import numpy as np
import pytest

from survey.arrays import FloatArray
from survey.sensors import Sightings
from vision_slam.resizing import Told, by_wheels, resized

N, STEP_M = 500, 0.2


def _poses(length: FloatArray, heading_rad: FloatArray | None = None) -> FloatArray:
    """Keyframes on level ground, so far from one another, heading so at the beginning of each step."""
    heading = np.zeros(len(length)) if heading_rad is None else heading_rad
    poses = np.tile(np.eye(4), (len(length) + 1, 1, 1))
    poses[1:, 0, 3], poses[1:, 1, 3] = (
        np.cumsum(length * np.cos(heading)),
        np.cumsum(length * np.sin(heading)),
    )
    after = np.r_[heading, heading[-1]]
    poses[:, 0, 0] = poses[:, 1, 1] = np.cos(after)
    poses[:, 1, 0] = np.sin(after)
    poses[:, 0, 1] = -poses[:, 1, 0]
    return poses


def test_a_map_that_creeps_gets_the_size_of_the_wheels() -> None:
    creep = np.linspace(1.02, 0.99, N)
    factor = by_wheels(_poses(STEP_M * creep), [Told(STEP_M, 1.0)] * N)
    # Within 10 m the map creeps by 0.3 %; half of that is missed at the ends.
    np.testing.assert_allclose(factor[1:] * creep, 1.0, atol=0.0016)


def test_the_wheels_have_the_scale_that_they_had_in_the_end() -> None:
    scale = np.linspace(1.0, 0.97, N)
    told = [Told(STEP_M * at, at) for at in scale.tolist()]
    factor = by_wheels(_poses(STEP_M * scale), told)
    np.testing.assert_allclose(factor[1:] * scale, 0.97, atol=0.0016)


def test_wheels_that_skid_in_a_turn_or_slip_are_not_asked() -> None:
    turn = (np.arange(N) >= 200) & (np.arange(N) < 250)
    slip = (np.arange(N) >= 350) & (np.arange(N) < 375)
    heading = np.cumsum(np.where(turn, np.pi / 50, 0.0))
    rolled = STEP_M * np.where(turn, 1.05, np.where(slip, 1.3, 1.02))
    factor = by_wheels(_poses(np.full(N, STEP_M), heading), [Told(told, 1.0) for told in rolled.tolist()])
    # A step or two at the edge of the turn is taken for straight: 3 % of one among fifty.
    np.testing.assert_allclose(factor, 1.02, atol=0.002)


@pytest.mark.parametrize("last", [0, 100])
def test_where_no_wheels_tell_the_size_stays_what_it_was(last: int) -> None:
    told = [Told(1.01 * STEP_M if k < last else None, 1.0 if k < last else 0.9) for k in range(N)]
    factor = by_wheels(_poses(np.full(N, STEP_M)), told)
    np.testing.assert_allclose(factor, 1.01 if last else 1.0, rtol=1e-9)


def test_standing_and_reversing_change_no_size() -> None:
    length = STEP_M * np.where(np.arange(N) // 50 % 3 == 1, 0.0, 1.0)
    told = [Told(-1.01 * step if k > 300 else 1.01 * step, 1.0) for k, step in enumerate(length.tolist())]
    np.testing.assert_allclose(by_wheels(_poses(length), told), 1.01, rtol=1e-9)
    assert by_wheels(_poses(np.zeros(3)), [Told(0.0, 1.0)] * 3).tolist() == [1.0] * 4


def test_sightings_grow_with_their_pose() -> None:
    seen = Sightings([0, 1], np.ones((2, 3)), np.tile(np.eye(3), (2, 1, 1)), [4.0, 4.0])
    grown = resized(seen, np.array([1.0, 1.1]))
    np.testing.assert_allclose(grown.offset, [[1.0] * 3, [1.1] * 3])
    np.testing.assert_allclose(grown.covariance[1], 1.21 * np.eye(3))
    np.testing.assert_allclose(grown.range_m, [4.0, 4.4])
