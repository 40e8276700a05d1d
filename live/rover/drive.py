"""Drawn motion and sensors of the simulated rover: it follows its waypoints at constant speed, and fixes err."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import shapely
from pyproj import CRS

from live.mission.items import EXCLUSION_POLYGON, INCLUSION_POLYGON, LinkItem
from survey.core.arrays import FloatArray
from survey.core.streams import stream
from survey.core.transformation import chosen_crs, transformed
from survey.data.dem import Dem
from survey.io.vector import WGS84

_STEP_M = 0.5


@dataclass(frozen=True)
class RoverSettings:
    """What the simulated rover is like.

    Parameters
    ----------
    speed_m_s : float
        Speed along the path.
    range_m : float
        Distance that one charge of the battery lasts [m].
    sigma_horizontal_m, sigma_vertical_m : float
        Standard deviation of a fix east and north, and up [m].
    correlation_time_s : float
        Time constant of the fixes' Gauss-Markov errors [s].
    seed : int
        Of the drawn errors.
    """

    speed_m_s: float = 1.0
    range_m: float = 12_000.0
    sigma_horizontal_m: float = 0.02
    sigma_vertical_m: float = 0.03
    correlation_time_s: float = 2.0
    seed: int = 0


class RoverReport(NamedTuple):
    """State that telemetry reports.

    Parameters
    ----------
    time_s : float
        Since the start [s].
    xy : (2,) ndarray
        Real place in `WaypointDrive.crs` [m].
    lonlat : (2,) ndarray
        Measured place [deg].
    height_m : float
        Measured height [m].
    heading_deg : float
        Clockwise from north.
    speed_m_s : float
        Over ground; 0 at rest.
    battery : float
        Share of the charge that is left.
    waypoint : int
        Waypoints that were reached.
    is_held : bool
        Whether it stopped at the fence.
    """

    time_s: float
    xy: FloatArray
    lonlat: FloatArray
    height_m: float
    heading_deg: float
    speed_m_s: float
    battery: float
    waypoint: int
    is_held: bool


@dataclass
class WaypointDrive:
    """Motion of the rover in a projected CRS.

    Parameters
    ----------
    settings : RoverSettings
        Speed, battery, errors.
    crs : CRS
        In metres.
    terrain : Dem, optional
        Heights; 0 without it.
    """

    settings: RoverSettings
    crs: CRS
    terrain: Dem | None = None
    path: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))
    fence: shapely.Geometry | None = None
    is_driving: bool = False
    is_held: bool = False
    time_s: float = 0.0
    driven_m: float = 0.0
    _along_m: float = 0.0

    def __post_init__(self) -> None:
        self._rng = stream(self.settings.seed, "live.rover.fixes")
        self._error = self._rng.normal(size=3)
        self.xy = np.zeros(2)

    @classmethod
    def over(cls, settings: RoverSettings, terrain: Dem | None, first: LinkItem) -> "WaypointDrive":
        """Return a rover at rest at the first waypoint, in the CRS of the terrain or the waypoint's UTM zone."""
        latitude, longitude = first.degrees
        crs = terrain.crs if terrain is not None else chosen_crs(np.array([longitude]), np.array([latitude]))
        drive = cls(settings, crs, terrain)
        drive.xy = drive.places([first])[0]
        return drive

    def places(self, items: list[LinkItem]) -> FloatArray:
        """Return the places (N, 2) of items in the CRS of the drive [m]."""
        degrees = np.array([item.degrees[::-1] for item in items])
        return transformed(degrees, WGS84, self.crs, "the mission")

    def set_mission(self, items: list[LinkItem]) -> None:
        """Exchange the waypoints; the rover stops and waits to be started."""
        waypoints = [item for item in items if item.is_waypoint]
        self.path = self.places(waypoints) if waypoints else np.zeros((0, 2))
        self.is_driving, self.is_held, self._along_m = False, False, 0.0

    def set_fence(self, items: list[LinkItem]) -> None:
        """Exchange the fence: polygons of inclusion and exclusion."""
        self.fence = _fence_of(items, self)

    def start(self) -> None:
        """Begin to drive, from where the rover is to the first waypoint."""
        if len(self.path) and not self.is_driving:
            self.path = np.vstack([self.xy, self.path])
            self._along_m, self.is_driving = 0.0, True

    def advance(self, seconds: float) -> RoverReport:
        """Drive for some time, and return what telemetry reports."""
        self.time_s += seconds
        self._draw_error(seconds)
        heading, moves, waypoint = 0.0, False, 0
        if self.is_driving and not self.is_held:
            heading, moves, waypoint = self._follow(self.settings.speed_m_s * seconds)
        return self._state(heading, self.settings.speed_m_s if moves else 0.0, waypoint)

    def _follow(self, distance_m: float) -> tuple[float, bool, int]:
        """Go on along the path; return heading [deg], whether it moves, and the waypoints reached."""
        ends = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(self.path, axis=0).T))])
        before = self._along_m
        self._along_m = min(before + distance_m, float(ends[-1]))
        ahead = min(self._along_m + _STEP_M, float(ends[-1]))
        xy, beyond = (
            np.array([np.interp(s, ends, axis) for axis in self.path.T]) for s in (self._along_m, ahead)
        )
        if self.fence is not None and not self.fence.covers(shapely.Point(xy)):
            self.is_held = True
            return 0.0, False, 0
        east, north = beyond - xy if ahead > self._along_m else self.path[-1] - self.path[-2]
        self.xy = xy
        self.driven_m += self._along_m - before
        self.is_driving = self._along_m < float(ends[-1])
        reached = int(np.searchsorted(ends, self._along_m + 1e-9, side="right")) - 1
        return float(np.degrees(np.arctan2(east, north)) % 360.0), self._along_m > before, reached

    def _draw_error(self, seconds: float) -> None:
        """Advance the Gauss-Markov errors of the fixes, in standard deviations."""
        share = float(np.exp(-seconds / self.settings.correlation_time_s))
        self._error = share * self._error + np.sqrt(1.0 - share**2) * self._rng.normal(size=3)

    def _state(self, heading_deg: float, speed_m_s: float, waypoint: int) -> RoverReport:
        sigma = self.settings.sigma_horizontal_m
        measured = transformed((self.xy + sigma * self._error[:2])[None], self.crs, WGS84, "the rover")[0]
        ground = 0.0 if self.terrain is None else float(np.nan_to_num(self.terrain.at(self.xy[None])[0]))
        height = ground + self.settings.sigma_vertical_m * float(self._error[2])
        battery = max(0.0, 1.0 - self.driven_m / self.settings.range_m)
        return RoverReport(
            self.time_s, self.xy, measured, height, heading_deg, speed_m_s, battery, waypoint, self.is_held
        )


def _fence_of(items: list[LinkItem], drive: WaypointDrive) -> shapely.Geometry | None:
    """Return the ground within all inclusions and outside all exclusions; None without polygons."""
    inside: shapely.Geometry | None = None
    outside: list[shapely.Geometry] = []
    index = 0
    while index < len(items):
        item, n = items[index], max(int(items[index].params[0]), 1)
        if item.command in (INCLUSION_POLYGON, EXCLUSION_POLYGON):
            polygon = shapely.Polygon(drive.places(items[index : index + n]))
            if item.command == INCLUSION_POLYGON:
                inside = polygon if inside is None else inside.union(polygon)
            else:
                outside.append(polygon)
            index += n
        else:
            index += 1
    return None if inside is None else inside.difference(shapely.union_all(outside))
