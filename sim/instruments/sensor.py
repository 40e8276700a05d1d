"""Simulated sensors in general: clocks, correlated noise, and the description of one sensor.

A `Clock` gives the times of the readings, with offset and lost readings. `GaussMarkov` is a first-order Gauss–Markov
process, `RandomWalkNoise` white noise with a random walk. A `Sensor` names a table of the recording, its instrument in
the vision fidelity, its error model in the statistical one, and its faults.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import Any, NamedTuple, Protocol

import numpy as np

from sim.config.mission import MissionConfig
from sim.config.sensors import FaultConfig, InstrumentConfig, InstrumentsConfig
from sim.vehicle.motion import RoverMotion
from sim.world.moving_ice import MovingIce
from survey import Dem, Route, Trajectory
from survey.core import FloatArray, stream


class Moments(NamedTuple):
    """Times of readings: ``at_s`` the real ones, ``shown_s`` those of the instrument's clock."""

    at_s: FloatArray
    shown_s: FloatArray


class Clock:
    """Reading times of an instrument with a fixed rate, a clock offset and lost readings.

    >>> clock = Clock(InstrumentConfig(rate_hz=2.0, clock_offset_s=0.25), 1, "gps")
    >>> clock.due(1.0).shown_s.tolist(), clock.due(1.6).at_s.tolist()
    ([0.25, 0.75, 1.25], [1.5])
    """

    def __init__(self, config: InstrumentConfig, seed: int, name: str) -> None:
        self._config = config
        self._rng = stream(seed, "instruments", name, "dropped")
        self._n_read = 0

    def due(self, until_s: float) -> Moments:
        """Return the reading times since the last call up to and including a time, without lost readings."""
        rate = self._config.rate_hz
        last = int(np.floor(until_s * rate + 1e-6))
        at_s = np.arange(self._n_read, last + 1) / rate
        self._n_read = max(last + 1, self._n_read)
        arrived = self._rng.random(len(at_s)) >= self._config.dropped_share
        return Moments(at_s[arrived], at_s[arrived] + self._config.clock_offset_s)


def gauss_markov(
    steps: FloatArray, correlation: float, sigma: float, rng: np.random.Generator, n_columns: int = 1
) -> FloatArray:
    r"""Draw stationary first-order Gauss–Markov series.

    .. math:: b_{k+1} = a b_k + \sigma \sqrt{1 - a^2}\, w_k, \qquad a = e^{-\Delta / \tau}

    with autocovariance :math:`\sigma^2 e^{-|t|/\tau}`; the first value is drawn from N(0, σ²).

    `steps` (N,): distances Δ between neighbouring samples, in time or travel. Returns (N + 1, n_columns): the
    series.
    """
    decay = np.exp(-steps / correlation)
    noise = rng.standard_normal((len(steps) + 1, n_columns)) * sigma
    if len(decay) and np.allclose(decay, decay[0], rtol=_EQUAL):
        decay = np.full_like(decay, decay[0])
    return np.vstack([noise[:1], _propagated(noise[0], decay, noise[1:])])


class GaussMarkov:
    """First-order Gauss–Markov errors that continue from call to call; see `gauss_markov`."""

    def __init__(self, sigma: float, correlation_s: float, rng: np.random.Generator, n_columns: int) -> None:
        self._sigma, self._correlation_s, self._rng = sigma, correlation_s, rng
        self._at_s = np.nan  # nothing drawn yet
        self._value = np.zeros(n_columns)

    def at(self, time_s: FloatArray) -> FloatArray:
        """Return the errors (N, n_columns) at increasing times after those of earlier calls."""
        noise = self._sigma * self._rng.standard_normal((len(time_s), len(self._value)))
        if not len(time_s):
            return noise
        first = noise[:0]
        if np.isnan(self._at_s):
            self._at_s, self._value = float(time_s[0]), noise[0]
            first, time_s, noise = noise[:1], time_s[1:], noise[1:]
        decay = np.exp(-np.diff(time_s, prepend=self._at_s) / self._correlation_s)
        series = np.vstack([first, _propagated(self._value, decay, noise)])
        self._at_s, self._value = float(time_s[-1]) if len(time_s) else self._at_s, series[-1].copy()
        return series


_EQUAL = 1e-12


def _propagated(value: FloatArray, decay: FloatArray, noise: FloatArray) -> FloatArray:
    """Return the values (N, n) that follow `value` (n,) under decays (N,) and white noise (N, n) of full size."""
    if not len(decay):
        return noise
    driven = np.sqrt(1.0 - decay**2)[:, None] * noise
    a = float(decay[-1])
    if np.allclose(decay, a, rtol=_EQUAL):
        columns = zip(value.tolist(), driven.T.tolist(), strict=True)
        series: FloatArray = np.column_stack([_filtered(first, column, a) for first, column in columns])
        return series
    for k, share in enumerate(decay):
        value = share * value + driven[k]
        driven[k] = value
    return driven


class RandomWalkNoise:
    """White noise plus a bias in random walk on three axes, for readings at equal steps.

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


def _filtered(first: float, driven: list[float], decay: float) -> list[float]:
    """Return y of ``y[k] = decay y[k - 1] + driven[k]``, the bits of `scipy.signal.lfilter`, which imports slowly."""
    return list(accumulate(driven, lambda last, new: decay * last + new, initial=first))[1:]


class Instrument(Protocol):
    """Reads the real motion stretch by stretch; clocks and errors continue from call to call."""

    def sense(self, motion: RoverMotion, /) -> Any:
        """Return the records of a stretch of motion, or None without readings."""
        ...


class RecordFaults(Protocol):
    """Faults of one sensor, applied to its records stretch by stretch."""

    def apply(self, records: Any, /) -> Any:
        """Return the records with the faults in them, or None where none are left."""
        ...


@dataclass(frozen=True)
class InstrumentSetup:
    """Everything that the instruments of one drive are built from.

    `config`: rates, clocks and errors. `antenna_height_m`: height of the GPS antenna above the ground [m].
    `start` (3,): place of the base station's antenna [m]. `stakes` (K, 3): real places of the stakes [m].
    `seed`: seed of the rover's errors. `site_seed`: seed of what is the same for all rovers on the site.
    `ice`: motion of the ice.
    """

    config: InstrumentsConfig
    antenna_height_m: float
    start: FloatArray
    stakes: FloatArray
    seed: int
    site_seed: int
    ice: MovingIce | None = None


@dataclass(frozen=True)
class StatisticalDrive:
    """A drive whose sensor records are drawn from error models.

    `terrain`: the real terrain. `route`: the route, which the rover follows exactly. `trajectory`: real
    poses, one a second. `attitude_rad` (N, 3): real roll, pitch and yaw [rad]. `mission`: errors of the
    sensors, and the seed. `ice`: motion of the ice; the path is then that on the ice of the start of the
    drive, or the fixed one for sensors that measure in fixed coordinates.
    """

    terrain: Dem
    route: Route
    trajectory: Trajectory
    attitude_rad: FloatArray
    mission: MissionConfig
    ice: MovingIce | None = None


@dataclass(frozen=True)
class Sensor:
    """One sensor: everything that the simulator does with it.

    `name`: name of its table in a recording, a field of `survey.data.sensors.SensorTables`. `instrument`:
    builds what reads the motion in the vision fidelity; gives None where the mission has no such sensor.
    `draw`: draws the table in the statistical fidelity; gives None where the mission has no such sensor.
    `faults`: builds the sensor's faults from all faults of a mission and its seed. `is_aboard`: whether it is
    on the rover and therefore silent while the rover is carried. `is_fixed`: whether it measures in fixed
    coordinates; others measure relative to the ice, which may move.
    """

    name: str
    instrument: Callable[[InstrumentSetup], Instrument | None] | None = None
    draw: Callable[[StatisticalDrive], Any] | None = None
    faults: Callable[[Sequence[FaultConfig], int], RecordFaults] | None = None
    is_aboard: bool = True
    is_fixed: bool = False


def without_carried(records: Any, carried: Sequence[FaultConfig]) -> Any:
    """Return the records outside the times that the rover is carried, or None where none are left."""
    if records is None or not carried:
        return records
    awake = np.array([not any(fault.is_on(t) for fault in carried) for t in records.time_s], dtype=bool)
    if not awake.any():
        return None
    return records.select(awake)
