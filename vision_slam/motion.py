"""Motion from wheels, gyro and odometry: relative motion, heading change by gyro, dead reckoning.

`MotionSensors` gives the turn and travel between two times, and estimates the gyro bias at rest and from images.
`gyro_residual_rad` compares the gyro with odometry. The heading of images has a random walk; that of a gyro drifts by
its bias, which hardly changes. With ψ the odometry's error of heading, β the bias and g the turn of the gyro about the
vertical minus that of the odometry,

    g = β Δt − Δψ + ν,    ν ~ N(0, N² Δt + s² turn²)

where N is the angle random walk and s the error of the gyro's scale. `dead_reckoning` integrates the steps of odometry
to a path.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from survey.core import BoolArray, FloatArray
from survey.data.sensors.odometry import Odometry
from survey.data.sensors.records import Inertial, Wheels
from vision_slam.attitude import chained, quaternion_products, rotations
from vision_slam.config import LocalizationConfig
from vision_slam.readers.sequence import VisionRecords

_STANDING_S = 0.5
_STANDING_M = 2e-3
_QUIET_RAD_S = 0.005
# Halves of a rest whose mean rates differ by more standard errors, and by more than this, are no rest.
_STEADY_SIGMAS, _STEADY_RAD_S = 4.0, np.radians(0.02)
# What the comparison of halves cannot see, and the bias of an uncalibrated gyro that never rested.
_RESTED_RAD_S, _ANY_RAD_S = np.radians(0.01), np.radians(1.0)
_BIAS_WALK_RAD_S_SQRT_S = np.radians(0.0005)
# Error of a turn by images between two keyframes, and errors of theirs that do not average out without far features.
_IMAGES_RAD, _IMAGES_RAD_S = np.radians(0.05), np.radians(0.02)
_MOST_SIGMAS = 4.0
GAP_S = 1.5  # readings or images farther apart than this leave a gap, in which nothing is measured
_COAST_S = 0.25


@dataclass(frozen=True)
class RelativeMotion:
    """Turn (3, 3), R_before_after of the body, and travel [m]; None where no sensor measures it.

    ``bias_sigma_rad_s`` is the standard deviation of the gyro bias that was subtracted.
    """

    seconds: float
    rotation: FloatArray | None
    travel_m: float | None
    bias_sigma_rad_s: float = 0.0

    def turn_sigma_rad(self, noise_rad_sqrt_s: float) -> float:
        r"""Return the standard deviation of the turn, :math:`(N^2 t + (\sigma_b t)^2)^{1/2}`, by noise and bias of the gyro."""
        return float(np.hypot(noise_rad_sqrt_s * self.seconds**0.5, self.bias_sigma_rad_s * self.seconds))

    @property
    def is_standing(self) -> bool:
        """Whether neither wheels nor gyro moved."""
        if self.travel_m is None or abs(self.travel_m) >= _STANDING_M:
            return False
        return self.rotation is None or bool(Rotation.from_matrix(self.rotation).magnitude() < 5e-3)


class MotionSensors:
    """Wheels and gyro of a recording; the gyro bias is estimated while standing, then from images.

    The bias has a standard deviation: after a rest that of its median rate, at least 0.01 degrees per second, and
    1 degree per second without one. Each turn by images reduces it by the equations of a Kalman filter.
    """

    def __init__(self, recording: VisionRecords) -> None:
        self.continue_with(recording)
        rates = self._rates_at_rest()
        self._bias = np.zeros(3) if rates is None else np.median(rates, axis=0)
        self._variance = (_ANY_RAD_S if rates is None else _median_sigma(rates)) ** 2

    def continue_with(self, recording: VisionRecords) -> None:
        """Continue with other records of the same drive; the estimated bias is unchanged."""
        self._wheels, self._inertial = recording.wheels, recording.inertial
        self._wheel_s, self._inertial_s = _usual_s(self._wheels), _usual_s(self._inertial)

    def between(self, first_s: float, last_s: float) -> RelativeMotion:
        """Return the motion between two times."""
        turn, travel_m = self._turn(first_s, last_s), self._travel(first_s, last_s)
        return RelativeMotion(last_s - first_s, turn, travel_m, float(self._variance**0.5))

    def gap(self, first_s: float, last_s: float) -> list[float]:
        """Return moments between two images that are far apart, if wheels and gyro go on in between."""
        if last_s - first_s <= GAP_S or not self._goes_on(first_s, last_s):
            return []
        n = int(np.ceil((last_s - first_s) / _COAST_S))
        moments: list[float] = np.linspace(first_s, last_s, n + 1)[1:-1].tolist()
        return moments

    def _goes_on(self, first_s: float, last_s: float) -> bool:
        for sensor in (self._wheels, self._inertial):
            if sensor is None:
                return False
            inside = sensor.time_s[(sensor.time_s > first_s) & (sensor.time_s < last_s)]
            if np.diff(np.r_[first_s, inside, last_s]).max() > GAP_S:
                return False
        return True

    def learn(
        self, motion: RelativeMotion, rotation: FloatArray, noise_rad_sqrt_s: float, *, has_far_features: bool
    ) -> None:
        r"""Update the gyro bias by the turn between two keyframes, estimated from images and this motion.

        With V the variance of the turn by gyro and W that by images, a Kalman filter gives

        .. math:: b \leftarrow b + \frac{\sigma_b^2 t}{V} \log(R_{estimated}^T R_{gyro}), \quad
            \sigma_b^2 \leftarrow \sigma_b^2 - \frac{(\sigma_b^2 t)^2}{V + W}.

        The gain does not depend on W, because the estimate already weighs gyro and images. Without far features
        images have errors of rate that do not average out, so they are used only while the bias is less certain.
        """
        if motion.rotation is None or motion.seconds <= 0.0:
            return
        seconds = motion.seconds
        self._variance += _BIAS_WALK_RAD_S_SQRT_S**2 * seconds
        if not has_far_features and self._variance < _IMAGES_RAD_S**2:
            return
        shared = self._variance * seconds
        turn_variance = noise_rad_sqrt_s**2 * seconds + shared * seconds
        most = _MOST_SIGMAS * turn_variance / (turn_variance + _IMAGES_RAD**2) ** 0.5
        too_much = Rotation.from_matrix(rotation.T @ motion.rotation).as_rotvec().clip(-most, most)
        self._bias = self._bias + shared / turn_variance * too_much
        self._variance -= shared**2 / (turn_variance + _IMAGES_RAD**2)

    def _travel(self, first_s: float, last_s: float) -> float | None:
        wheels = self._wheels
        if wheels is None or not _covers(wheels.time_s, first_s, last_s, 0.6 * self._wheel_s):
            return None
        rolled = 0.5 * (wheels.left_m + wheels.right_m)
        return float(np.diff(np.interp([first_s, last_s], wheels.time_s, rolled))[0])

    def _turn(self, first_s: float, last_s: float) -> FloatArray | None:
        inertial = self._inertial
        if inertial is None or not _covers(inertial.time_s, first_s, last_s, 1.1 * self._inertial_s):
            return None
        half_bias = Rotation.from_rotvec(-0.5 * self._bias * (last_s - first_s))
        matrix: FloatArray = (half_bias * _turned(inertial, first_s, last_s) * half_bias).as_matrix()
        return matrix

    def _rates_at_rest(self) -> FloatArray | None:
        """Rates (N, 3) while the wheels rest at the start; None when it begins in motion, or rocks or turns while standing."""
        if self._wheels is None or self._inertial is None:
            return None
        rolled = np.abs(self._wheels.left_m - self._wheels.left_m[0]) + np.abs(
            self._wheels.right_m - self._wheels.right_m[0]
        )
        moving = np.flatnonzero(rolled > _STANDING_M)
        until = self._wheels.time_s[moving[0] - 1] if len(moving) and moving[0] else self._wheels.time_s[0]
        still = self._inertial.time_s <= until
        if until - self._wheels.time_s[0] < _STANDING_S or not still.any():
            return None
        rates: FloatArray = self._inertial.gyro_rad_s[still]
        rocking = np.median(np.abs(rates - np.median(rates, axis=0)), axis=0).max() > _QUIET_RAD_S
        return rates if not rocking and _is_steady(rates) else None


def _median_sigma(rates: FloatArray) -> float:
    """Return the standard deviation of the median of normal rates (N, 3), at least what their steadiness cannot show."""
    error = (0.5 * np.pi / len(rates)) ** 0.5 * rates.std(axis=0).max()
    return float(max(error, _RESTED_RAD_S))


def _is_steady(rates: FloatArray) -> bool:
    """Return whether both halves of rates (N, 3) have the same mean: a body that settles or slides turns ever faster."""
    halves = np.array_split(rates, 2)
    change = np.abs(halves[1].mean(axis=0) - halves[0].mean(axis=0))
    error = np.sqrt(sum(half.var(axis=0) / max(len(half), 1) for half in halves))
    return bool(np.all(change <= np.maximum(_STEADY_SIGMAS * error, _STEADY_RAD_S)))


def _turned(inertial: Inertial, first_s: float, last_s: float) -> Rotation:
    """Turn between two times; each reading is the mean rate over the time before it."""
    times = inertial.time_s
    begin, end = np.searchsorted(times, first_s, side="right"), np.searchsorted(times, last_s)
    edges = np.r_[first_s, times[begin:end], last_s]
    rates = inertial.gyro_rad_s[np.arange(begin, end + 1).clip(max=len(times) - 1)]
    return Rotation.from_quat(chained(Rotation.from_rotvec(rates * np.diff(edges)[:, None]).as_quat()))


def _usual_s(records: Wheels | Inertial | None) -> float:
    """Return the usual time between two readings [s]."""
    return 0.0 if records is None or len(records) < 2 else float(np.median(np.diff(records.time_s)))


def _covers(time_s: FloatArray, first_s: float, last_s: float, slack_s: float) -> bool:
    """Return whether readings reach over both moments, but for so much time.

    Of a distance that must be less than one reading's: after its end nothing is added, which would be standing.
    """
    return bool(time_s[0] - slack_s <= first_s and last_s <= time_s[-1] + slack_s)


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


def dead_reckoning(odometry: Odometry, start: FloatArray) -> FloatArray:
    """Integrate the steps of an odometry from a start.

    `odometry`: steps in the body frame [m] and attitudes in the world [rad]. `start` (3,): position of the
    first pose [m]. Returns (N, 3): positions in the world [m].

    >>> odometry = Odometry(np.arange(3.0), np.tile([1.0, 0.0, 0.0], (2, 1)), np.tile([0.0, 0.0, 0.5 * np.pi], (3, 1)))
    >>> dead_reckoning(odometry, np.array([5.0, 0.0, 0.0])).round(6).tolist()
    [[5.0, 0.0, 0.0], [5.0, 1.0, 0.0], [5.0, 2.0, 0.0]]
    """
    steps = np.einsum("nij,nj->ni", rotations(odometry.attitude_rad[:-1]), odometry.step)
    return np.vstack([start, start + np.cumsum(steps, axis=0)])
