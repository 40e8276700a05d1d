"""Barometer: pressure altitude above an unknown datum, with weather drift."""

import numpy as np

from sim.config.sensors import BarometerConfig
from sim.instruments.errors import Clock, GaussMarkov, gauss_markov
from sim.instruments.sensor import StatisticalDrive
from sim.vehicle.motion import RoverMotion
from survey.core.arrays import FloatArray
from survey.core.streams import stream
from survey.data.sensors.aiding import Barometer


class PressureAltimeter:
    """Barometer: height above an unknown datum, with the drift of the weather."""

    def __init__(self, config: BarometerConfig, seed: int, name: str = "barometer") -> None:
        self._config = config
        self._clock = Clock(config, seed, name)
        rng = stream(seed, "instruments", name, "drift")
        self._datum_m = 10.0 * float(rng.standard_normal())
        self._drift = GaussMarkov(config.drift_sigma_m, config.correlation_time_s, rng, 1)
        self._white = stream(seed, "instruments", name, "white")

    def sense(self, motion: RoverMotion) -> Barometer | None:
        """Return the heights during a stretch."""
        at_s, shown_s = self._clock.due(float(motion.time_s[-1]))
        if not len(at_s):
            return None
        noise = self._config.white_sigma_m * self._white.standard_normal(len(at_s))
        height = motion.position_at(at_s)[:, 2] + self._datum_m + self._drift.at(at_s)[:, 0] + noise
        return Barometer(shown_s, height)


def draw_barometer(drive: StatisticalDrive) -> Barometer | None:
    """Draw the rover's barometer; None where the mission has none."""
    return Barometer(drive.trajectory.time_s, _heights(drive)) if drive.mission.aids.barometer else None


def draw_base_barometer(drive: StatisticalDrive) -> Barometer | None:
    """Draw a barometer at the start, which shares all drift but a part of its own; None where the mission has none."""
    aids, sensors, trajectory = drive.mission.aids, drive.mission.sensors, drive.trajectory
    if not (aids.barometer and aids.base_barometer):
        return None
    rng = stream(drive.mission.seed, "aids", "base barometer")
    weather = _heights(drive) - trajectory.position[:, 2]
    sigma = sensors.barometer_drift_sigma_m * aids.base_barometer_residual
    gaps = np.diff(trajectory.time_s)
    own = gauss_markov(gaps, sensors.barometer_correlation_time_s, sigma, rng)[:, 0]
    return Barometer(trajectory.time_s, trajectory.position[0, 2] + weather + own)


def _heights(drive: StatisticalDrive) -> FloatArray:
    """Return the pressure altitudes (N,) of the rover's barometer [m]."""
    sensors, trajectory = drive.mission.sensors, drive.trajectory
    rng = stream(drive.mission.seed, "sensors", "barometer")
    datum = 10.0 * rng.standard_normal()
    gaps, sigma = np.diff(trajectory.time_s), sensors.barometer_drift_sigma_m
    drift = gauss_markov(gaps, sensors.barometer_correlation_time_s, sigma, rng)[:, 0]
    white = sensors.barometer_white_sigma_m * rng.standard_normal(len(drift))
    heights: FloatArray = trajectory.position[:, 2] + datum + drift + white
    return heights
