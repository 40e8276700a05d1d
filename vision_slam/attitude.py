"""Attitude of the body: Euler angles, roll and pitch from gravity, heading from compass or fixes.

The body has x forward, y left, z up; the world has x east, y north, z up. Positive roll lifts the left side, positive
pitch lowers the nose, yaw counts counter-clockwise from east: right-handed turns about x, y and z, applied as Rz Ry Rx.

`world_attitudes` levels visual odometry by averages of the specific force over a minute, over which accelerations
cancel: roll and pitch then vary by 0.05 to 0.08 degrees over a survey. `gravity_tilt` is for odometry that was
levelled by other means. A body at rest measures R^T (0, 0, g): forward −g sin θ, left g sin φ cos θ. In motion its
acceleration a = dv/dt + ω × v adds to that, with the velocity v in the body from the odometry and the rate ω of the
gyro. Readings in sharp turns and jolts, where a is poorly determined, are left out. A tenth of the readings remains, and
averages over 10 m scatter by 0.15 to 0.5 degrees.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from survey.core import FloatArray, IntArray
from survey.data.sensors.odometry import Odometry
from survey.data.sensors.records import Compass, GpsFixes, Inertial
from vision_slam.readers.sequence import VisionRecords


def rotations(attitude_rad: FloatArray) -> FloatArray:
    """Return R_world_body (N, 3, 3) of roll, pitch, yaw (N, 3) [rad]."""
    matrices: FloatArray = Rotation.from_euler("xyz", attitude_rad).as_matrix()
    return matrices


def quaternions(attitude_rad: FloatArray) -> FloatArray:
    """Return unit quaternions x, y, z, w (N, 4) of roll, pitch, yaw (N, 3) [rad]."""
    values: FloatArray = Rotation.from_euler("xyz", attitude_rad).as_quat(canonical=True)
    return values


def turned(vectors: FloatArray, yaw_rad: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return how world vectors (N, 3) answer to a small yaw error and to a small pitch error.

    Both are (N, 3) per radian: the yaw turns about the vertical, the pitch about the
    body's left axis laid level.
    """
    left = np.column_stack([-np.sin(yaw_rad), np.cos(yaw_rad), np.zeros_like(yaw_rad)])
    up = np.zeros_like(vectors)
    up[:, 2] = 1.0
    return np.cross(up, vectors), np.cross(left, vectors)


def quaternion_products(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the products (N, 4) of unit quaternions x, y, z, w (N, 4): the second turn, then the first."""
    x, y, z, w = first.T
    a, b, c, d = second.T
    return np.stack(
        [
            w * a + x * d + y * c - z * b,
            w * b - x * c + y * d + z * a,
            w * c + x * b - y * a + z * d,
            w * d - x * a - y * b - z * c,
        ],
        axis=1,
    )


def chained(quaternions_xyzw: FloatArray) -> FloatArray:
    """Return the product (4,) of unit quaternions (N, 4) in their order, normalized."""
    while len(quaternions_xyzw) > 1:
        if len(quaternions_xyzw) % 2:
            quaternions_xyzw = np.vstack([quaternions_xyzw, [0.0, 0.0, 0.0, 1.0]])
        quaternions_xyzw = quaternion_products(quaternions_xyzw[::2], quaternions_xyzw[1::2])
    product: FloatArray = quaternions_xyzw[0] / np.linalg.norm(quaternions_xyzw[0])
    return product


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


_GRAVITY_M_S2 = 9.81
# A reading whose length is further from g than this is a jolt.
_MOST_JOLT_M_S2 = 0.5
_MOST_RATE_RAD_S = 0.1
_N_STANDING, _STILL_RAD_S = 10, 0.02
_LEAST_TURN_RAD = np.radians(120.0)
# Tracks do not stand on the very same crumbs twice.
_LEAST_SIGMA_RAD = np.radians(0.02)


@dataclass(frozen=True)
class GravityTilt:
    """Roll and pitch from gravity: ``time_s`` (N,), ``roll_rad`` and ``pitch_rad`` (N,), with the sensor's bias."""

    time_s: FloatArray
    roll_rad: FloatArray
    pitch_rad: FloatArray


@dataclass(frozen=True)
class StandingBias:
    """Apparent tilt by the bias of the accelerometer: ``roll_rad``, ``pitch_rad``, each ± ``sigma_rad``."""

    roll_rad: float
    pitch_rad: float
    sigma_rad: float


def standing_bias(inertial: Inertial, before_s: float) -> StandingBias | None:
    r"""Estimate the accelerometer's bias from standing on one spot under several headings, before a drive begins.

    The ground keeps its slope when the rover turns on it, and the bias turns with the
    rover. With ψ the heading, by the gyro, n the level part of the ground's normal and b
    the bias, every standing reading is

    .. math::  (f_x, f_y)^T / g = R(\psi)^T n + b

    `before_s`: when the drive begins [s]. Returns: None where the rover did not stand under headings a third
    of a turn apart.
    """
    waiting = inertial.time_s < before_s
    if waiting.sum() < _N_STANDING:
        return None
    times, rates = inertial.time_s[waiting], inertial.gyro_rad_s[waiting]
    heading = np.r_[0.0, np.cumsum(0.5 * (rates[1:, 2] + rates[:-1, 2]) * np.diff(times))]
    still = np.linalg.norm(rates, axis=1) < _STILL_RAD_S
    if still.sum() < _N_STANDING or np.ptp(heading[still]) < _LEAST_TURN_RAD:
        return None
    level = inertial.specific_force_m_s2[waiting][still, :2] / _GRAVITY_M_S2
    cosine, sine = np.cos(heading[still]), np.sin(heading[still])
    zero, one = np.zeros_like(cosine), np.ones_like(cosine)
    rows = np.stack(
        [np.column_stack([cosine, sine, one, zero]), np.column_stack([-sine, cosine, zero, one])], axis=1
    )
    design, values = rows.reshape(-1, 4), level.ravel()
    found, squares, _, _ = np.linalg.lstsq(design, values, rcond=None)
    scatter = float(squares[0]) / (len(values) - 4) if len(squares) else 0.0
    spread = np.linalg.inv(design.T @ design)[2:, 2:].trace() / 2.0
    return StandingBias(
        float(found[3]), float(-found[2]), max(float(np.sqrt(scatter * spread)), _LEAST_SIGMA_RAD)
    )


def gravity_tilt(inertial: Inertial, odometry: Odometry) -> GravityTilt:
    """Return roll and pitch for every quiet reading.

    The accelerometer's own bias is still in them: in the smoother it is an unknown.

    >>> times = np.arange(4.0)
    >>> odometry = Odometry(times, np.zeros((3, 3)), np.zeros((4, 3)))
    >>> force = np.tile([-0.981, 0.0, 9.76], (4, 1))  # nose down is positive pitch
    >>> tilt = gravity_tilt(Inertial(times, np.zeros((4, 3)), force), odometry)
    >>> print(np.round(np.degrees(tilt.pitch_rad), 1))
    [5.7 5.7 5.7 5.7]
    """
    own = _own_acceleration(inertial, odometry)
    force = inertial.specific_force_m_s2 - own
    length = np.linalg.norm(force, axis=1)
    driving = (inertial.time_s >= odometry.time_s[0]) & (inertial.time_s <= odometry.time_s[-1])
    slow = np.linalg.norm(inertial.gyro_rad_s, axis=1) < _MOST_RATE_RAD_S
    quiet = driving & slow & (np.abs(length - _GRAVITY_M_S2) < _MOST_JOLT_M_S2)
    force = force[quiet]
    level = np.hypot(force[:, 1], force[:, 2])
    return GravityTilt(
        inertial.time_s[quiet], np.arctan2(force[:, 1], force[:, 2]), np.arctan2(-force[:, 0], level)
    )


def _own_acceleration(inertial: Inertial, odometry: Odometry) -> FloatArray:
    """Return the acceleration (N, 3) of the body in its own frame [m/s²]."""
    times = odometry.time_s
    middle = 0.5 * (times[1:] + times[:-1])
    velocity = odometry.step / np.diff(times)[:, None]
    here = np.column_stack([np.interp(inertial.time_s, middle, v) for v in velocity.T])
    rate = np.gradient(velocity, middle, axis=0) if len(middle) > 1 else np.zeros_like(velocity)
    along = np.column_stack([np.interp(inertial.time_s, middle, r) for r in rate.T])
    own: FloatArray = along + np.cross(inertial.gyro_rad_s, here)
    return own
