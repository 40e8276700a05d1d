"""Attitude as a rover's instruments give it while a pattern is steered, with errors of angle and of place."""

import numpy as np

from planners.steering.attitude import Attitude, AttitudeSensor
from sim.config.mission import MissionConfig
from sim.instruments.errors import GaussMarkov
from survey.core.arrays import FloatArray
from survey.core.streams import stream


def sensed_attitude(sense: AttitudeSensor, mission: MissionConfig) -> AttitudeSensor:
    """Return the attitude that one rover senses while it drives: roll and pitch with errors, at its real place.

    Steering (Eq. 10) gets nothing else of the ground. Roll and pitch err by the drawn errors of ``[sensors]``, correlated
    over ``attitude_correlation_m`` of travel, with a constant part. The rover takes itself to be at the places that it is
    called with and is beside them by the slow error of its receiver.

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

    Notes
    -----
    The few metres between real and estimated place change the ground that is sensed, not the route that is driven.
    """
    sensors, rng = mission.sensors, stream(mission.seed, "steering", "sensed")
    tilt = GaussMarkov(np.radians(sensors.tilt_sigma_deg), sensors.attitude_correlation_m, rng, 2)
    correlation_m = sensors.gps_correlation_time_s * mission.rover.speed_m_s
    place = GaussMarkov(sensors.gps_bias_sigma_m, correlation_m, rng, 2)
    bias = np.radians(sensors.tilt_bias_sigma_deg) * rng.standard_normal(2)
    travel = _Travel()

    def sensed(xy: FloatArray, heading_rad: FloatArray) -> Attitude:
        at_m = np.array([travel.to(xy[0])])
        real = sense(xy + place.at(at_m), heading_rad)
        roll, pitch = (tilt.at(at_m) + bias)[0]
        return Attitude(real.roll_rad + roll, real.pitch_rad + pitch, heading_rad)

    return sensed


class _Travel:
    """Distance travelled from place to place [m]."""

    def __init__(self) -> None:
        self._here: FloatArray | None = None
        self._travel_m = 0.0

    def to(self, xy: FloatArray) -> float:
        """Return the distance travelled when a place (2,) is reached [m]."""
        if self._here is not None:
            self._travel_m += float(np.hypot(*(xy - self._here)))
        self._here = xy.copy()
        return self._travel_m
