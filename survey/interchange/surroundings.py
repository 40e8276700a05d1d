"""What an exported route takes along: area, terrain, autopilot, speed and the way home."""

import logging
from dataclasses import dataclass
from typing import Literal

import numpy as np
import shapely
from shapely import LineString, Polygon

from survey.core.arrays import FloatArray
from survey.core.crs.agreement import same_crs
from survey.core.crs.vertical_datum import ELLIPSOIDAL
from survey.core.errors import InputError
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.route import Route

FENCE_MARGIN_M = 10.0
"""Distance of the fence of an autopilot from the outline of the area, to its outside [m]."""
_SIMPLIFIED_M = 1.0
_logger = logging.getLogger(__name__)

Autopilot = Literal["ardupilot", "px4"]


@dataclass(frozen=True)
class Surroundings:
    """What is written beside the waypoints of a route.

    Parameters
    ----------
    area : SurveyArea, optional
        Becomes the fence of missions, and polygons of KML.
    terrain : Dem, optional
        Heights of waypoints and of the home position.
    autopilot : {"ardupilot", "px4"}
        For missions.
    speed_m_s : float, optional
        Speed that a mission sets [m/s]; by default none, and the plan states the mean one.
    returns : bool
        Whether a mission ends with a return to launch, straight to the start.

    Raises
    ------
    InputError
        A speed that is not greater than 0.
    """

    area: SurveyArea | None = None
    terrain: Dem | None = None
    autopilot: Autopilot = "px4"
    speed_m_s: float | None = None
    returns: bool = False

    def __post_init__(self) -> None:
        if self.speed_m_s is not None and not 0.0 < self.speed_m_s < 100.0:
            raise InputError(
                f"the speed is {self.speed_m_s:g} m/s; a number above 0 and below 100 was expected."
            )

    def check(self, route: Route) -> None:
        """Refuse an area or a terrain that does not belong to a route.

        Parameters
        ----------
        route : Route
            The route to be written.

        Raises
        ------
        InputError
            Another CRS; a route that leaves the fence; a return that leaves the area or crosses no-go ground.
        """
        if self.terrain is not None:
            same_crs(route.crs, self.terrain.crs, "the route and the terrain")
        if self.area is None:
            return
        self.area.require_crs(route.crs, "the route")
        fence = fence_outline(self.area)
        for rover in range(route.n_rovers):
            path = route.path(rover)
            outside = LineString(path).difference(fence).length
            if outside > 0.0:
                raise InputError(
                    f"{outside:.0f} m of the route of rover {rover + 1} lie more than {FENCE_MARGIN_M:g} m outside the area; "
                    "name the area that it was planned for."
                )
            if self.returns and not self.area.free.buffer(0.01).covers(LineString(path[[-1, 0]])):
                raise InputError(
                    f"the straight way back of rover {rover + 1} leaves the area or crosses no-go ground; plan it with "
                    "--set fleet.return_to_start=true instead."
                )

    def heights(self, xy: FloatArray) -> FloatArray | None:
        """Return the height of the ground at places (N, 2) [m]; None without terrain.

        Parameters
        ----------
        xy : (N, 2) ndarray
            Easting and northing [m].

        Returns
        -------
        (N,) ndarray or None
            Above the datum of the terrain.

        Raises
        ------
        InputError
            A place without a height.
        """
        if self.terrain is None:
            return None
        if self.terrain.vertical_datum == ELLIPSOIDAL:
            _logger.warning(
                "the heights of the mission count from the ellipsoid, and autopilots read them as heights above the geoid, "
                "tens of metres apart; take a raster above the geoid"
            )
        heights = self.terrain.at(xy)
        if not np.isfinite(heights).all():
            x, y = xy[np.flatnonzero(~np.isfinite(heights))[0]]
            raise InputError(
                f"the terrain has no height at the waypoint ({x:.1f}, {y:.1f}); take a raster that covers the route."
            )
        return heights


def fence_outline(area: SurveyArea) -> Polygon:
    """Return the outline within which a rover has to stay: that of the area, a margin outside, without holes.

    Parameters
    ----------
    area : SurveyArea
        Of several parts, their convex hull counts.

    Returns
    -------
    shapely.Polygon
        In the CRS of the area [m].

    Examples
    --------
    >>> fence_outline(SurveyArea.rectangle((0.0, 0.0, 80.0, 40.0), "EPSG:32608")).bounds
    (-10.0, -10.0, 90.0, 50.0)
    """
    parts = shapely.get_parts(area.polygon)
    outline = parts[0] if len(parts) == 1 else area.polygon.convex_hull
    grown = Polygon(outline.exterior).buffer(FENCE_MARGIN_M, join_style="mitre")
    return Polygon(grown.simplify(_SIMPLIFIED_M).exterior)


def no_go_outlines(area: SurveyArea) -> list[Polygon]:
    """Return the no-go zones of an area and its holes, without holes of their own.

    Parameters
    ----------
    area : SurveyArea
        With its zones.

    Returns
    -------
    list of shapely.Polygon
        In the CRS of the area [m].
    """
    holes = [ring for part in shapely.get_parts(area.polygon) for ring in part.interiors]
    return [Polygon(zone.exterior) for zone in area.no_go] + [Polygon(ring) for ring in holes]
