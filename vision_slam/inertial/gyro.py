r"""Heading change by gyro relative to the odometry, with bias estimation.

The heading of images has a random walk; that of a gyro drifts by its bias, which hardly changes. With ψ the odometry's error of heading, β the bias and g what the gyro
turned about the vertical beyond what the odometry says,

    g = β Δt − Δψ + ν,    ν ~ N(0, N² Δt + s² turn²)

where N is the angle random walk and s the error of the gyro's scale.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from survey.core.arrays import BoolArray, FloatArray
from survey.data.sensors.aiding import Inertial
from survey.data.sensors.odometry import Odometry
from vision_slam.config import LocalizationConfig
from vision_slam.rotation import quaternion_products

ANY_RATE_RAD_S = 1.0
"""Prior standard deviation of the gyro bias, larger than any real one."""
_HOUR_S = 3600.0
# Readings farther apart than so many usual gaps have a hole between them.
_HOLE = 2.5


@dataclass(frozen=True)
class GyroErrors:
    """Variances: of the odometry's heading per metre, of the gyro's turn per second, of its bias per second, of its scale."""

    heading_walk: float
    noise: float
    bias_walk: float
    scale: float

    @classmethod
    def of(cls, config: LocalizationConfig) -> "GyroErrors":
        """Return the variances of a configuration."""
        heading, noise, walk = np.radians(
            [
                config.heading_walk_deg_sqrt_m,
                config.gyro_noise_deg_sqrt_h / _HOUR_S**0.5,
                config.gyro_bias_walk_deg_h_sqrt_h / _HOUR_S**1.5,
            ]
        )
        return cls(float(heading**2), float(noise**2), float(walk**2), config.gyro_scale_sigma**2)

    @property
    def is_used(self) -> bool:
        """Whether the gyro is used: without a heading walk the odometry contains the gyro already."""
        return self.heading_walk > 0.0

    def variance(self, seconds: Any, turned_rad: Any) -> Any:
        """Return the variance of a turn by gyro that took `seconds`."""
        return self.noise * seconds + self.scale * turned_rad**2


def gyro_residual_rad(inertial: Inertial, odometry: Odometry) -> FloatArray:
    """Return the turn of the gyro about the vertical minus that of the odometry, from pose to pose (N - 1,) [rad].

    Each reading is the mean rate over the time before it. NaN where readings lack. The
    odometry's roll and pitch, bounded by gravity, give the vertical.

    Examples
    --------
    >>> times = np.arange(4.0)
    >>> odometry = Odometry(times, np.zeros((3, 3)), np.zeros((4, 3)))
    >>> rates = np.tile([0.0, 0.0, 0.01], (4, 1))
    >>> print(gyro_residual_rad(Inertial(times, rates, np.zeros((4, 3))), odometry))
    [0.01 0.01 0.01]
    """
    pose = Rotation.from_euler("xyz", odometry.attitude_rad)
    odometry_turn = pose[:-1].inv() * pose[1:]
    turn, is_covered = _turns(inertial, odometry.time_s)
    beyond: FloatArray = pose[:-1].apply((turn * odometry_turn.inv()).as_rotvec())[:, 2]
    return np.where(is_covered, beyond, np.nan)


def _turns(inertial: Inertial, times: FloatArray) -> tuple[Rotation, BoolArray]:
    """Return the rotations of the body between times (N,) by gyro, and which of them are covered by readings (N - 1,)."""
    usual = float(np.median(np.diff(inertial.time_s)))
    began = np.r_[inertial.time_s[0] - usual, inertial.time_s[:-1]]
    inside = inertial.time_s[(inertial.time_s > times[0]) & (inertial.time_s < times[-1])]
    edges = np.union1d(inside, times)
    middle = 0.5 * (edges[1:] + edges[:-1])
    reading = np.searchsorted(inertial.time_s, middle).clip(max=len(began) - 1)
    is_covered = (began[reading] <= middle) & (middle <= inertial.time_s[reading])
    is_covered &= inertial.time_s[reading] - began[reading] <= _HOLE * usual
    interval = np.searchsorted(times, middle) - 1
    part = inertial.gyro_rad_s[reading] * np.diff(edges)[:, None]
    first = np.searchsorted(interval, np.arange(len(times) - 1))
    count = np.bincount(interval, minlength=len(times) - 1)
    turn, parts = np.tile([0.0, 0.0, 0.0, 1.0], (len(times) - 1, 1)), Rotation.from_rotvec(part).as_quat()
    for k in range(int(count.max())):
        here = np.flatnonzero(count > k)
        turn[here] = quaternion_products(turn[here], parts[first[here] + k])
    lacking = np.bincount(interval, ~is_covered, minlength=len(times) - 1)
    return Rotation.from_quat(turn), lacking == 0
