r"""Roll and pitch from the accelerometer, corrected for the acceleration of the rover.

A body at rest feels R^T (0, 0, g): forward −g sin θ, left g sin φ cos θ. In motion its
acceleration a adds to that. With the velocity v in the body, known from the odometry, and
the rate ω of the gyro, a = dv/dt + ω × v. Readings in sharp turns and jolts, where that is
poorly known, are left out.

Used for odometry that was levelled by other means. Visual odometry is levelled in
`vision_slam.inertial.attitude` by averages over a minute, over which accelerations cancel: its
roll and pitch vary by 0.05 to 0.08 degrees over a survey. Here a tenth of the readings is quiet
enough, and averages over 10 m scatter by 0.15 to 0.5 degrees.
"""

from dataclasses import dataclass

import numpy as np

from survey.core.arrays import FloatArray
from survey.data.sensors.aiding import Inertial
from survey.data.sensors.odometry import Odometry

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

    Parameters
    ----------
    inertial : Inertial
        Readings; those before `before_s` were taken on one spot.
    before_s : float
        When the drive begins [s].

    Returns
    -------
    StandingBias or None
        None where the rover did not stand under headings a third of a turn apart.
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
