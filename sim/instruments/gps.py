"""Satellite receivers with errors that last: five profiles, outages, jumps and multipath."""

from typing import NamedTuple

import numpy as np

from sim.config.sensors import GpsConfig, InstrumentsConfig
from sim.instruments.clock import Clock, GaussMarkov
from sim.vehicle.motion import RoverMotion
from survey.core.arrays import FloatArray
from survey.core.streams import stream
from survey.data.sensors import GpsFixes


class GpsProfile(NamedTuple):
    """Horizontal errors of a kind of receiver on each axis."""

    bias_sigma_m: float
    """Standard deviation of the slowly varying part [m]."""
    correlation_s: float
    """Its correlation time [s]."""
    white_sigma_m: float
    """Standard deviation of the part that is new in every fix [m]."""


GPS_PROFILES = {
    "white": GpsProfile(0.0, 60.0, 3.0),
    "gauss-markov-60": GpsProfile(3.0, 60.0, 1.0),
    "gauss-markov-300": GpsProfile(3.0, 300.0, 1.0),
    "sbas": GpsProfile(1.0, 120.0, 0.5),
    "rtk": GpsProfile(0.015, 120.0, 0.01),
}
"""3 m without memory (the glacier paper's consumer receiver at its kindest), 3 m with a memory, SBAS, RTK."""

_JUMP_LASTS_S = 60.0
_MULTIPATH_LASTS_S = 8.0


class Episodes:
    """Stretches of time that begin at random, at a rate, and last exponentially long."""

    def __init__(self, per_h: float, mean_s: float, rng: np.random.Generator) -> None:
        self._mean_gap_s = 3600.0 / per_h if per_h > 0.0 else np.inf
        self._mean_s, self._rng = mean_s, rng
        self._begin_s = self._gap()
        self._end_s = self._begin_s + self._rng.exponential(self._mean_s)
        self.n = 0

    def _gap(self) -> float:
        return float(self._rng.exponential(1.0)) * self._mean_gap_s

    def number_at(self, time_s: float) -> int:
        """Return the number of the episode that a time is in, counted from 1, or 0; times increase."""
        while time_s > self._end_s:
            self._begin_s = self._end_s + self._gap()
            self._end_s = self._begin_s + self._rng.exponential(self._mean_s)
            self.n += 1
        return self.n + 1 if time_s >= self._begin_s else 0


class GpsReceiver:
    """The rover's receiver and, if the mission has one, a second one that stands at the start.

    Parameters
    ----------
    config : InstrumentsConfig
        Profile, disturbances, base station.
    antenna_height_m : float
        Above the body's origin [m].
    seed : int
        The mission's.
    """

    def __init__(self, config: InstrumentsConfig, antenna_height_m: float, seed: int) -> None:
        gps = config.gps
        profile = GPS_PROFILES[gps.profile]
        self._config, self._profile, self._antenna_m = config, profile, antenna_height_m
        self._clock = Clock(gps, seed, "gps")
        self._base_clock = Clock(gps, seed, "base")

        def drift(name: str) -> GaussMarkov:
            rng = stream(seed, "instruments", "gps", name)
            return GaussMarkov(profile.bias_sigma_m, profile.correlation_s, rng, 3)

        self._common, self._own = drift("common"), drift("own")
        self._white = [stream(seed, "instruments", "gps", name) for name in ("white", "base white")]
        self._events = {
            name: Episodes(per_h, lasts_s, stream(seed, "instruments", "gps", name))
            for name, per_h, lasts_s in (
                ("outages", gps.outages_per_h, gps.outage_s),
                ("jumps", gps.jumps_per_h, _JUMP_LASTS_S),
                ("multipath", gps.multipath_per_h, _MULTIPATH_LASTS_S),
            )
        }
        self._is_disturbed = max(gps.outages_per_h, gps.jumps_per_h, gps.multipath_per_h) > 0.0
        self._seed = seed
        self._per_axis = np.array([1.0, 1.0, gps.vertical_factor])

    def sense(self, motion: RoverMotion, start: FloatArray) -> tuple[GpsFixes | None, GpsFixes | None]:
        """Return the fixes of the rover and of the base at `start` during a stretch of motion; None for none."""
        at_s, shown_s = self._clock.due(float(motion.time_s[-1]))
        base_at_s, base_shown_s = self._base_clock.due(float(motion.time_s[-1]))
        ticks = np.union1d(at_s, base_at_s)
        common, own = self._common.at(ticks), self._own.at(ticks)
        share = self._config.base_residual if self._config.base_station else 0.0
        both = np.sqrt(1.0 - share**2) * common
        antenna = motion.position_at(at_s) + motion.rotation_at(at_s).apply([0.0, 0.0, self._antenna_m])
        of_rover = np.isin(ticks, at_s)
        error = (both + share * own)[of_rover] + self._white_noise(0, len(at_s))
        fixes, kept = antenna + error * self._per_axis, np.ones(len(at_s), dtype=np.bool_)
        for k, time_s in enumerate(at_s if self._is_disturbed else ()):
            kept[k] = self._events["outages"].number_at(time_s) == 0
            fixes[k] += self._disturbance(time_s) * self._per_axis
        base = (
            start + (both[np.isin(ticks, base_at_s)] + self._white_noise(1, len(base_at_s))) * self._per_axis
        )
        return _fixes(shown_s[kept], fixes[kept]), (
            _fixes(base_shown_s, base) if self._config.base_station else None
        )

    def _white_noise(self, which: int, n: int) -> FloatArray:
        return self._profile.white_sigma_m * self._white[which].standard_normal((n, 3))

    def _disturbance(self, time_s: float) -> FloatArray:
        """Jump and multipath (3,) at a time [m]; a jump stays the same while it lasts, reflections change."""
        gps: GpsConfig = self._config.gps
        total = np.zeros(3)
        jump = self._events["jumps"].number_at(time_s)
        if jump:
            total += gps.jump_m * stream(self._seed, "instruments", "gps", "jump", jump).standard_normal(3)
        if self._events["multipath"].number_at(time_s):
            tick = round(time_s * 1000.0)
            rng = stream(self._seed, "instruments", "gps", "reflection", tick)
            total += gps.multipath_m * rng.standard_normal(3)
        return total


def _fixes(time_s: FloatArray, position: FloatArray) -> GpsFixes | None:
    """Return the fixes of a stretch; None of none."""
    return _Part(time_s, position) if len(time_s) else None


class _Part(GpsFixes):
    """Some fixes of many."""

    LEAST = 1
