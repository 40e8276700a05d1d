"""Write and read routes in the formats of other tools: GIS layers, hand-held GPS routes, autopilot missions.

| ending | what is written | coordinates |
|---|---|---|
| ``.geojson`` | one line per leg with rover, order, kind and length (RFC 7946) | WGS 84 longitude, latitude |
| ``.kml``, ``.kmz`` | the same, in folders with styles and labels; the area | WGS 84 longitude, latitude |
| ``.gpkg`` | the same, as `Route.write` does | the survey's CRS |
| ``.gpx`` | one route per rover | WGS 84 |
| ``.csv`` | one row per waypoint | the survey's CRS and WGS 84 |
| ``.wkt`` | one ``LINESTRING`` per leg and line of text | the survey's CRS |
| ``.plan`` | QGroundControl's plan file, version 1 (docs.qgroundcontrol.com, "Plan File Format") | WGS 84 |
| ``.waypoints`` | plain-text mission ``QGC WPL 110`` (mavlink.io, "File Formats") | WGS 84 |
"""

import logging
from pathlib import Path
from typing import Any

import numpy as np
from pyproj import CRS

from survey.core import InputError, existing_file, projected_crs, refusing_damage
from survey.core.transformation import WGS84, chosen_crs, is_geographic
from survey.data.route import Leg, Route
from survey.interchange.missions import Surroundings, fence_of
from survey.interchange.route_readers import IN_METRES, READERS, ReadLegs
from survey.interchange.route_writers import WRITERS
from survey.io.vector import read_features

_WITH_CRS = (".geojson", ".gpkg", ".json")
_logger = logging.getLogger(__name__)


def write_plan(
    route: Route, path: str | Path, *, rover: int | None = None, around: Surroundings | None = None
) -> None:
    """Write a route for another tool; the file's ending chooses the format.

    Parameters
    ----------
    route : Route
        The route.
    path : str or pathlib.Path
        Ends in ``.geojson``, ``.json``, ``.gpkg``, ``.gpx``, ``.kml``, ``.kmz``, ``.csv``, ``.wkt``,
        ``.plan`` or ``.waypoints``.
    rover : int, optional
        Write this rover's part only. Missions hold one vehicle, so ``.plan`` and
        ``.waypoints`` need it when the route has several.
    around : Surroundings, optional
        Area, terrain, autopilot, speed and return, as far as the format holds them.

    Raises
    ------
    InputError
        An unknown ending, a rover that the route does not have, several rovers in one
        mission, surroundings that do not belong to the route, a mission that leaves its own fence or whose
        fence has more corners than the autopilot holds, or a folder that cannot be written to.

    Notes
    -----
    Degrees are written with nine decimals, a tenth of a millimetre. A straight leg stays
    straight in the survey's projection only: between waypoints hundreds of metres apart,
    a tool that joins them along a geodesic deviates by millimetres.

    Examples
    --------
    >>> import tempfile
    >>> from survey.data.route import Leg
    >>> route = Route((Leg("swath", [[500000.0, 6700000.0], [500100.0, 6700000.0]]),), "EPSG:32608", "line")
    >>> file = Path(tempfile.mkdtemp()) / "route.gpx"
    >>> write_plan(route, file)
    >>> read_plan(file, crs=route.crs)
    Route(imported, 1 swath, 100 m, 1 rover, WGS 84 / UTM zone 8N)
    """
    target, taken_along = Path(path), around or Surroundings()
    part = require_writable(route, target, rover=rover, around=taken_along)
    WRITERS[target.suffix.lower()](part, target, taken_along)


def require_writable(route: Route, path: Path, *, rover: int | None, around: Surroundings) -> Route:
    """Return the part of a route that `write_plan` writes; refuse what it would refuse, before anything is written."""
    ending = path.suffix.lower()
    if ending not in WRITERS:
        raise InputError(
            f"{path.name} ends in {path.suffix!r}; one of {', '.join(sorted(WRITERS))} was expected."
        )
    part = part_of_rover(route, rover)
    around.check(part)
    if ending == ".plan":  # the file with a fence
        fence_of(part, path, around)
    return part


def read_plan(path: str | Path, crs: Any = None) -> Route:
    """Read a plan that `write_plan` or another tool wrote.

    Parameters
    ----------
    path : str or pathlib.Path
        One of the formats of `write_plan`.
    crs : str or pyproj.CRS, optional
        The projected CRS of the route; plans in degrees are transformed to it. Without it, plans in metres stay
        in their own, and those in degrees are projected to their UTM zone, or to polar stereographic beyond
        84° N and 80° S; the log states it.

    Returns
    -------
    Route
        Legs with their kind and rover where the file states them, else one swath per line.
        Places of missions are those of all commands that lead to one, in driving order: waypoints, splines, loiters,
        take-offs, landings, and those stored with survey patterns. The log names what is left out.

    Raises
    ------
    InputError
        Missing, damaged or of an unknown format, or without a line of two waypoints; a ``.csv`` or ``.wkt``,
        whose coordinates are metres, without a CRS; a mission with jumps, with patterns that are stored without their
        places, or with the place 0, 0, which stands for the place of the vehicle.

    Examples
    --------
    >>> import tempfile
    >>> file = Path(tempfile.mkdtemp()) / "line.wkt"
    >>> _ = file.write_text("LINESTRING (500000 6700000, 500100 6700000)")
    >>> round(read_plan(file, crs="EPSG:32608").length_m)
    100
    """
    file = existing_file(path, "the plan")
    if file.suffix.lower() not in READERS:
        raise InputError(
            f"{file.name} ends in {file.suffix!r}; one of {', '.join(sorted(READERS))} was expected."
        )
    target = _own_crs(file) if crs is None else projected_crs(crs, "the wanted CRS")
    legs, left_out = _content(file, target)
    for note in left_out:
        _logger.warning("the plan %s: %s.", file, note)
    return Route(tuple(legs), target, "imported")


def _own_crs(file: Path) -> CRS:
    """Return the CRS of a plan in metres; for one in degrees its UTM zone, which is logged."""
    if file.suffix.lower() in IN_METRES:
        raise InputError(f"{file} states no projected CRS; name that of the route, e.g. --crs EPSG:32608.")
    stated = read_features(file, what="the plan").crs if file.suffix.lower() in _WITH_CRS else None
    if stated is not None and not is_geographic(stated):
        return projected_crs(stated, f"the plan {file}")
    places = np.vstack([leg.xy for leg in _content(file, WGS84).legs])
    zone = chosen_crs(places[:, 0], places[:, 1])
    _logger.warning("the plan %s is read in degrees and projected to %s.", file, zone.name)
    return zone


def _content(file: Path, crs: CRS) -> ReadLegs:
    """Return the legs of a plan in a CRS, at least one, and what was left out."""
    with refusing_damage(f"the plan {file}", "plan of the format of its suffix"):
        content = READERS[file.suffix.lower()](file, crs)
    if not content.legs:
        beside = f" ({'; '.join(content.left_out)})" if content.left_out else ""
        raise InputError(f"the plan {file} holds no line of two waypoints{beside}; plan at least one leg.")
    return content


def part_of_rover(route: Route, rover: int | None) -> Route:
    """Return the legs of one rover.

    Returns: as that of rover 0.
    """
    if rover is None:
        return route
    legs = tuple(Leg(leg.kind, leg.xy, 0, leg.axis) for leg in route.legs if leg.rover == rover)
    if not legs:
        raise InputError(f"the route has no rover {rover}; it has {route.n_rovers}, counted from 0.")
    return Route(legs, route.crs, route.pattern, route.spacing_m, route.prediction)
