"""Writers of routes, one for each file ending."""

import csv
import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely import LineString

from survey.core.arrays import FloatArray
from survey.core.crs.transformation import transformed
from survey.core.errors import InputError
from survey.core.files.writing import replacing
from survey.data.route import Route
from survey.io.degrees import WGS84, require_transformation
from survey.io.vector import write_features

_CSV_COLUMNS = (
    "rover", "leg", "kind", "waypoint", "easting_m", "northing_m", "longitude_deg", "latitude_deg",
)  # fmt: skip


_NAV_WAYPOINT, _GROUND_ROVER, _PX4 = 16, 10, 12
_FRAME_GLOBAL, _FRAME_RELATIVE_ALTITUDE = 0, 3


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


WRITERS: dict[str, Callable[[Route, Path], None]] = {
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
