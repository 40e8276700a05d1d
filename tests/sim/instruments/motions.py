"""Motions with known readings, for tests of instruments."""

from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from sim.vehicle.motion import RoverMotion


def standing(seconds):
    zero, turn = np.zeros((2, 3)), np.tile([0.0, 0.0, 0.0, 1.0], (2, 1))
    return RoverMotion(np.array([0.0, seconds]), zero, turn, zero, zero, np.zeros((2, 2)))


def circling(seconds=10.0, rate=0.5, radius=4.0, hz=80):
    """Motion on a level circle: all that sensors read of it is known."""
    t = np.arange(round(seconds * hz) + 1) / hz
    angle = rate * t
    position = radius * np.column_stack([np.sin(angle), 1.0 - np.cos(angle), 0.0 * t])
    velocity = radius * rate * np.column_stack([np.cos(angle), np.sin(angle), 0.0 * t])
    turn = Rotation.from_euler("z", angle[:, None]).as_quat()
    spin = np.tile([0.0, 0.0, rate], (len(t), 1))
    rolled = np.column_stack([(radius - 0.2) * angle, (radius + 0.2) * angle])
    return RoverMotion(t, position, turn, velocity, spin, rolled)


def parts_of(motion, n):
    """Return the same motion in stretches that overlap by one state."""
    edges = np.linspace(0, len(motion.time_s) - 1, n + 1).astype(int)
    for first, last in pairwise(edges):
        window = slice(max(first - 4, 0), last + 1)
        yield RoverMotion(*(getattr(motion, f)[window] for f in RoverMotion.__dataclass_fields__))
