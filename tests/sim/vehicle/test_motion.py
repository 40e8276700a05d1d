"""Motion between states: positions, attitudes, poses."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sim.vehicle.motion import RoverMotion, RoverState


def turning() -> RoverMotion:
    """A quarter turn to the left in 1 s, 2 m to the east."""
    quarter = Rotation.from_euler("z", 90.0, degrees=True).as_quat()
    states = [
        RoverState(
            0.0, (0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 1.0), (2.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0), 0.0
        ),
        RoverState(1.0, (2.0, 0.0, 3.0), tuple(quarter), (2.0, 0.0, 4.0), (0.0, 0.0, 1.0), (1.0, 3.0), 5.0),
    ]
    return RoverMotion.of(states)


def test_states_are_interpolated():
    motion, at = turning(), np.array([0.0, 0.25, 1.0])
    np.testing.assert_allclose(motion.position_at(at), [[0.0, 0.0, 1.0], [0.5, 0.0, 1.5], [2.0, 0.0, 3.0]])
    np.testing.assert_allclose(motion.velocity_at(at)[:, 2], [0.0, 1.0, 4.0])
    np.testing.assert_allclose(motion.rolled_at(at), [[0.0, 0.0], [0.25, 0.75], [1.0, 3.0]])
    assert motion.rotation_at(at).as_euler("zyx", degrees=True)[:, 0] == pytest.approx([0.0, 22.5, 90.0])


def test_a_pose_takes_the_body_to_the_world():
    ahead = turning().pose_at(1.0) @ [1.0, 0.0, 0.0, 1.0]
    np.testing.assert_allclose(ahead, [2.0, 1.0, 3.0, 1.0], atol=1e-12)


def test_times_beyond_the_stretch_take_its_ends():
    motion = turning()
    np.testing.assert_allclose(motion.pose_at(5.0), motion.pose_at(1.0))
