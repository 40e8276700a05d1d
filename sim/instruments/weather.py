"""Weather station: thermometer and hygrometer in fields that vary over the site."""

import numpy as np

from sim.config.sensors import WeatherConfig
from sim.instruments.errors import Clock
from sim.vehicle.motion import RoverMotion
from survey.core.arrays import FloatArray
from survey.core.streams import stream
from survey.data.sensors.aiding import Weather


class WeatherField:
    """Temperature and humidity over the site: lapse with height, and random variation about 100 m wide."""

    _N_WAVES = 60
    _WIDTH_M = 100.0

    def __init__(self, config: WeatherConfig, datum_m: float, seed: int) -> None:
        rng = stream(seed, "weather")
        self._config, self._datum_m = config, datum_m
        self._wave = rng.standard_normal((2, self._N_WAVES, 2)) / self._WIDTH_M
        self._phase = rng.uniform(0.0, 2.0 * np.pi, (2, self._N_WAVES))

    def at(self, place: FloatArray) -> FloatArray:
        """Return temperature [°C] and relative humidity [%] (N, 2) at places (N, 3)."""
        config = self._config
        waves = np.cos(np.einsum("nd,fkd->nfk", place[:, :2], self._wave) + self._phase)
        varied = waves.sum(axis=2) * np.sqrt(2.0 / self._N_WAVES)
        climbed = place[:, 2] - self._datum_m
        temperature = config.temperature_c - 1e-3 * config.lapse_c_per_km * climbed
        temperature = temperature + config.temperature_sd_c * varied[:, 0]
        humidity = config.humidity_percent + config.humidity_sd_percent * varied[:, 1]
        return np.column_stack([temperature, np.clip(humidity, 0.0, 100.0)])


class WeatherStation:
    """Thermometer and hygrometer on the rover."""

    def __init__(self, config: WeatherConfig, field: WeatherField, seed: int) -> None:
        self._field, self._clock = field, Clock(config, seed, "weather")
        self._sigma = config.temperature_noise_c, config.humidity_noise_percent
        self._rng = stream(seed, "instruments", "weather", "white")

    def sense(self, motion: RoverMotion) -> Weather | None:
        """Return the readings during a stretch."""
        at_s, shown_s = self._clock.due(float(motion.time_s[-1]))
        if not len(at_s):
            return None
        read = self._field.at(motion.position_at(at_s)) + self._sigma * self._rng.standard_normal(
            (len(at_s), 2)
        )
        return Weather(shown_s, read[:, 0], np.clip(read[:, 1], 0.0, 100.0))
