"""Write and read routes in the formats of other tools: GIS layers, hand-held GPS routes, autopilot missions.

| ending | what is written | coordinates |
|---|---|---|
| ``.geojson``, ``.kml`` | one line per leg with rover, order, kind and length | WGS 84 longitude, latitude |
| ``.gpkg`` | the same, as `Route.write` does | the survey's CRS |
| ``.gpx`` | one route per rover | WGS 84 |
| ``.csv`` | one row per waypoint | the survey's CRS and WGS 84 |
| ``.wkt`` | one ``LINESTRING`` per leg and line of text | the survey's CRS |
| ``.plan`` | QGroundControl's plan file, version 1 (docs.qgroundcontrol.com, "Plan File Format") | WGS 84 |
| ``.waypoints`` | plain-text mission ``QGC WPL 110`` (mavlink.io, "File Formats") | WGS 84 |
"""

import csv
import io
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from pyproj import CRS
from shapely import LineString

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.core.files import existing_file, replacing
from survey.core.geodesy import projected_crs, transformed
from survey.data.route import Leg, Route
from survey.io.degrees import WGS84, require_transformation
from survey.io.vector import read_features, write_features

_NAV_WAYPOINT, _GROUND_ROVER, _PX4 = 16, 10, 12
_FRAME_GLOBAL, _FRAME_RELATIVE_ALTITUDE = 0, 3
_CSV_COLUMNS = (
    "rover", "leg", "kind", "waypoint", "easting_m", "northing_m", "longitude_deg", "latitude_deg",
)  # fmt: skip


def write_plan(route: Route, path: str | Path, *, rover: int | None = None) -> None:
    """Write a route for another tool; the file's ending chooses the format.

    Parameters
    ----------
    route : Route
        The route.
    path : str or pathlib.Path
        Ends in ``.geojson``, ``.json``, ``.gpkg``, ``.gpx``, ``.kml``, ``.csv``, ``.wkt``,
        ``.plan`` or ``.waypoints``.
    rover : int, optional
        Write this rover's part only. Missions hold one vehicle, so ``.plan`` and
        ``.waypoints`` need it when the route has several.

    Raises
    ------
    InputError
        An unknown ending, a rover that the route does not have, several rovers in one
        mission, or a folder that cannot be written to.

    Notes
    -----
    Degrees are written with nine decimals, a tenth of a millimetre. A straight leg stays
    straight in the survey's projection only: between waypoints hundreds of metres apart,
    a tool that joins them along a geodesic deviates by millimetres.
    """
    target = Path(path)
    writer = _WRITERS.get(target.suffix.lower())
    if writer is None:
        raise InputError(
            f"{target.name} ends in {target.suffix!r}; one of {', '.join(sorted(_WRITERS))} was expected."
        )
    writer(_part(route, rover), target)


def read_plan(path: str | Path, crs: Any) -> Route:
    """Read a plan that `write_plan` or another tool wrote.

    Parameters
    ----------
    path : str or pathlib.Path
        One of the formats of `write_plan`.
    crs : str or pyproj.CRS
        The projected CRS of the route; plans in degrees are transformed to it.

    Returns
    -------
    Route
        Legs with their kind and rover where the file states them, else one swath per line.
        Other tools' survey patterns (``.plan`` complex items) are read as the waypoints
        stored with them.

    Raises
    ------
    InputError
        Missing, damaged or of an unknown format, or without a line of two waypoints.
    """
    file = existing_file(path, "the plan")
    target = projected_crs(crs, "the wanted CRS")
    reader = _READERS.get(file.suffix.lower())
    if reader is None:
        raise InputError(
            f"{file.name} ends in {file.suffix!r}; one of {', '.join(sorted(_READERS))} was expected."
        )
    try:
        legs = reader(file, target)
    except InputError:
        raise
    except (
        ValueError,
        KeyError,
        TypeError,
        IndexError,
        UnicodeDecodeError,
        shapely.errors.GEOSException,
    ) as error:
        raise InputError(
            f"the plan {file} is damaged or not what its ending says ({error}); get it again."
        ) from error
    if not legs:
        raise InputError(f"the plan {file} holds no line of two waypoints; plan at least one leg.")
    return Route(tuple(legs), target, "imported")


def _part(route: Route, rover: int | None) -> Route:
    if rover is None:
        return route
    legs = tuple(Leg(leg.kind, leg.xy, 0, leg.axis) for leg in route.legs if leg.rover == rover)
    if not legs:
        raise InputError(f"the route has no rover {rover}; it has {route.n_rovers}, counted from 0.")
    return Route(legs, route.crs, route.pattern, route.spacing_m, route.prediction)


def _lonlat(route: Route, xy: FloatArray, path: Path) -> FloatArray:
    """Return longitude and latitude (N, 2) [deg]; refuses a CRS that no transformation ties to the Earth."""
    require_transformation(route.crs, path)
    return transformed(xy, route.crs, WGS84, "the route")


def _write_gpkg(route: Route, path: Path) -> None:
    route.write(path)


def _write_lines(route: Route, path: Path) -> None:
    """Write one line per leg in degrees, for GeoJSON and KML."""
    legs = route.legs
    columns = {
        "name": np.array(
            [f"{i + 1} {leg.kind}, rover {leg.rover}" for i, leg in enumerate(legs)], dtype=object
        ),
        "order": np.arange(len(legs), dtype=np.int32),
        "kind": np.array([leg.kind for leg in legs], dtype=object),
        "rover": np.array([leg.rover for leg in legs], dtype=np.int32),
        "length_m": np.round(route.ground_leg_lengths_m, 3),
    }
    lines = [LineString(np.round(_lonlat(route, leg.xy, path), 9)) for leg in legs]
    write_features(path, lines, columns, WGS84, layer="route")


def _write_gpx(route: Route, path: Path) -> None:
    rovers = range(route.n_rovers)
    lines = [LineString(np.round(_lonlat(route, route.path(rover), path), 9)) for rover in rovers]
    names = np.array([f"{route.pattern}, rover {rover}" for rover in rovers], dtype=object)
    columns = {"name": names, "number": np.array(rovers, dtype=np.int32)}
    write_features(path, lines, columns, WGS84, layer="routes")


def _write_csv(route: Route, path: Path) -> None:
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(_CSV_COLUMNS)
    for index, leg in enumerate(route.legs):
        for k, (here, degrees) in enumerate(zip(leg.xy, _lonlat(route, leg.xy, path), strict=True)):
            metres = [f"{value:.4f}" for value in here]
            rows.writerow([leg.rover, index, leg.kind, k, *metres, *(f"{value:.9f}" for value in degrees)])
    _write_text(path, text.getvalue())


def _write_wkt(route: Route, path: Path) -> None:
    _write_text(
        path, "".join(shapely.to_wkt(LineString(leg.xy), rounding_precision=-1) + "\n" for leg in route.legs)
    )


def _write_text(path: Path, text: str) -> None:
    with replacing(path) as draft:
        draft.write_text(text, encoding="utf-8", newline="\n")


def _waypoints(route: Route, path: Path) -> FloatArray:
    """Return latitude and longitude (N, 2) of the only rover's waypoints."""
    if route.n_rovers > 1:
        raise InputError(
            f"{path.name} holds the mission of one vehicle, but the route has {route.n_rovers}; write one file per rover (rover=0, 1, …)."
        )
    return _lonlat(route, route.path(), path)[:, ::-1]


def _write_qgc_plan(route: Route, path: Path) -> None:
    waypoints = _waypoints(route, path)
    speed_m_s = (
        route.ground_length_m / route.prediction["time_s"]
        if route.prediction.get("time_s", 0.0) > 0.0
        else 1.0
    )
    items = [
        _simple_item(i, latitude, longitude) for i, (latitude, longitude) in enumerate(waypoints, start=1)
    ]
    plan = {
        "fileType": "Plan",
        "geoFence": {"circles": [], "polygons": [], "version": 2},
        "groundStation": "QGroundControl",
        "mission": {
            "cruiseSpeed": round(speed_m_s, 3),
            "firmwareType": _PX4,
            "globalPlanAltitudeMode": 1,
            "hoverSpeed": round(speed_m_s, 3),
            "items": items,
            "plannedHomePosition": [*np.round(waypoints[0], 9).tolist(), 0],
            "vehicleType": _GROUND_ROVER,
            "version": 2,
        },
        "rallyPoints": {"points": [], "version": 2},
        "version": 1,
    }
    _write_text(path, json.dumps(plan, indent=2) + "\n")


def _simple_item(index: int, latitude: float, longitude: float) -> dict[str, Any]:
    """Return a waypoint on the ground: hold, acceptance radius, pass radius 0, yaw left to the vehicle."""
    return {
        "AMSLAltAboveTerrain": None,
        "Altitude": 0,
        "AltitudeMode": 1,
        "autoContinue": True,
        "command": _NAV_WAYPOINT,
        "doJumpId": index,
        "frame": _FRAME_RELATIVE_ALTITUDE,
        "params": [0, 0, 0, None, round(float(latitude), 9), round(float(longitude), 9), 0],
        "type": "SimpleItem",
    }


def _write_wpl(route: Route, path: Path) -> None:
    """Write home first, as ground stations expect it, then the waypoints."""
    waypoints = _waypoints(route, path)
    rows = [(0, 1, _FRAME_GLOBAL, *waypoints[0])]
    rows += [(i, 0, _FRAME_RELATIVE_ALTITUDE, *place) for i, place in enumerate(waypoints, start=1)]
    lines = [
        f"{index}\t{current}\t{frame}\t{_NAV_WAYPOINT}\t0\t0\t0\t0\t{latitude:.9f}\t{longitude:.9f}\t0\t1\n"
        for index, current, frame, latitude, longitude in rows
    ]
    _write_text(path, "QGC WPL 110\n" + "".join(lines))


def _read_lines(path: Path, crs: CRS) -> list[Leg]:
    features = read_features(path, what="the plan")
    columns = features.attributes
    order = (
        np.argsort(columns["order"], kind="stable") if "order" in columns else range(len(features.geometry))
    )
    legs: list[Leg] = []
    for i in order:
        kind = columns["kind"][i] if "kind" in columns else "swath"
        rover = int(columns["rover"][i]) if "rover" in columns else 0
        for line in shapely.get_parts(features.geometry[i]):
            if line.geom_type != "LineString":
                raise InputError(f"the plan {path} holds a {line.geom_type}; lines were expected.")
            xy = transformed(shapely.get_coordinates(line), features.crs, crs, f"the plan {path}")
            legs.append(Leg(str(kind), xy, rover))  # type: ignore[arg-type]  # Leg refuses other kinds
    return _joined(legs)


def _read_gpx(path: Path, crs: CRS) -> list[Leg]:
    features = read_features(path, layer="routes", what="the plan")
    lines = enumerate(features.geometry)
    return [
        Leg("swath", transformed(shapely.get_coordinates(g), WGS84, crs, f"the plan {path}"), i)
        for i, g in lines
    ]


def _read_csv(path: Path, _: CRS) -> list[Leg]:
    rows = list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))
    legs: dict[tuple[str, str, str], list[list[float]]] = {}
    for row in rows:
        place = [float(row["easting_m"]), float(row["northing_m"])]
        legs.setdefault((row["leg"], row["kind"], row["rover"]), []).append(place)
    return [Leg(kind, np.array(xy), int(rover)) for (_, kind, rover), xy in legs.items()]  # type: ignore[arg-type]


def _read_wkt(path: Path, _: CRS) -> list[Leg]:
    lines = [shapely.from_wkt(text) for text in path.read_text(encoding="utf-8").splitlines() if text.strip()]
    return _joined([Leg("swath", shapely.get_coordinates(line)) for line in lines])


def _read_qgc_plan(path: Path, crs: CRS) -> list[Leg]:
    plan = json.loads(path.read_text(encoding="utf-8"))
    return _mission(list(_simple_items(plan["mission"]["items"])), crs, path)


def _simple_items(items: list[dict[str, Any]]) -> Iterator[tuple[float, float]]:
    """Yield latitude and longitude of the waypoints, those inside survey patterns included."""
    for item in items:
        if "TransectStyleComplexItem" in item:
            yield from _simple_items(item["TransectStyleComplexItem"]["Items"])
        elif item.get("command") == _NAV_WAYPOINT:
            place = item["coordinate"] if "coordinate" in item else item["params"][4:6]
            yield float(place[0]), float(place[1])


def _read_wpl(path: Path, crs: CRS) -> list[Leg]:
    first, *rows = path.read_text(encoding="utf-8").splitlines()
    if first.split() != ["QGC", "WPL", "110"]:
        raise InputError(f"the plan {path} begins with {first[:40]!r}; QGC WPL 110 was expected.")
    fields = [row.split() for row in rows if row.strip()]
    places = [(float(f[8]), float(f[9])) for f in fields if int(f[3]) == _NAV_WAYPOINT]
    return _mission(places[1:], crs, path)


def _mission(latlon: list[tuple[float, float]], crs: CRS, path: Path) -> list[Leg]:
    if len(latlon) < 2:
        return []
    degrees = np.array(latlon)[:, ::-1]
    return [Leg("swath", transformed(degrees, WGS84, crs, f"the plan {path}"))]


def _joined(legs: list[Leg]) -> list[Leg]:
    """Close gaps of rounding between legs; where lines lie apart, drive straight from one to the next."""
    joined: list[Leg] = []
    last: dict[int, FloatArray] = {}
    for leg in legs:
        here = last.get(leg.rover)
        xy = leg.xy
        if here is not None:
            gap_m = float(np.hypot(*(xy[0] - here)))
            if gap_m > 0.001:
                joined.append(Leg("transit", np.array([here, xy[0]]), leg.rover))
            else:
                xy = np.vstack([here, xy[1:]])
        joined.append(Leg(leg.kind, xy, leg.rover))
        last[leg.rover] = xy[-1]
    return joined


_WRITERS: dict[str, Callable[[Route, Path], None]] = {
    ".csv": _write_csv,
    ".geojson": _write_lines,
    ".gpkg": _write_gpkg,
    ".gpx": _write_gpx,
    ".json": _write_lines,
    ".kml": _write_lines,
    ".plan": _write_qgc_plan,
    ".waypoints": _write_wpl,
    ".wkt": _write_wkt,
}

_READERS: dict[str, Callable[[Path, CRS], list[Leg]]] = {
    ".csv": _read_csv,
    ".geojson": _read_lines,
    ".gpkg": _read_lines,
    ".gpx": _read_gpx,
    ".json": _read_lines,
    ".kml": _read_lines,
    ".plan": _read_qgc_plan,
    ".waypoints": _read_wpl,
    ".wkt": _read_wkt,
}
