"""World attitude: roll and pitch from gravity, heading from compass or GPS track."""

import numpy as np
from scipy.spatial.transform import Rotation

from survey.core.arrays import FloatArray, IntArray
from survey.data.sensors.aiding import Compass, GpsFixes
from vision_slam.io.sequence import VisionRecords

_TIME_S = 30.0
_HOLE_S = 1.5
_LONG_ENOUGH_M = 20.0
_OUTLYING_M = 2.0


def world_attitudes(rotations: FloatArray, time_s: FloatArray, recording: VisionRecords) -> FloatArray:
    """Return roll, pitch, yaw (N, 3) [rad] of a body from its rotations (N, 3, 3) by images.

    The specific force, turned into the frame of the first image and averaged over 30 s to
    either side, points up: accelerations of the rover cancel over that time, a constant bias of
    the accelerometer does not. Where the records have a gap, each side is averaged by itself.
    The heading starts with the compass, or at 0 without one.
    """
    upright = _upright(rotations, time_s, recording) @ rotations
    attitude: FloatArray = Rotation.from_matrix(upright).as_euler("xyz")
    compass = recording.compass
    attitude[:, 2] += (0.0 if compass is None else initial_heading(compass, time_s[0])) - attitude[0, 2]
    attitude[:, 2] = np.unwrap(attitude[:, 2])
    return attitude


def heading_correction(path: FloatArray, time_s: FloatArray, gps: GpsFixes) -> float:
    """Return the rotation about the start [rad] that aligns a dead-reckoned path (N, 3) with the fixes.

    The least-squares rotation in the plane, arg of Σ w (g − s)·conj(p − s) in complex numbers, with
    weights w = 1 / (1 + r²/4) of the distances r [m] that are left (Cauchy's), so that fixes
    that jump have little weight; 0 for paths that stay within 20 m of the start, for which
    fixes give no heading.
    """
    inside = (gps.time_s >= time_s[0]) & (gps.time_s <= time_s[-1])
    reckoned = [np.interp(gps.time_s[inside], time_s, path[:, axis] - path[0, axis]) for axis in (0, 1)]
    fixed = gps.position[inside, :2] - path[0, :2]
    moved = reckoned[0] + 1j * reckoned[1]
    if len(moved) < 3 or np.abs(moved).max() < _LONG_ENOUGH_M:
        return 0.0
    target, turn, weight = fixed[:, 0] + 1j * fixed[:, 1], 0.0, np.ones(len(moved))
    for _ in range(20):
        turn = float(np.angle((weight * target * moved.conj()).sum()))
        weight = 1.0 / (1.0 + (np.abs(target - np.exp(1j * turn) * moved) / _OUTLYING_M) ** 2)
    return turn


def _upright(rotations: FloatArray, time_s: FloatArray, recording: VisionRecords) -> FloatArray:
    """Return rotations (N, 3, 3) from the frame of the first image to one whose z points up."""
    inertial = recording.inertial
    if inertial is None:
        return np.tile(np.eye(3), (len(time_s), 1, 1))
    frame = _nearest(time_s, inertial.time_s)
    force = np.einsum("nij,nj->ni", rotations[frame], inertial.specific_force_m_s2)
    up = np.column_stack([_averaged(inertial.time_s, axis, time_s) for axis in force.T])
    return _to_vertical(up)


def initial_pose(recording: VisionRecords, time_s: float) -> FloatArray:
    """Return the pose (4, 4) at the first image, with gravity of its first second pointing down."""
    pose = np.eye(4)
    if recording.inertial is not None:
        near = np.abs(recording.inertial.time_s - time_s) <= 1.0
        force = recording.inertial.specific_force_m_s2
        pose[:3, :3] = _to_vertical(force[near if near.any() else slice(1)].mean(axis=0)[None])[0]
    return pose


def _to_vertical(up: FloatArray) -> FloatArray:
    """Return the smallest rotations (N, 3, 3) that take vectors (N, 3) to the vertical."""
    axis = np.column_stack([up[:, 1], -up[:, 0], np.zeros(len(up))])  # up × z
    sine = np.linalg.norm(axis, axis=1)
    angle = np.arctan2(sine, up[:, 2])
    vectors = axis * (angle / np.maximum(sine, 1e-12))[:, None]
    matrices: FloatArray = Rotation.from_rotvec(vectors).as_matrix()
    return matrices


def _averaged(time_s: FloatArray, values: FloatArray, at_s: FloatArray) -> FloatArray:
    """Return the mean of readings within `_TIME_S` of each moment, on its side of any hole."""
    total = np.r_[0.0, np.cumsum(values)]
    edges = np.r_[0, np.flatnonzero(np.diff(time_s) > _HOLE_S) + 1, len(time_s)]
    side = np.searchsorted(edges, _nearest(time_s, at_s), side="right")
    first = np.maximum(np.searchsorted(time_s, at_s - _TIME_S), edges[side - 1])
    last = np.minimum(np.searchsorted(time_s, at_s + _TIME_S), edges[side])
    last = np.maximum(last, first + 1).clip(max=len(time_s))
    first = np.minimum(first, last - 1)
    mean: FloatArray = (total[last] - total[first]) / (last - first)
    return mean


def _nearest(time_s: FloatArray, at_s: FloatArray) -> IntArray:
    """Index of the time nearest to each moment."""
    middle = 0.5 * (time_s[1:] + time_s[:-1])
    return np.searchsorted(middle, at_s)


def initial_heading(compass: Compass, time_s: float) -> float:
    """Return the mean heading of a compass within 2 s of a time [rad]."""
    near = np.abs(compass.time_s - time_s) <= 2.0
    heading = compass.heading_rad[near] if near.any() else compass.heading_rad[:1]
    return float(np.arctan2(np.sin(heading).mean(), np.cos(heading).mean()))
