r"""Roll and pitch from gravity: what an accelerometer says of the attitude when the rover's own motion is taken out.

A body at rest feels R^T (0, 0, g): forward −g sin θ, left g sin φ cos θ. In motion its
acceleration a adds to that. With the velocity v in the body, known from the odometry, and
the rate ω of the gyro, a = dv/dt + ω × v. Readings in sharp turns and jolts, where that is
poorly known, are left out.
"""

from dataclasses import dataclass

import numpy as np

from survey.arrays import FloatArray
from survey.sensors import Inertial, Odometry

_GRAVITY_M_S2 = 9.81
# A reading whose length is further from g than this is a jolt.
_MOST_JOLT_M_S2 = 0.5
_MOST_RATE_RAD_S = 0.1


@dataclass(frozen=True)
class GravityTilt:
    """Roll and pitch that gravity tells: ``time_s`` (N,), ``roll_rad`` and ``pitch_rad`` (N,), with the sensor's bias."""

    time_s: FloatArray
    roll_rad: FloatArray
    pitch_rad: FloatArray


def gravity_tilt(inertial: Inertial, odometry: Odometry) -> GravityTilt:
    """Return roll and pitch for every quiet reading.

    The accelerometer's own bias is still in them: in the smoother it is an unknown.

    Examples
    --------
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
    quiet = (np.abs(length - _GRAVITY_M_S2) < _MOST_JOLT_M_S2) & (
        np.linalg.norm(inertial.gyro_rad_s, axis=1) < _MOST_RATE_RAD_S
    )
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
