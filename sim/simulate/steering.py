"""Steering by what the rover senses: attitudes with errors, and a path that is chosen while driving.

Patterns that are steered by slope get roll and pitch and nothing else of the ground. `drive_steered` drives by them
without images, and `add_attitude_errors` draws their errors. `SteeredPath` grows the path of a drive in images, from the
roll and pitch that the accelerometer gives at the estimated pose.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from planners.steered_paths import WaypointSteering, rollout
from planners.steering import Attitude, AttitudeSensor, Steering, attitude_sensor
from sim.config.mission import SensorConfig
from sim.simulate.navigator import PoseEstimate
from sim.vehicle.pursuit import PurePursuit
from survey import Dem, Route, SurveyArea
from survey.core import BoolArray, FloatArray
from survey.data.recording import Readings


class AttitudeErrors(NamedTuple):
    """Errors of the sensed attitudes: sensors, speed of the rovers [m/s], and one random generator for each rover."""

    sensors: SensorConfig
    speed_m_s: float
    rngs: Sequence[np.random.Generator]


def drive_steered(
    area: SurveyArea,
    reference: Route,
    steering: Steering,
    terrain: Dem | Sequence[Dem],
    *,
    rngs: Sequence[np.random.Generator],
    errors: AttitudeErrors | None = None,
) -> list[Route]:
    """Return the routes of rovers without images that follow the attitude that they sense on the terrain.

    `rngs`: those of the steering, one for each rover. Without `errors` the attitudes are exact.
    """
    sense = attitude_sensor(terrain)
    if errors is not None:
        sense = add_attitude_errors(sense, *errors)
    return rollout(area, reference, steering, sense, rngs)


def add_attitude_errors(
    sense: AttitudeSensor, sensors: SensorConfig, speed_m_s: float, rngs: Sequence[np.random.Generator]
) -> AttitudeSensor:
    """Return a sensor of the attitudes of rovers with errors of roll and pitch, at their real places.

    Steering (Eq. 10) gets nothing else of the ground. Roll and pitch err by the drawn errors of ``[sensors]``, correlated
    over ``attitude_correlation_m`` of travel, with a constant part. A rover takes itself to be at the places that it is
    called with and is beside them by the slow error of its receiver.

    `speed_m_s`: speed of the rovers, by which the receiver's correlation time becomes a length [m/s].

    The few metres between real and estimated place change the ground that is sensed, not the route that is driven.
    """
    correlation_m = sensors.gps_correlation_time_s * speed_m_s
    bias = np.radians(sensors.tilt_bias_sigma_deg) * np.array([rng.standard_normal(2) for rng in rngs])
    errors = _TravelErrors(
        np.array([sensors.gps_bias_sigma_m] * 2 + [np.radians(sensors.tilt_sigma_deg)] * 2),
        np.array([correlation_m] * 2 + [sensors.attitude_correlation_m] * 2),
        rngs,
    )

    def sensed(xy: FloatArray, heading_rad: FloatArray) -> Attitude:
        error = errors.at(xy)
        real = sense(xy + error[:, :2], heading_rad)
        roll, pitch = (error[:, 2:] + bias).T
        return Attitude(real.roll_rad + roll, real.pitch_rad + pitch, heading_rad)

    return sensed


class _TravelErrors:
    """First-order Gauss-Markov errors over the travel of N rovers; a rover that stands draws nothing."""

    def __init__(
        self, sigma: FloatArray, correlation_m: FloatArray, rngs: Sequence[np.random.Generator]
    ) -> None:
        self._sigma, self._correlation_m, self._rngs = sigma, correlation_m, rngs
        self._travel_m = np.zeros(len(rngs))
        self._here: FloatArray | None = None
        self._value = np.zeros((len(rngs), len(sigma)))

    def at(self, xy: FloatArray) -> FloatArray:
        """Return the errors (N, K) when the rovers have reached places (N, 2)."""
        if self._here is None:
            self._here = xy.copy()
            self._value = self._noise(np.ones(len(xy), dtype=bool))
            return self._value
        travel_m = self._travel_m + np.hypot(*(xy - self._here).T)
        moved = travel_m > self._travel_m
        decay = np.exp(-(travel_m - self._travel_m)[:, None] / self._correlation_m)
        driven = np.sqrt(1.0 - decay**2) * self._noise(moved) + decay * self._value
        self._value = np.where(moved[:, None], driven, self._value)
        self._here, self._travel_m = xy.copy(), travel_m
        return self._value

    def _noise(self, moved: BoolArray) -> FloatArray:
        """Draw white noise (N, K) for the rovers that have moved."""
        noise = np.zeros_like(self._value)
        for k in np.flatnonzero(moved).tolist():
            noise[k] = self._sigma * self._rngs[k].standard_normal(len(self._sigma))
        return noise


_AVERAGED_S = 2.0
"""Time over which the accelerometer is averaged [s]: jolts and accelerations largely cancel."""


class SensedTilt:
    """Roll and pitch by the accelerometer, averaged over the last seconds; its bias stays in them.

    >>> tilt = SensedTilt()
    >>> tilt.roll_and_pitch()  # nothing was sensed yet
    (0.0, 0.0)
    """

    def __init__(self) -> None:
        self._time_s, self._force = np.zeros(0), np.zeros((0, 3))

    def add(self, readings: Readings) -> None:
        """Add the readings since the last call."""
        if readings.inertial is None:
            return
        time_s = np.r_[self._time_s, readings.inertial.time_s]
        force = np.vstack([self._force, readings.inertial.specific_force_m_s2])
        recent = time_s > time_s[-1] - _AVERAGED_S
        self._time_s, self._force = time_s[recent], force[recent]

    def roll_and_pitch(self) -> tuple[float, float]:
        """Return roll and pitch [rad]; level before the first reading."""
        if not len(self._time_s):
            return 0.0, 0.0
        x, y, z = self._force.mean(axis=0)
        return float(np.arctan2(y, z)), float(np.arctan2(-x, np.hypot(y, z)))


class SteeredPath:
    """Grows the path of a pursuit where it ends near, by what the rover senses.

    `steering`: chooses the waypoints.
    """

    def __init__(self, steering: WaypointSteering) -> None:
        self._steering, self._tilt = steering, SensedTilt()

    @property
    def start(self) -> FloatArray:
        """Start of the path (2,) [m]."""
        return self._steering.start

    def sense(self, readings: Readings) -> None:
        """Process the readings since the last call."""
        self._tilt.add(readings)

    def extend(self, pursuit: PurePursuit, estimate: PoseEstimate) -> None:
        """Append waypoints until the path reaches beyond the look-ahead, or mark it as complete."""
        roll, pitch = self._tilt.roll_and_pitch()
        attitude = Attitude(np.array([roll]), np.array([pitch]), np.array([estimate.heading_rad]))
        while pursuit.wants_more:
            stretch = self._steering.next_stretch(attitude)
            if stretch is None:
                pursuit.complete()
            else:
                pursuit.extend(stretch)
