"""Attitude as rovers' instruments give it while a pattern is steered, with errors of angle and of place."""

from collections.abc import Sequence

import numpy as np

from planners.steering.attitude import Attitude, AttitudeSensor
from sim.config.mission import MissionConfig, SensorConfig
from survey.core.arrays import BoolArray, FloatArray
from survey.core.streams import stream


def sensed_attitude(sense: AttitudeSensor, mission: MissionConfig) -> AttitudeSensor:
    """Return the attitude that the rover of a mission senses while it drives; see `sensed_attitudes`.

    Parameters
    ----------
    sense : callable
        Attitude at rest on the real terrain.
    mission : MissionConfig
        Its sections ``sensors`` and ``rover``, and its seed.

    Returns
    -------
    callable
        An `AttitudeSensor` of one rover, to be called step by step along its way.
    """
    rng = stream(mission.seed, "steering", "sensed")
    return sensed_attitudes(sense, mission.sensors, mission.rover.speed_m_s, [rng])


def sensed_attitudes(
    sense: AttitudeSensor, sensors: SensorConfig, speed_m_s: float, rngs: Sequence[np.random.Generator]
) -> AttitudeSensor:
    """Return the attitudes that rovers sense while they drive: roll and pitch with errors, at their real places.

    Steering (Eq. 10) gets nothing else of the ground. Roll and pitch err by the drawn errors of ``[sensors]``, correlated
    over ``attitude_correlation_m`` of travel, with a constant part. A rover takes itself to be at the places that it is
    called with and is beside them by the slow error of its receiver.

    Parameters
    ----------
    sense : callable
        Attitude at rest on the real terrain, of N rovers.
    sensors : SensorConfig
        Standard deviations and correlations of the errors.
    speed_m_s : float
        Speed of the rovers, by which the receiver's correlation time becomes a length [m/s].
    rngs : sequence of numpy.random.Generator
        One per rover; the errors of a rover depend on its own alone.

    Returns
    -------
    callable
        An `AttitudeSensor` of N rovers, to be called step by step along their ways.

    Notes
    -----
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
