r"""Moving ice: flow and melt of a simulated glacier, the estimator's prior of them, and planned routes.

Places are those of the start of the drive, X; at the time t the ice of X is at x = X + v(X) t and the surface is lower by
a(t). Across a valley of half width w the surface velocity of a glacier of parabolic bed is close to

.. math::  v(y) = v_0 \left( s + (1 - s) \left( 1 - (|y| / w)^{n + 1} \right) \right)

with n the exponent of Glen's law and s the share of sliding: shear is concentrated at the margins.

The prior is one velocity, or velocity rasters with their errors. `in_ice_order` sets the order of the swaths of a planned
route; `write_on_ice` writes its lines in the coordinates of the ice of one epoch, beside the fixed ones.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import shapely
from pyproj import CRS

from planners import LawnmowerConfig, WavyConfig
from planners.routes.rover import predicted
from sim.config.mission import MissionConfig
from sim.config.world import IceAssumptions, IceConfig
from sim.world.site import World
from survey import ConfigError, Dem, InputError, Leg, Recording, Route, Trajectory, Truth
from survey.core import FloatArray, same_crs
from survey.data.ice_motion import IceMotion
from survey.reconstruction.motion.epoch import route_on_ice
from survey.reconstruction.motion.priors import VelocityRasters, motion_from_rasters

_DAY_S = 86400.0
_WARMEST_S = 14.0 * 3600.0
_PASSES = 6


@dataclass(frozen=True)
class MovingIce:
    """Motion of the ice since the start of a drive.

    `config`: flow and melt. `middle` (2,): a place on the centre line [m]. `velocity`: rasters of the
    velocity to the east and to the north [m/day].
    """

    config: IceConfig
    middle: FloatArray
    velocity: tuple[Dem, Dem] | None = None

    def velocities(self, xy: FloatArray) -> FloatArray:
        """Return the velocity (N, 2) of the ice that starts at places (N, 2) [m/day]."""
        if self.velocity is not None:
            read = np.column_stack([raster.at(xy) for raster in self.velocity])
            return np.where(np.isfinite(read), read, 0.0)
        config, angle = self.config, np.radians(self.config.direction_deg)
        along = np.array([np.cos(angle), np.sin(angle)])
        speed = np.full(len(xy), config.velocity_m_per_day)
        if config.flow == "valley":
            aside = (xy - self.middle) @ np.array([-along[1], along[0]]) / config.half_width_m
            deforming = 1.0 - np.minimum(np.abs(aside), 1.0) ** (config.flow_exponent + 1.0)
            speed *= config.margin_share + (1.0 - config.margin_share) * deforming
        velocity: FloatArray = speed[:, None] * along
        return velocity

    def lowering(self, time_s: FloatArray) -> FloatArray:
        """Return the melt since the start of the drive (N,) [m]."""
        config, turn = self.config, 2.0 * np.pi / _DAY_S
        begin = turn * (3600.0 * config.start_hour - _WARMEST_S)
        # The integral of a melt rate that varies with the hour, most at 14 h.
        wave = (np.sin(turn * time_s + begin) - np.sin(begin)) / turn
        melted: FloatArray = config.melt_m_per_day / _DAY_S * (time_s + config.diurnal_share * wave)
        return melted

    def displacement(self, xy: FloatArray, time_s: FloatArray) -> FloatArray:
        """Return how far the surface that starts at places (N, 2) has moved by some times (N, 3) [m]."""
        days = np.asarray(time_s)[:, None] / _DAY_S
        return np.column_stack([self.velocities(xy) * days, -self.lowering(np.asarray(time_s))])

    def starts(self, xy: FloatArray, time_s: FloatArray) -> FloatArray:
        """Return where the ice that is at places (N, 2) at some times was at the start [m]."""
        places = xy
        # Fixed-point iteration: the velocity is that of the place at the start, which is sought.
        for _ in range(_PASSES):
            places = xy - self.displacement(places, time_s)[:, :2]
        return places

    def carried(self, trajectory: Trajectory) -> Trajectory:
        """Return a path in fixed coordinates from the path on the ice."""
        moved = self.displacement(trajectory.position[:, :2], trajectory.time_s)
        return replace(trajectory, position=trajectory.position + moved)

    def fixed_truth(self, truth: Truth, epoch_s: float) -> Truth:
        """Return the terrain of an epoch and the path in fixed coordinates, from those on the ice of the start."""
        return Truth(self.terrain_at(truth.dem, epoch_s), self.carried(truth.trajectory))

    def terrain_at(self, terrain: Dem, time_s: float) -> Dem:
        """Return the terrain at a time; beyond the edge it goes on as it is there.

        `time_s`: time since the start of the drive [s].
        """
        grid = terrain.grid()
        times = np.full(len(grid.xy), time_s)
        xmin, ymin, xmax, ymax = grid.bounds
        starts = np.clip(self.starts(grid.xy, times), (xmin, ymin), (xmax, ymax))
        height = terrain.at(starts) - self.lowering(times)
        return Dem.on(grid, height.reshape(grid.shape), terrain.vertical_datum)


def moving_ice(mission: MissionConfig, terrain: Dem) -> MovingIce | None:
    """Return the motion of the ice of a mission, or None where the mission states none."""
    config = mission.ice
    if config is None:
        return None
    xmin, ymin, xmax, ymax = terrain.bounds
    middle = np.array([0.5 * (xmin + xmax), 0.5 * (ymin + ymax)])
    if config.velocity_files is None:
        return MovingIce(config, middle)
    east, north = (Dem.read(mission.path(file)) for file in config.velocity_files)
    for raster in (east, north):
        if raster.crs != terrain.crs:
            raise InputError(
                f"ice.velocity_files are in {raster.crs.name} and the terrain in {terrain.crs.name}; warp them to that of the "
                "terrain first."
            )
    return MovingIce(config, middle, (east, north))


def epoch_of(recording: Recording, mission: MissionConfig) -> float:
    """Return the epoch of the map of a recording on moving ice [s]: that of the mission, or the middle of the drive."""
    stated = None if mission.ice is None else mission.ice.epoch_s
    return float(np.mean(recording.gps.time_s[[0, -1]])) if stated is None else stated


def assumed_motion(
    assumed: IceAssumptions,
    epoch_s: float,
    places: FloatArray,
    crs: CRS,
    *,
    path_of: Callable[[str], Path] = Path,
) -> IceMotion:
    """Return the prior of the motion of the ice about a survey.

    `places` (N, 2): easting and northing of places of the survey, the start first [m].
    """
    if assumed.velocity_files is None:
        east, north = places[0].tolist()
        return assumed.prior(epoch_s, (east, north))
    rasters = VelocityRasters(*(Dem.read(path_of(file)) for file in assumed.velocity_files))
    for raster in rasters:
        same_crs(crs, raster.crs, "the survey and the rasters of the velocity")
    (xmin, ymin), (xmax, ymax) = np.min(places, axis=0).tolist(), np.max(places, axis=0).tolist()
    return motion_from_rasters(
        rasters,
        (xmin, ymin, xmax, ymax),
        lowering=assumed.lowering_m_per_day,
        lowering_sigma=assumed.lowering_sigma_m_per_day,
        epoch_s=epoch_s,
    )


def in_ice_order(route: Route, mission: MissionConfig, world: World) -> Route:
    """Return a planned route with its swaths in the order that the mission states for moving ice.

    Neighbouring swaths that are driven hours apart show the motion of the ice where they see the same ground.
    """
    if mission.ice is None or mission.ice.swath_order == "adjacent":
        return route
    if (
        not isinstance(mission.planner, LawnmowerConfig | WavyConfig)
        or route.n_lines < len(route.swaths)
        or mission.rover.turn_radius_m > 0.0
    ):
        raise ConfigError(
            "ice.swath_order = 'alternate' needs lawnmower or wavy swaths from border to border and a rover that pivots; "
            "leave it out."
        )
    n = len(route.swaths) - mission.planner.tie_lines
    along, across = route.swaths[:n], route.swaths[n:]
    legs = _joined_swaths((*along[::2], *along[1::2][::-1], *across), route.legs[0].xy[0])
    if not world.area.free.covers(shapely.multilinestrings([leg.xy for leg in legs])):
        raise ConfigError(
            "ice.swath_order = 'alternate' needs free ground between the ends of the swaths; leave it out."
        )
    facts = predicted(legs, mission.rover, _covering(world.prior, legs), crs=route.crs)
    return replace(route, legs=legs, prediction={**route.prediction, **facts})


def _joined_swaths(swaths: tuple[Leg, ...], start: FloatArray) -> tuple[Leg, ...]:
    """Join swaths by straight transits, each entered at its nearer end."""
    legs: list[Leg] = []
    here = start
    for swath in swaths:
        gaps = np.hypot(*(swath.xy[[0, -1]] - here).T)
        way = 1 if gaps[0] <= gaps[1] else -1
        if gaps.min() > 0.0:
            legs.append(Leg("transit", np.array([here, swath.xy[::way][0]])))
        legs.append(Leg("swath", swath.xy[::way], axis=swath.axis[::way]))
        here = legs[-1].xy[-1]
    return tuple(legs)


def _covering(prior: Dem, legs: tuple[Leg, ...]) -> Dem | None:
    """Return the prior where it has a height at every waypoint."""
    return prior if np.isfinite(prior.at(np.vstack([leg.xy for leg in legs]))).all() else None


def draw_on_ice(route: Route, mission: MissionConfig) -> Route:
    """Return the planned route as it lies on the ice of the epoch, by the motion that is assumed."""
    ice, speed_m_s = mission.ice, mission.rover.speed_m_s
    if ice is None:
        return route
    middle_s = 0.5 * route.length_m / speed_m_s
    epoch_s = middle_s if ice.epoch_s is None else ice.epoch_s
    places = np.vstack([leg.xy for leg in route.legs])
    prior = assumed_motion(ice.assumed, epoch_s, places, route.crs, path_of=mission.path)
    return route_on_ice(route, prior, speed_m_s)


def write_on_ice(route: Route, mission: MissionConfig, folder: Path) -> None:
    """Write the route on the ice of the epoch, and a GeoPackage with both as layers."""
    drawn = draw_on_ice(route, mission)
    drawn.write(folder / "route_on_ice.geojson")
    route.write(folder / "route.gpkg", also={"route_on_ice": drawn})
