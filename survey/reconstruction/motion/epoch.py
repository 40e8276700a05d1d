r"""Reduction of maps, recordings, paths and routes on moving ice to an epoch, and the age of a map.

Used as it is, a map errs after a time τ by the change of the surface at each place,

.. math::  e(x, \tau) = e(x, 0) - \tau (g \cdot v + a)

with g the slope of the map, v the velocity and a the lowering, whose errors count too. `MapAge` states how this error
grows, `with_age` adds it to a map, and `at_epoch` moves a map to another epoch instead. `in_ice_frame` reduces a
recording to one epoch, and `in_fixed_frame` and `route_on_ice` move paths and routes between fixed coordinates and
those of the ice.
"""

from dataclasses import replace
from typing import Any, NamedTuple, Self

import numpy as np
import numpy.typing as npt

from survey.core import FloatArray, InputError
from survey.data import Dem, Recording, Route, Trajectory
from survey.data.ice_motion import DAY_S, IceMotion
from survey.data.sensors.records import Barometer, GpsFixes
from survey.data.sensors.stakes import Stakes
from survey.reconstruction.motion.stakes import mean_stakes
from survey.reconstruction.terrain_map import CHECK, CLAIM, ELEVATION, UNSEEN, Reconstruction

AGE = "map_age"
"""Name of the age among the diagnostics of a map."""


class MapAge(NamedTuple):
    """RMSE of a map at its epoch, and the growth of its error.

    `epoch_s`: epoch in seconds of the recording. `speed_m_per_day`, `speed_sigma_m_per_day`: velocity in the
    middle of the map and its standard deviation along the flow [m/day]. `lowering_m_per_day`,
    `lowering_sigma_m_per_day`: lowering there and its standard deviation [m/day]. `rmse_m`: claimed RMSE at
    the epoch [m]. `growth_m_per_day`: root mean square change of the surface at fixed places, with its error
    [m/day].
    """

    epoch_s: float
    speed_m_per_day: float
    speed_sigma_m_per_day: float
    lowering_m_per_day: float
    lowering_sigma_m_per_day: float
    rmse_m: float
    growth_m_per_day: float

    @classmethod
    def of(cls, mean: Dem, std: Dem, motion: IceMotion) -> Self:
        """Return the age of a map.

        `mean`, `std`: map of the epoch and its standard deviation [m].
        """
        east, north = mean.gradient()
        known = np.isfinite(east) & np.isfinite(north) & np.isfinite(std.elevation)
        xy = mean.grid().xy[known.ravel()]
        by_rates = np.column_stack([-east[known], -north[known], np.ones(len(xy))])
        change = np.sum(by_rates * motion.rates(xy), axis=1)
        day = motion.derivatives(xy, np.full(len(xy), motion.epoch_s + DAY_S))
        by = np.einsum("na,nar->nr", by_rates, day)
        variance = np.einsum("nr,rs,ns->n", by, motion.spread, by)
        middle = xy.mean(axis=0, keepdims=True)
        (*velocity, rise), sigma = motion.rates(middle)[0], motion.rates_sigma(middle)[0]
        return cls(
            motion.epoch_s,
            float(np.hypot(*velocity)),
            float(sigma[:2].max()),
            float(-rise),
            float(sigma[2]),
            float(np.sqrt(np.mean(std.elevation[known] ** 2))),
            float(np.sqrt(np.mean(change**2 + variance))),
        )

    def hours_within(self, limit_m: float) -> float:
        """Return for how long before and after the epoch the RMSE stays below a limit [h].

        `limit_m`: largest RMSE [m]. Returns: 0 where the map exceeds it at its epoch, infinite where the
        surface does not change.

        >>> round(MapAge(0.0, 2.0, 0.1, 0.05, 0.02, 0.3, 0.4).hours_within(0.5), 6)
        24.0
        """
        left = limit_m**2 - self.rmse_m**2
        if left <= 0.0:
            return 0.0
        return (
            float(24.0 * np.sqrt(left) / self.growth_m_per_day)
            if self.growth_m_per_day > 0.0
            else float("inf")
        )

    def facts(self) -> dict[str, Any]:
        """Return the numbers by name, for the record."""
        return self._asdict()

    @classmethod
    def from_facts(cls, facts: dict[str, Any]) -> Self:
        """Return the age of recorded numbers."""
        return cls(**facts)


def with_age(result: Reconstruction, motion: IceMotion) -> Reconstruction:
    """Return a map with its age among the diagnostics."""
    facts = {AGE: MapAge.of(result.mean, result.std, motion).facts()}
    return replace(result, diagnostics={**result.diagnostics, **facts})


def at_epoch(result: Reconstruction, motion: IceMotion, epoch_s: float) -> tuple[Reconstruction, IceMotion]:
    """Move a map of ice that flows and lowers to another epoch.

    Errors of map and motion count as independent, as they nearly are at the middle of a survey.
    """
    if result.quantity != ELEVATION:
        raise InputError(
            f"the map is one of {result.quantity}; another epoch is computed of {ELEVATION} alone."
        )
    grid, mean = result.mean.grid(), result.mean.elevation
    times = np.full(len(grid.xy), epoch_s)
    flat = np.column_stack([grid.xy, np.zeros(len(grid.xy))])
    from_xy = motion.at_epoch(flat, times)[:, :2]
    height = result.mean.at(from_xy) + motion.displacement(from_xy, times)[:, 2]
    if not np.isfinite(height).any():
        raise InputError(
            f"by the epoch {epoch_s:g} s all ice of the map has left it; name an epoch nearer to that of the map, "
            f"{motion.epoch_s:g} s."
        )
    variance = result.std.at(from_xy) ** 2 + _motion_variance(result.mean, motion, from_xy, times)
    moved = replace(
        result,
        mean=Dem.on(grid, height.reshape(mean.shape), result.mean.vertical_datum),
        std=Dem.on(grid, np.sqrt(variance).reshape(mean.shape), result.std.vertical_datum),
        support=_support(result, from_xy),
        lower=None,
        upper=None,
        diagnostics={k: v for k, v in result.diagnostics.items() if k not in (CHECK, CLAIM)},
    )
    later = replace(motion, epoch_s=float(epoch_s))
    return with_age(moved, later), later


def _motion_variance(mean: Dem, motion: IceMotion, xy: FloatArray, times: FloatArray) -> FloatArray:
    """Return the variance (N,) that the motion adds to heights that it has moved by some times [m²]."""
    slopes = [Dem.on(mean.grid(), part).at(xy) for part in mean.gradient()]
    by_shift = np.column_stack([-slopes[0], -slopes[1], np.ones(len(xy))])
    by = np.einsum("na,nar->nr", by_shift, motion.derivatives(xy, times))
    variance: FloatArray = np.einsum("nr,rs,ns->n", by, motion.spread, by)
    return variance


def _support(result: Reconstruction, from_xy: FloatArray) -> npt.NDArray[np.uint8]:
    """Return the codes (H, W) of the nodes that are nearest to where the ice comes from."""
    grid = result.mean.grid()
    column = np.rint((from_xy[:, 0] - grid.x[0]) / grid.step_m).astype(np.int64)
    row = np.rint((grid.y[0] - from_xy[:, 1]) / grid.step_m).astype(np.int64)
    rows, columns = grid.shape
    inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    codes = result.support[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)]
    return np.where(inside, codes, UNSEEN).reshape(grid.shape).astype(np.uint8)


def in_ice_frame(recording: Recording, motion: IceMotion) -> Recording:
    """Return a recording in coordinates that move with the ice, equal to those of the survey at the epoch.

    Odometry, images, sightings and loop closures measure relative to the ice and stay as they are. Fixes, the start, the
    heights of the barometer and stakes are moved to the epoch. The unknowns of the motion become unknowns of
    localization: `vision_slam.localize` of the result estimates path, landmarks and motion together, and a map of these
    landmarks is that of the epoch. `vision_slam.localize` does both.

    Strain turns and stretches steps of the odometry by some 0.1 % a day, which is left to its errors of scale and
    heading.
    """
    stakes = recording.stakes if recording.stake_surveys is None else mean_stakes(recording.stake_surveys)
    begin_s = recording.gps.time_s[:1] if recording.odometry is None else recording.odometry.time_s[:1]
    start = motion.at_epoch(recording.start[None], begin_s)[0]
    gps = _moved_fixes(recording.gps, motion)
    return replace(
        recording,
        start=start,
        gps=gps,
        base=_beside(recording.base, start - recording.start),
        barometer=_moved_heights(recording.barometer, gps, motion),
        stakes=_moved_stakes(stakes, motion),
        ice_motion=motion,
    )


def _moved_fixes(gps: GpsFixes, motion: IceMotion) -> GpsFixes:
    return replace(gps, position=motion.at_epoch(gps.position, gps.time_s))


def _beside(base: GpsFixes | None, shift: FloatArray) -> GpsFixes | None:
    """Return the fixes of a base station that stands at the start, moved with the start: only their errors matter."""
    return None if base is None else replace(base, position=base.position + shift)


def _moved_heights(barometer: Barometer | None, gps: GpsFixes, motion: IceMotion) -> Barometer | None:
    """Return the heights of a barometer at the epoch; its place is that of the fixes."""
    if barometer is None:
        return None
    xy = np.column_stack([np.interp(barometer.time_s, gps.time_s, axis) for axis in gps.position[:, :2].T])
    risen = motion.displacement(xy, barometer.time_s)[:, 2]
    return replace(barometer, height_m=barometer.height_m - risen)


def _moved_stakes(stakes: Stakes | None, motion: IceMotion) -> Stakes | None:
    """Return stakes at the epoch; those without a time of survey are taken to be of the epoch."""
    if stakes is None or stakes.time_s is None:
        return stakes
    return replace(stakes, position=motion.at_epoch(stakes.position, stakes.time_s))


def in_fixed_frame(trajectory: Trajectory, motion: IceMotion) -> Trajectory:
    """Return a path that was estimated at an epoch in fixed coordinates: each pose where it was at its own time."""
    moved = motion.displacement(trajectory.position[:, :2], trajectory.time_s)
    return replace(trajectory, position=trajectory.position + moved, error=None)


def route_on_ice(route: Route, motion: IceMotion, speed_m_s: float) -> Route:
    """Return a route of fixed coordinates as the line that it draws on the ice of an epoch.

    `speed_m_s`: speed [m/s].

    >>> from survey.data.route import Leg
    >>> from survey.reconstruction.motion.priors import uniform_motion
    >>> flow = uniform_motion((0.0, 8.64), 0.0, velocity_sigma=1.0, lowering_sigma=0.0, epoch_s=0.0)
    >>> route = Route((Leg("swath", [[0.0, 0.0], [100.0, 0.0]]),), "EPSG:32608", "line")
    >>> np.round(route_on_ice(route, flow, 0.01).legs[0].xy, 6).tolist()
    [[0.0, 0.0], [100.0, -1.0]]
    """
    legs, begun_m = [], 0.0
    for leg in route.legs:
        steps = np.hypot(*np.diff(leg.xy, axis=0).T)
        time_s = (begun_m + np.r_[0.0, np.cumsum(steps)]) / speed_m_s
        xyz = np.column_stack([leg.xy, np.zeros(len(leg.xy))])
        xy = motion.at_epoch(xyz, time_s)[:, :2]
        legs.append(replace(leg, xy=xy, axis=xy[[0, -1]]))
        begun_m += leg.length_m
    return replace(route, legs=tuple(legs))
