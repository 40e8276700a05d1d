"""The rover's other instruments: tracks, gyro and accelerometer, barometer, compass, weather, stakes.

Each reads stretch by stretch of the real motion and keeps its errors in between, so that a
drive which is steered by what they say gets the same readings as one that is not.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from sim.config.sensors import (
    BarometerConfig,
    CompassConfig,
    InertialConfig,
    StakeConfig,
    WeatherConfig,
    WheelConfig,
)
from sim.instruments.clock import Clock, GaussMarkov
from sim.vehicle.motion import RoverMotion
from sim.vehicle.physics import GRAVITY_M_S2
from survey.core.arrays import FloatArray
from survey.core.streams import stream
from survey.data.sensors import Barometer, Compass, Inertial, Stakes, StakeSightings, Weather, Wheels

_HOUR_S = 3600.0


class WheelEncoders:
    """Counts what the tracks unroll: in whole ticks, with scale errors; slip is in it."""

    def __init__(self, config: WheelConfig, seed: int) -> None:
        self._config = config
        self._clock = Clock(config, seed, "wheels")

    def sense(self, motion: RoverMotion) -> Wheels | None:
        """Return the counts during a stretch."""
        at_s, shown_s = self._clock.due(float(motion.time_s[-1]))
        if not len(at_s):
            return None
        config = self._config
        scale = 1.0 + config.scale_error + 0.5 * config.scale_difference * np.array([1.0, -1.0])
        ticks = np.floor(motion.rolled_at(at_s) * scale / config.tick_m)
        return Wheels(shown_s, *(ticks * config.tick_m).T)


class InertialUnit:
    r"""Gyro and accelerometer: means over the time between readings, white noise and wandering biases.

    With white noise N and a bias that walks with K the Allan variance over τ is

    .. math:: \sigma^2(\tau) = N^2 / \tau + K^2 \tau / 3
    """

    def __init__(self, config: InertialConfig, seed: int) -> None:
        self._clock = Clock(config, seed, "inertial")
        self._dt_s = 1.0 / config.rate_hz
        gyro = np.radians(
            [config.gyro_noise_deg_sqrt_h, config.gyro_bias_deg_h, config.gyro_bias_walk_deg_h_sqrt_h]
        )
        rng = {part: stream(seed, "instruments", "inertial", part) for part in ("gyro", "force")}
        self._gyro = WanderingNoise(
            gyro[0] / _HOUR_S**0.5, gyro[1] / _HOUR_S, gyro[2] / _HOUR_S**1.5, self._dt_s, rng["gyro"]
        )
        self._force = WanderingNoise(
            config.force_noise_m_s2_sqrt_hz,
            config.force_bias_m_s2,
            config.force_bias_walk_m_s2_sqrt_h / _HOUR_S**0.5,
            self._dt_s,
            rng["force"],
        )

    def sense(self, motion: RoverMotion) -> Inertial | None:
        """Return the readings during a stretch."""
        at_s, shown_s = self._clock.due(float(motion.time_s[-1]))
        at_s, shown_s = at_s[at_s > 0.0], shown_s[at_s > 0.0]
        if not len(at_s):
            return None
        before, after = motion.rotation_at(at_s - self._dt_s), motion.rotation_at(at_s)
        turn = (before.inv() * after).as_rotvec() / self._dt_s
        gained = (motion.velocity_at(at_s) - motion.velocity_at(at_s - self._dt_s)) / self._dt_s
        middle = before * Rotation.from_rotvec(0.5 * self._dt_s * turn)
        force = middle.inv().apply(gained + [0.0, 0.0, GRAVITY_M_S2])
        n = len(at_s)
        return Inertial(shown_s, turn + self._gyro.draw(n), force + self._force.draw(n))


class WanderingNoise:
    """White noise and a bias in random walk on three axes, for readings at equal steps.

    `density` in units per √Hz, `bias` in units, `walk` in units per √s.
    """

    def __init__(
        self, density: float, bias: float, walk: float, dt_s: float, rng: np.random.Generator
    ) -> None:
        self._white, self._walk, self._rng = density / dt_s**0.5, walk * dt_s**0.5, rng
        self._bias = bias * rng.standard_normal(3)

    def draw(self, n: int) -> FloatArray:
        """Return the errors (n, 3) of the next readings."""
        draws = self._rng.standard_normal((n, 2, 3))
        bias = self._bias + np.cumsum(self._walk * draws[:, 1], axis=0)
        self._bias = bias[-1]
        error: FloatArray = bias + self._white * draws[:, 0]
        return error


class PressureAltimeter:
    """A barometer above an unknown datum, with the weather's drift."""

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


class MagneticCompass:
    """A compass beside motors and batteries: its error depends on the heading."""

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


class WeatherField:
    """Temperature and humidity over the site: a lapse with height and smooth variation about 100 m wide."""

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


class StakeSpotter:
    """Recognises stakes in passing, once a second while one is near.

    Parameters
    ----------
    config : StakeConfig
        Number and errors.
    foot : (K, 3) ndarray
        Where the stakes really stand [m].
    seed : int
        The mission's.
    """

    def __init__(self, config: StakeConfig, foot: FloatArray, seed: int) -> None:
        self._config, self._foot = config, foot
        self._rng = stream(seed, "instruments", "stakes", "seen")
        rng = stream(seed, "instruments", "stakes", "survey")
        surveyed = foot + config.survey_sigma_m * rng.standard_normal(foot.shape)
        self.stakes = Stakes(surveyed, np.full(len(foot), config.survey_sigma_m)) if len(foot) else None
        self._n_seconds = 0

    def sense(self, motion: RoverMotion) -> StakeSightings | None:
        """Return the sightings during a stretch."""
        last = int(np.floor(motion.time_s[-1] + 1e-6))
        at_s = np.arange(self._n_seconds, last + 1, dtype=np.float64)
        self._n_seconds = max(self._n_seconds, last + 1)
        gap = self._foot[None] - motion.position_at(at_s)[:, None]
        moment, stake = np.nonzero(np.linalg.norm(gap, axis=2) < self._config.range_m)
        if not len(moment):
            return None
        offset = motion.rotation_at(at_s[moment]).inv().apply(gap[moment, stake])
        covariance = self._covariance(offset)
        error = np.einsum(
            "nij,nj->ni", np.linalg.cholesky(covariance), self._rng.standard_normal(offset.shape)
        )
        return StakeSightings(at_s[moment], stake.astype(np.float64), offset + error, covariance)

    def _covariance(self, offset: FloatArray) -> FloatArray:
        """Long along the line of sight, slim across it (N, 3, 3) [m²]; never better than a centimetre."""
        distance = np.linalg.norm(offset, axis=1)
        ray = offset / distance[:, None]
        along = np.hypot(self._config.range_error_share * distance, 0.01)
        across = np.hypot(np.radians(self._config.bearing_error_deg) * distance, 0.01)
        outer = ray[:, :, None] * ray[:, None, :]
        covariance: FloatArray = along[:, None, None] ** 2 * outer + across[:, None, None] ** 2 * (
            np.eye(3) - outer
        )
        return covariance
