"""Magnetic compass: declination error, hard-iron and soft-iron errors, white noise."""

import numpy as np

from sim.config.sensors import CompassConfig
from sim.instruments.errors import Clock
from sim.vehicle.motion import RoverMotion
from survey.core.streams import stream
from survey.data.sensors.aiding import Compass


class MagneticCompass:
    """Magnetic compass; iron and currents nearby give an error that depends on the heading."""

    def __init__(self, config: CompassConfig, seed: int) -> None:
        self._config = config
        self._clock = Clock(config, seed, "compass")
        self._phase = stream(seed, "instruments", "compass", "iron").uniform(0.0, 2.0 * np.pi, 2)
        self._rng = stream(seed, "instruments", "compass", "white")

    def sense(self, motion: RoverMotion) -> Compass | None:
        """Return the headings during a stretch."""
        at_s, shown_s = self._clock.due(float(motion.time_s[-1]))
        if not len(at_s):
            return None
        config = self._config
        heading = motion.rotation_at(at_s).as_euler("ZYX")[:, 0]
        error = config.declination_error_deg + config.hard_iron_deg * np.sin(heading + self._phase[0])
        error += config.soft_iron_deg * np.sin(2.0 * heading + self._phase[1])
        error += config.white_sigma_deg * self._rng.standard_normal(len(at_s))
        return Compass(shown_s, (heading + np.radians(error) + np.pi) % (2.0 * np.pi) - np.pi)
