"""Readers of routes, one for each file ending.

Each returns the legs, and what the file holds beside the lines or places that it made them of: a file of another program is
used, refused, or its rest is named.
"""

import csv
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree as ET

import numpy as np
import shapely
from pyproj import CRS

from survey.core import FloatArray, InputError
from survey.core.transformation import WGS84, transformed
from survey.data.route import Leg
from survey.interchange.mission_files import driven_places, read_mission_file
from survey.io.file_kinds import kml_document, small_text
from survey.io.vector import layer_names, read_features


class ReadLegs(NamedTuple):
    """Legs of a file, and notes on what it holds beside them."""

    legs: list[Leg]
    left_out: tuple[str, ...] = ()


def _read_lines(path: Path, crs: CRS) -> ReadLegs:
    legs, others = _legs_of(path, crs, None)
    return ReadLegs(_joined(legs), _beside(others))


def _read_kml(path: Path, crs: CRS) -> ReadLegs:
    """Read the lines of all folders; refuse a document with lines that GDAL does not find."""
    legs: list[Leg] = []
    others: Counter[str] = Counter()
    for name in layer_names(path, what="the plan"):
        found, beside = _legs_of(path, crs, name)
        legs += found
        others += beside
    stated = _elements(kml_document(path, "the plan"), ("LineString", "Track"))
    n_stated = stated["LineString"] + stated["Track"]
    if n_stated > len(legs):
        raise InputError(
            f"the plan {path} holds {n_stated} lines, of which {len(legs)} can be read; give each line a placemark of its own in "
            "one document, and save it again."
        )
    return ReadLegs(_joined(legs), _beside(others))


def _legs_of(path: Path, crs: CRS, layer: str | None) -> tuple[list[Leg], Counter[str]]:
    """Return the lines of a layer as legs, and the numbers of other geometries."""
    features = read_features(path, layer=layer, what="the plan")
    columns = features.attributes
    order = (
        np.argsort(columns["order"], kind="stable") if "order" in columns else range(len(features.geometry))
    )
    legs: list[Leg] = []
    others: Counter[str] = Counter()
    for i in order:
        lines, beside = _line_parts(features.geometry[i])
        others += beside
        for line in lines:
            kind = columns["kind"][i] if "kind" in columns else "swath"
            rover = int(columns["rover"][i]) if "rover" in columns else 0
            xy = transformed(shapely.get_coordinates(line), features.crs, crs, f"the plan {path}")
            legs.append(Leg(str(kind), xy, rover))  # type: ignore[arg-type]  # Leg refuses other kinds
    return legs, others


def _line_parts(shape: Any) -> tuple[list[Any], Counter[str]]:
    """Return the lines in a geometry, however deep they are nested, and the numbers of other kinds."""
    if shape is None or shape.is_empty:
        return [], Counter({"feature without a geometry": 1})
    parts = [shape]
    while any(hasattr(part, "geoms") for part in parts):
        parts = [inner for part in parts for inner in shapely.get_parts(part)]
    lines = [part for part in parts if part.geom_type == "LineString"]
    return lines, Counter(part.geom_type for part in parts if part.geom_type != "LineString")


def _beside(others: Counter[str]) -> tuple[str, ...]:
    """Return a note on what is no line."""
    named = ", ".join(f"{n} {kind}{'s' * (n > 1)}" for kind, n in others.items() if n)
    return (f"left out, because a route is made of lines: {named}",) if named else ()


def _elements(content: bytes, names: Sequence[str]) -> Counter[str]:
    """Return how often elements of XML occur, whatever their namespace."""
    found = (element.tag.rsplit("}", 1)[-1] for element in ET.fromstring(content).iter())
    return Counter(name for name in found if name in names)


def _read_gpx(path: Path, crs: CRS) -> ReadLegs:
    """Read the routes; refuse points that GDAL does not find, and name tracks and waypoints."""
    stated = _elements(small_text(path, "the plan"), ("rte", "rtept", "rpt", "trk", "wpt"))
    if not stated["rte"]:
        raise InputError(
            f"the plan {path} holds {stated['trk']} tracks, {stated['wpt']} waypoints and no route (<rte>); make a route of "
            "what is to be driven and save it again."
        )
    shapes = read_features(path, layer="routes", what="the plan").geometry
    n_points = int(shapely.get_num_coordinates(shapes).sum())
    if n_points < stated["rtept"] or stated["rpt"]:
        raise InputError(
            f"the plan {path} holds {stated['rtept']} places of routes and {stated['rpt']} between them (<rpt>), of which "
            f"{n_points} can be read; save the route with all its places as <rtept> with lat and lon."
        )
    lines = [shape for shape in shapes if not shape.is_empty]
    others = {
        "route without places": len(shapes) - len(lines),
        "track": stated["trk"],
        "waypoint": stated["wpt"],
    }
    legs = [
        Leg("swath", transformed(shapely.get_coordinates(line), WGS84, crs, f"the plan {path}"), rover)
        for rover, line in enumerate(lines)
    ]
    return ReadLegs(legs, _beside(Counter(others)))


_CSV_USED = ("leg", "kind", "rover", "easting_m", "northing_m")
_CSV_REPEATED = ("waypoint", "longitude_deg", "latitude_deg")


def _read_csv(path: Path, _: CRS) -> ReadLegs:
    """Read one place a row, in the order of the rows of each leg; columns that are not known are named."""
    legs: dict[tuple[str, str, str], list[list[float]]] = {}
    rows = list(csv.DictReader(path.read_text(encoding="utf-8-sig").splitlines()))
    for number, row in enumerate(rows, start=2):
        if None in row or None in row.values():
            raise InputError(
                f"the plan {path}, line {number}: it has more or fewer cells than the header; correct it."
            )
        key = row["leg"], row["kind"], row["rover"]
        is_next = key not in legs or key == next(reversed(legs))
        places = legs.setdefault(key, [])
        if not is_next or int(row.get("waypoint", len(places))) != len(places):
            raise InputError(
                f"the plan {path}, line {number}: the waypoints of leg {row['leg']} are not in their order, 0, 1, 2 …; sort "
                "the rows by leg and waypoint."
            )
        places.append([float(row["easting_m"]), float(row["northing_m"])])
    unknown = ", ".join(name for name in rows[0] if name not in (*_CSV_USED, *_CSV_REPEATED))
    notes = (f"left out, because a route has no such columns: {unknown}",) if unknown else ()
    return ReadLegs(
        [Leg(kind, np.array(xy), int(rover)) for (_, kind, rover), xy in legs.items()],  # type: ignore[arg-type]
        notes,
    )


def _read_wkt(path: Path, _: CRS) -> ReadLegs:
    texts = [text for text in path.read_text(encoding="utf-8-sig").splitlines() if text.strip()]
    found = [_line_parts(shapely.from_wkt(text)) for text in texts]
    legs = [Leg("swath", shapely.get_coordinates(line)) for lines, _ in found for line in lines]
    return ReadLegs(_joined(legs), _beside(sum((others for _, others in found), Counter())))


def _read_mission_file(path: Path, crs: CRS) -> ReadLegs:
    lonlat, notes = driven_places(read_mission_file(path), f"the plan {path}")
    if len(lonlat) < 2:
        return ReadLegs([], notes)
    return ReadLegs([Leg("swath", transformed(lonlat, WGS84, crs, f"the plan {path}"))], notes)


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
READERS: dict[str, Callable[[Path, CRS], ReadLegs]] = {
    ".csv": _read_csv,
    ".geojson": _read_lines,
    ".gpkg": _read_lines,
    ".gpx": _read_gpx,
    ".json": _read_lines,
    ".kml": _read_kml,
    ".kmz": _read_kml,
    ".plan": _read_mission_file,
    ".waypoints": _read_mission_file,
    ".wkt": _read_wkt,
}
