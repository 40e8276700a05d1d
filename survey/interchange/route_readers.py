"""Readers of routes, one for each file ending."""

import csv
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from pyproj import CRS

from survey.core import FloatArray, InputError, parse_json
from survey.core.transformation import WGS84, transformed
from survey.data.route import Leg
from survey.interchange.missions import NAV_WAYPOINT
from survey.io.vector import layer_names, read_features


def _read_lines(path: Path, crs: CRS) -> list[Leg]:
    return _joined(_legs_of(path, crs, None))


def _read_kml(path: Path, crs: CRS) -> list[Leg]:
    """Read the lines of all folders."""
    names = layer_names(path, what="the plan")
    legs = [leg for name in names for leg in _legs_of(path, crs, name, lines_only=len(names) > 1)]
    return _joined(legs)


def _legs_of(path: Path, crs: CRS, layer: str | None, *, lines_only: bool = False) -> list[Leg]:
    features = read_features(path, layer=layer, what="the plan")
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
                if lines_only:
                    continue
                raise InputError(f"the plan {path} holds a {line.geom_type}; lines were expected.")
            xy = transformed(shapely.get_coordinates(line), features.crs, crs, f"the plan {path}")
            legs.append(Leg(str(kind), xy, rover))  # type: ignore[arg-type]  # Leg refuses other kinds
    return legs


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
    plan = parse_json(path.read_bytes(), f"the plan {path}")
    return _mission(list(_simple_items(plan["mission"]["items"])), crs, path)


def _simple_items(items: list[dict[str, Any]]) -> Iterator[tuple[float, float]]:
    """Yield latitude and longitude of the waypoints, those inside survey patterns included."""
    for item in items:
        if "TransectStyleComplexItem" in item:
            yield from _simple_items(item["TransectStyleComplexItem"]["Items"])
        elif item.get("command") == NAV_WAYPOINT:
            place = item["coordinate"] if "coordinate" in item else item["params"][4:6]
            yield float(place[0]), float(place[1])


def _read_wpl(path: Path, crs: CRS) -> list[Leg]:
    first, *rows = path.read_text(encoding="utf-8").splitlines()
    if first.split() != ["QGC", "WPL", "110"]:
        raise InputError(f"the plan {path} begins with {first[:40]!r}; QGC WPL 110 was expected.")
    fields = [row.split() for row in rows if row.strip()]
    places = [(float(f[8]), float(f[9])) for f in fields if int(f[3]) == NAV_WAYPOINT]
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


IN_METRES = (".csv", ".wkt")
"""Endings of plans in metres that name no CRS."""
READERS: dict[str, Callable[[Path, CRS], list[Leg]]] = {
    ".csv": _read_csv,
    ".geojson": _read_lines,
    ".gpkg": _read_lines,
    ".gpx": _read_gpx,
    ".json": _read_lines,
    ".kml": _read_kml,
    ".plan": _read_qgc_plan,
    ".waypoints": _read_wpl,
    ".wkt": _read_wkt,
}
