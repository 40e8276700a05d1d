"""GPS receivers: correlated errors by profile, outages, jumps, multipath, a base station, and faults.

A profile adds first-order Gauss–Markov errors to white noise; vertical errors are larger by a factor. `GpsReceiver`
gives the fixes of the vision fidelity, `draw_fixes` those of the statistical one. `GpsFaults` applies the faults of a
mission to them.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from sim.config.sensors import FaultConfig, GpsConfig, InstrumentsConfig, faults_of
from sim.instruments.sensor import (
    Clock,
    GaussMarkov,
    Moments,
    StatisticalDrive,
    gauss_markov,
    without_carried,
)
from sim.vehicle.motion import RoverMotion
from survey.core import FloatArray, stream
from survey.data.sensors.records import GpsFixes


class GpsProfile(NamedTuple):
    """Horizontal error of a receiver class on each axis."""

    bias_sigma_m: float
    """Standard deviation of the slowly varying part [m]."""
    correlation_s: float
    """Its correlation time [s]."""
    white_sigma_m: float
    """Standard deviation of the white part [m]."""


GPS_PROFILES = {
    "white": GpsProfile(0.0, 60.0, 3.0),
    "gauss-markov-60": GpsProfile(3.0, 60.0, 1.0),
    "gauss-markov-300": GpsProfile(3.0, 300.0, 1.0),
    "sbas": GpsProfile(1.0, 120.0, 0.5),
    "rtk": GpsProfile(0.015, 120.0, 0.01),
}
"""White errors of 3 m (the best case of the glacier paper's consumer receiver), correlated errors of 3 m, SBAS, RTK."""

_JUMP_LASTS_S = 60.0
_MULTIPATH_LASTS_S = 8.0


class Episodes:
    """Random episodes: Poisson starts, exponential durations."""

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


class _SlowErrors:
    """Slow errors of the rover's and the base station's receiver at their reading times.

    Part of the error is common to both; each receiver computes it from equal random streams.
    """

    def __init__(self, config: InstrumentsConfig, seed: int) -> None:
        profile = GPS_PROFILES[config.gps.profile]
        self._own_share = config.base_residual if config.base_station else 0.0
        self._clocks = [Clock(config.gps, seed, name) for name in ("gps", "base")]
        self._common, self._own = (
            GaussMarkov(
                profile.bias_sigma_m, profile.correlation_s, stream(seed, "instruments", "gps", name), 3
            )
            for name in ("common", "own")
        )

    def of_rover(self, until_s: float) -> tuple[Moments, FloatArray]:
        """Return the rover's reading times since the last call and the errors (N, 3) then [m]."""
        rover, _, ticks, common, own = self._drawn(until_s)
        return rover, (common + self._own_share * own)[np.isin(ticks, rover.at_s)]

    def of_base(self, until_s: float) -> tuple[Moments, FloatArray]:
        """Return the base's reading times since the last call and the errors (N, 3) then [m]."""
        _, base, ticks, common, _ = self._drawn(until_s)
        return base, common[np.isin(ticks, base.at_s)]

    def _drawn(self, until_s: float) -> tuple[Moments, Moments, FloatArray, FloatArray, FloatArray]:
        rover, base = (clock.due(until_s) for clock in self._clocks)
        ticks = np.union1d(rover.at_s, base.at_s)
        common = np.sqrt(1.0 - self._own_share**2) * self._common.at(ticks)
        return rover, base, ticks, common, self._own.at(ticks)


class GpsReceiver:
    """GPS receiver of the rover.

    `config`: profile, disturbances, base station. `antenna_height_m`: height above the body's origin [m].
    `seed`: the mission's seed.
    """

    def __init__(self, config: InstrumentsConfig, antenna_height_m: float, seed: int) -> None:
        gps = config.gps
        self._gps, self._antenna_m, self._seed = gps, antenna_height_m, seed
        self._slow = _SlowErrors(config, seed)
        self._white = stream(seed, "instruments", "gps", "white")
        self._events = {
            name: Episodes(per_h, lasts_s, stream(seed, "instruments", "gps", name))
            for name, per_h, lasts_s in (
                ("outages", gps.outages_per_h, gps.outage_s),
                ("jumps", gps.jumps_per_h, _JUMP_LASTS_S),
                ("multipath", gps.multipath_per_h, _MULTIPATH_LASTS_S),
            )
        }
        self._is_disturbed = max(gps.outages_per_h, gps.jumps_per_h, gps.multipath_per_h) > 0.0
        self._per_axis = np.array([1.0, 1.0, gps.vertical_factor])

    def sense(self, motion: RoverMotion) -> GpsFixes | None:
        """Return the fixes during a stretch of motion, or None without any."""
        (at_s, shown_s), slow = self._slow.of_rover(float(motion.time_s[-1]))
        antenna = motion.position_at(at_s) + motion.rotation_at(at_s).apply([0.0, 0.0, self._antenna_m])
        error = slow + _white(self._gps, self._white, len(at_s))
        fixes, arrived = antenna + error * self._per_axis, np.ones(len(at_s), dtype=np.bool_)
        for k, time_s in enumerate(at_s if self._is_disturbed else ()):
            arrived[k] = self._events["outages"].number_at(time_s) == 0
            fixes[k] += self._disturbance(time_s) * self._per_axis
        return _fixes(shown_s[arrived], fixes[arrived])

    def _disturbance(self, time_s: float) -> FloatArray:
        """Return jump and multipath (3,) at a time [m]; a jump is constant while it lasts, multipath changes."""
        total = np.zeros(3)
        jump = self._events["jumps"].number_at(time_s)
        if jump:
            rng = stream(self._seed, "instruments", "gps", "jump", jump)
            total += self._gps.jump_m * rng.standard_normal(3)
        if self._events["multipath"].number_at(time_s):
            tick = round(time_s * 1000.0)
            rng = stream(self._seed, "instruments", "gps", "reflection", tick)
            total += self._gps.multipath_m * rng.standard_normal(3)
        return total


class BaseReceiver:
    """Second GPS receiver, at rest at the start; it shares most of the rover's slow error.

    `config`: profile and share of the error that is not common. `start` (3,): place of its antenna [m].
    `seed`: the mission's seed.
    """

    def __init__(self, config: InstrumentsConfig, start: FloatArray, seed: int) -> None:
        self._gps, self._start = config.gps, start
        self._slow = _SlowErrors(config, seed)
        self._white = stream(seed, "instruments", "gps", "base white")
        self._per_axis = np.array([1.0, 1.0, config.gps.vertical_factor])

    def sense(self, motion: RoverMotion) -> GpsFixes | None:
        """Return the fixes during a stretch of motion, or None without any."""
        (at_s, shown_s), slow = self._slow.of_base(float(motion.time_s[-1]))
        error = slow + _white(self._gps, self._white, len(at_s))
        return _fixes(shown_s, self._start + error * self._per_axis)


def _white(config: GpsConfig, rng: np.random.Generator, n: int) -> FloatArray:
    """Return the white part (n, 3) of a receiver's error [m]."""
    return GPS_PROFILES[config.profile].white_sigma_m * rng.standard_normal((n, 3))


def _fixes(time_s: FloatArray, position: FloatArray) -> GpsFixes | None:
    """Return the fixes of a stretch, or None without any."""
    return _Stretch(time_s, position) if len(time_s) else None


class _Stretch(GpsFixes):
    """Fixes of one stretch of a drive; one is enough."""

    LEAST = 1


def draw_fixes(drive: StatisticalDrive) -> GpsFixes:
    """Draw the fixes of the rover's receiver, one at each real pose."""
    sensors, trajectory = drive.mission.sensors, drive.trajectory
    if drive.mission.aids.base_station:
        return _drawn_pair(drive)[0]
    rng = stream(drive.mission.seed, "sensors", "gps")
    gaps = np.diff(trajectory.time_s)
    bias = gauss_markov(gaps, sensors.gps_correlation_time_s, sensors.gps_bias_sigma_m, rng, 3)
    white = sensors.gps_white_sigma_m * rng.standard_normal(bias.shape)
    return GpsFixes(trajectory.time_s, _antenna(drive) + (bias + white) * _per_axis(drive))


def draw_base_fixes(drive: StatisticalDrive) -> GpsFixes | None:
    """Draw the fixes of the base station; None where the mission has none."""
    return _drawn_pair(drive)[1] if drive.mission.aids.base_station else None


def _drawn_pair(drive: StatisticalDrive) -> tuple[GpsFixes, GpsFixes]:
    """Draw the fixes of rover and base station.

    The rover's slow error is split into a common part and a part of its own, so that the
    stated share is left after differencing.
    """
    sensors, trajectory = drive.mission.sensors, drive.trajectory
    rng, own_share = stream(drive.mission.seed, "aids", "base"), drive.mission.aids.base_residual
    gaps = np.diff(trajectory.time_s)
    common, own = (
        gauss_markov(gaps, sensors.gps_correlation_time_s, sensors.gps_bias_sigma_m * share, rng, 3)
        for share in (np.sqrt(1.0 - own_share**2), own_share)
    )
    white = sensors.gps_white_sigma_m * rng.standard_normal((2, *common.shape))
    per_axis = _per_axis(drive)
    rover = GpsFixes(trajectory.time_s, _antenna(drive) + (common + own + white[0]) * per_axis)
    return rover, GpsFixes(trajectory.time_s, trajectory.position[0] + (common + white[1]) * per_axis)


def _antenna(drive: StatisticalDrive) -> FloatArray:
    return drive.trajectory.position + [0.0, 0.0, drive.mission.rover.antenna_height_m]


def _per_axis(drive: StatisticalDrive) -> FloatArray:
    return np.array([1.0, 1.0, drive.mission.sensors.gps_vertical_factor])


class GpsFaults:
    """Faults of the rover's receiver: off, frozen, jumped or delayed fixes.

    `faults`: all faults of the mission. `seed`: the mission's seed, for the direction of jumps.
    """

    def __init__(self, faults: Sequence[FaultConfig], seed: int) -> None:
        self._faults, self._seed = faults_of(faults, "gps"), seed
        self._carried = faults_of(faults, "rover")
        self._last: FloatArray | None = None
        self._recent: list[tuple[float, FloatArray]] = []

    def apply(self, fixes: GpsFixes) -> GpsFixes | None:
        """Return the fixes that the receiver reports, or None without any."""
        awake: GpsFixes | None = without_carried(fixes, self._carried)
        if awake is None or not self._faults:
            return awake
        reported = [self._fix(t, place) for t, place in zip(awake.time_s, awake.position, strict=True)]
        arrived = [fix for fix in reported if fix is not None]
        if not arrived:
            return None
        times, places = zip(*arrived, strict=True)
        return replace(awake, time_s=np.array(times), position=np.array(places))

    def _fix(self, time_s: float, place: FloatArray) -> tuple[float, FloatArray] | None:
        """Return one fix as reported, or None without one."""
        self._recent = [*self._recent, (time_s, place)][-600:]
        reported: FloatArray | None = place
        for k, fault in enumerate(fault for fault in self._faults if fault.is_on(time_s)):
            reported = self._faulty(reported, fault, time_s, k)
        if reported is None:
            return None
        self._last = reported
        return time_s, reported

    def _faulty(
        self, place: FloatArray | None, fault: FaultConfig, time_s: float, index: int
    ) -> FloatArray | None:
        match fault.failure:
            case "off":
                return None
            case "frozen":
                return self._last
            case "jump":
                away = stream(self._seed, "faults", "gps", index).standard_normal(3)
                return None if place is None else place + fault.size * away / np.linalg.norm(away)
            case _:
                old = [past for at, past in self._recent if at <= time_s - fault.size + 1e-9]
                return old[-1] if old else None
