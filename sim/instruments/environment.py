"""Environmental sensors: weather station and science payload, and the fields that they measure.

`WeatherField` gives temperature and humidity, with a lapse rate and random variation about 100 m wide. `PayloadField`
is a scalar quantity over the site: a linear dependence on elevation and aspect, and a stationary Gaussian field as a sum
of waves with random directions. A payload sensor has a rate, a first-order lag and white noise; its log has times and
no places.
"""

from pathlib import Path

import numpy as np

from sim.config.mission import MissionConfig
from sim.config.rover import PayloadConfig
from sim.config.sensors import WeatherConfig
from sim.instruments.sensor import Clock
from sim.vehicle.motion import RoverMotion
from survey import Dem, Truth
from survey.core import FloatArray, stream
from survey.data.sensors.payload import PayloadLog
from survey.data.sensors.records import Weather


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


# With a tenth of these waves the short ones are too few: the relief between swaths is then smoother or rougher than its
# covariance function says, from site to site.
_N_WAVES, _AT_ONCE = 4000, 50
_HALF_M = 5.0
_DEGREES = {"rough": 3.0, "medium": 5.0, "smooth": np.inf}


class PayloadField:
    """Field of one quantity: a sum of waves with random directions, about a linear dependence on elevation and aspect.

    `config`: sizes of its parts. `terrain`: real terrain. `seed`: seed of the site: all rovers measure the
    same field.
    """

    def __init__(self, config: PayloadConfig, terrain: Dem, seed: int) -> None:
        self._config, self._terrain = config, terrain
        self._datum_m = float(np.nanmean(terrain.elevation))
        rng = stream(seed, "payload", config.name, "field")
        wave = rng.standard_normal((_N_WAVES, 2)) / config.field_length_m
        degrees = _DEGREES[config.field_kind]
        # Frequencies of a Matérn field follow Student's t-distribution.
        spread = np.ones(_N_WAVES) if np.isinf(degrees) else rng.chisquare(degrees, _N_WAVES) / degrees
        self._wave, self._phase = wave / np.sqrt(spread)[:, None], rng.uniform(0.0, 2.0 * np.pi, _N_WAVES)

    def at(self, xy: FloatArray) -> FloatArray:
        """Return the values (N,) at places (N, 2); NaN where the terrain is not known."""
        config, middle = self._config, np.mean(self._terrain.bounds[:2])
        varied = np.zeros(len(xy))
        for first in range(0, _N_WAVES, _AT_ONCE):
            part = slice(first, first + _AT_ONCE)
            varied += np.cos((xy - middle) @ self._wave[part].T + self._phase[part]).sum(axis=1)
        varied *= config.field_sd * np.sqrt(2.0 / _N_WAVES)
        climbed_km = 1e-3 * (self._terrain.at(xy) - self._datum_m)
        values: FloatArray = config.mean + config.per_km_of_elevation * climbed_km + varied
        return values if config.facing_south == 0.0 else values + config.facing_south * self._southward(xy)

    def _southward(self, xy: FloatArray) -> FloatArray:
        """Return the southward part (N,) of the unit normals of the ground, over 10 m."""
        step = np.array([[_HALF_M, 0.0], [0.0, _HALF_M]])
        east, north = ((self._terrain.at(xy + d) - self._terrain.at(xy - d)) / (2.0 * _HALF_M) for d in step)
        southward: FloatArray = np.nan_to_num(north / np.sqrt(1.0 + east**2 + north**2))
        return southward


_STEPS_PER_LAG = 10.0


def record_payload(truth: Truth, mission: MissionConfig, folder: Path) -> None:
    """Write the log of every quantity of a drive's payload as ``<name>.csv`` into a new folder."""
    folder.mkdir()
    for config in mission.payload:
        field = PayloadField(config, truth.dem, mission.site_seed)
        payload_log(config, field, truth, mission.seed).write(folder / f"{config.name}.csv")


def payload_log(config: PayloadConfig, field: PayloadField, truth: Truth, seed: int) -> PayloadLog:
    """Return the readings of one sensor on a drive."""
    path = truth.trajectory
    time_s = np.arange(path.time_s[0], path.time_s[-1] + 1e-9, 1.0 / config.rate_hz)
    shown = _followed(config, field, truth, time_s)
    noise = config.noise_sd * stream(seed, "payload", config.name, "noise").standard_normal(len(time_s))
    return PayloadLog(config, shown + noise, time_s)


def _followed(config: PayloadConfig, field: PayloadField, truth: Truth, time_s: FloatArray) -> FloatArray:
    """Return what a sensor that follows its surroundings with a lag shows at times (N,)."""
    path = truth.trajectory
    if config.lag_s == 0.0:
        return field.at(_places(truth, time_s))
    step_s = min(1.0 / config.rate_hz, config.lag_s / _STEPS_PER_LAG)
    fine_s = np.arange(path.time_s[0], time_s[-1] + step_s, step_s)
    around = field.at(_places(truth, fine_s))
    share = 1.0 - np.exp(-step_s / config.lag_s)
    state = np.empty(len(fine_s))
    state[0] = around[0]
    for k in range(1, len(fine_s)):
        state[k] = state[k - 1] + share * (around[k - 1] - state[k - 1])
    return np.interp(time_s, fine_s, state)


def _places(truth: Truth, time_s: FloatArray) -> FloatArray:
    path = truth.trajectory
    return np.column_stack([np.interp(time_s, path.time_s, axis) for axis in path.position[:, :2].T])
