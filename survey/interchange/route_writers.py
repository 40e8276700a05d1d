"""Writers of routes, one for each file ending.

`WRITERS` maps an ending to its function of route, path and surroundings. KML and KMZ have folders for each rover and the
area, styles, and labels of swaths.
"""

import csv
import io
import json
import zipfile
from collections.abc import Callable, Iterable
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import shapely
from shapely import LineString, Polygon

from survey.core import FloatArray, printable, write_bytes, write_text
from survey.core.transformation import WGS84, transformed
from survey.data.route import Leg, Route
from survey.interchange.missions import Surroundings, write_qgc_plan, write_wpl
from survey.io.vector import require_transformation, write_features

_NAMESPACE = "http://www.opengis.net/kml/2.2"
_FIELDS = {"order": "int", "kind": "string", "rover": "int", "length_m": "double"}
# Colours of the figures as alpha, blue, green, red.
_ROVERS = ("ff005ed5", "ffb27200", "ff739e00", "ff9944aa", "ff0089b5", "ff882233")
_AREA, _NO_GO = "ff352a1d", "ff2b26b3"
_FIRST_DAY = (1980, 1, 1, 0, 0, 0)


def write_kml(route: Route, path: Path, around: Surroundings) -> None:
    """Write a KML document."""
    content = _document(route, path, around)
    write_bytes(path, content)


def write_kmz(route: Route, path: Path, around: Surroundings) -> None:
    """Write the same document compressed; equal routes give equal bytes."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(zipfile.ZipInfo("doc.kml", _FIRST_DAY), _document(route, path, around))
    write_bytes(path, buffer.getvalue())


def _document(route: Route, path: Path, around: Surroundings) -> bytes:
    require_transformation(route.crs, path)
    root = ET.Element("kml", xmlns=_NAMESPACE)
    document = ET.SubElement(root, "Document", id="root_doc")
    _set_text(document, "name", printable(path.stem))
    _styles(document, route.n_rovers)
    schema = ET.SubElement(document, "Schema", name="route", id="route")
    for name, kind in _FIELDS.items():
        ET.SubElement(schema, "SimpleField", name=name, type=kind)
    for rover in range(route.n_rovers):
        _rover_folder(document, route, rover, around)
    for rover in range(route.n_rovers):
        _labels_folder(document, route, rover)
    if around.area is not None:
        _polygons(document, "Survey area", "area", shapely.get_parts(around.area.polygon), route)
        if around.area.no_go:
            _polygons(document, "No-go", "no-go", around.area.no_go, route)
    ET.indent(root)
    return bytes(ET.tostring(root, encoding="utf-8", xml_declaration=True)) + b"\n"


def _styles(document: ET.Element, n_rovers: int) -> None:
    for rover in range(n_rovers):
        colour = _ROVERS[rover % len(_ROVERS)]
        _line_style(document, f"swath-{rover}", colour, 3.0)
        _line_style(document, f"transit-{rover}", "99" + colour[2:], 1.5)
        label = ET.SubElement(document, "Style", id=f"label-{rover}")
        icon = ET.SubElement(label, "IconStyle")
        _set_text(icon, "scale", "0")
        letters = ET.SubElement(label, "LabelStyle")
        _set_text(letters, "color", colour)
        _set_text(letters, "scale", "0.9")
    for name, colour, fill in (("area", _AREA, "00ffffff"), ("no-go", _NO_GO, "66" + _NO_GO[2:])):
        style = _line_style(document, name, colour, 2.0)
        _set_text(ET.SubElement(style, "PolyStyle"), "color", fill)


def _line_style(document: ET.Element, name: str, colour: str, width: float) -> ET.Element:
    style = ET.SubElement(document, "Style", id=name)
    line = ET.SubElement(style, "LineStyle")
    _set_text(line, "color", colour)
    _set_text(line, "width", f"{width:g}")
    return style


def _rover_folder(document: ET.Element, route: Route, rover: int, around: Surroundings) -> None:
    """Add the legs of a rover in driving order."""
    folder = _folder(document, f"Rover {rover + 1}")
    lengths = np.round(route.ground_leg_lengths_m, 3)
    for order, leg in enumerate(route.legs):
        if leg.rover != rover:
            continue
        mark = _placemark(folder, f"{order + 1} {leg.kind}, rover {rover + 1}", f"{leg.kind}-{rover}")
        data = ET.SubElement(ET.SubElement(mark, "ExtendedData"), "SchemaData", schemaUrl="#route")
        facts = {"order": order, "kind": leg.kind, "rover": rover, "length_m": lengths[order]}
        for name, value in facts.items():
            _set_text(ET.SubElement(data, "SimpleData", name=name), None, str(value))
        line = ET.SubElement(mark, "LineString")
        _set_text(line, "tessellate", "1")
        _set_text(line, "coordinates", _kml_coordinates(route, leg.xy, around.heights(leg.xy)))


def _labels_folder(document: ET.Element, route: Route, rover: int) -> None:
    """Add the numbers of the swaths, and where the rover starts and ends."""
    folder = _folder(document, f"Rover {rover + 1}, labels")
    swaths = [leg for leg in route.swaths if leg.rover == rover]
    for number, leg in enumerate(swaths, start=1):
        _point(folder, str(number), f"label-{rover}", route, _middle(leg))
    path = route.path(rover)
    for name, place in (("Start", path[0]), ("End", path[-1])):
        _point(folder, f"{name}, rover {rover + 1}", None, route, place)


def _middle(leg: Leg) -> FloatArray:
    line = shapely.LineString(leg.xy)
    place: FloatArray = shapely.get_coordinates(line.interpolate(0.5, normalized=True))[0]
    return place


def _polygons(document: ET.Element, name: str, style: str, polygons: Iterable[Polygon], route: Route) -> None:
    folder = _folder(document, name)
    for number, polygon in enumerate(polygons, start=1):
        mark = _placemark(folder, f"{name} {number}", style)
        shape = ET.SubElement(mark, "Polygon")
        _set_text(shape, "tessellate", "1")
        for tag, ring in [
            ("outerBoundaryIs", polygon.exterior),
            *(("innerBoundaryIs", r) for r in polygon.interiors),
        ]:
            edge = ET.SubElement(ET.SubElement(shape, tag), "LinearRing")
            _set_text(edge, "coordinates", _kml_coordinates(route, shapely.get_coordinates(ring), None))


def _point(folder: ET.Element, name: str, style: str | None, route: Route, place: FloatArray) -> None:
    mark = _placemark(folder, name, style)
    _set_text(ET.SubElement(mark, "Point"), "coordinates", _kml_coordinates(route, place[None, :], None))


def _folder(document: ET.Element, name: str) -> ET.Element:
    folder = ET.SubElement(document, "Folder")
    _set_text(folder, "name", name)
    return folder


def _placemark(folder: ET.Element, name: str, style: str | None) -> ET.Element:
    mark = ET.SubElement(folder, "Placemark")
    _set_text(mark, "name", name)
    if style is not None:
        _set_text(mark, "styleUrl", f"#{style}")
    return mark


def _kml_coordinates(route: Route, xy: FloatArray, heights: FloatArray | None) -> str:
    """Return longitude, latitude and, where it is known, height of places."""
    degrees = transformed(xy, route.crs, WGS84, "the route")
    if heights is None:
        return " ".join(f"{longitude:.9f},{latitude:.9f}" for longitude, latitude in degrees)
    return " ".join(f"{x:.9f},{y:.9f},{z:.2f}" for (x, y), z in zip(degrees, heights, strict=True))


def _set_text(parent: ET.Element, tag: str | None, text: str) -> None:
    """Set the text of an element, or of a new one within it."""
    (parent if tag is None else ET.SubElement(parent, tag)).text = text


_CSV_COLUMNS = (
    "rover", "leg", "kind", "waypoint", "easting_m", "northing_m", "longitude_deg", "latitude_deg",
)  # fmt: skip


def _lonlat(route: Route, xy: FloatArray, path: Path) -> FloatArray:
    """Return longitude and latitude (N, 2) [deg]; refuses a CRS that no transformation ties to the Earth."""
    require_transformation(route.crs, path)
    return transformed(xy, route.crs, WGS84, "the route")


def _write_gpkg(route: Route, path: Path, _: Surroundings) -> None:
    route.write(path)


def _write_geojson(route: Route, path: Path, around: Surroundings) -> None:
    """Write one line per leg in degrees, as RFC 7946 defines GeoJSON: longitude first, without a CRS."""
    features = []
    for order, (leg, length_m) in enumerate(zip(route.legs, route.ground_leg_lengths_m, strict=True)):
        facts = {
            "name": f"{order + 1} {leg.kind}, rover {leg.rover + 1}",
            "order": order,
            "kind": leg.kind,
            "rover": leg.rover,
            "length_m": round(float(length_m), 3),
        }
        places = np.round(_places(route, leg.xy, path, around), 9).tolist()
        geometry = {"type": "LineString", "coordinates": places}
        features.append({"type": "Feature", "properties": facts, "geometry": geometry})
    collection = {"type": "FeatureCollection", "features": features}
    write_text(path, json.dumps(collection, ensure_ascii=False, indent=1) + "\n")


def _places(route: Route, xy: FloatArray, path: Path, around: Surroundings) -> FloatArray:
    """Return longitude, latitude and, where the terrain is known, height (N, 2 or 3)."""
    heights = around.heights(xy)
    degrees = _lonlat(route, xy, path)
    return degrees if heights is None else np.column_stack([degrees, np.round(heights, 2)])


def _write_gpx(route: Route, path: Path, around: Surroundings) -> None:
    rovers = range(route.n_rovers)
    lines = [LineString(np.round(_places(route, route.path(k), path, around), 9)) for k in rovers]
    names = np.array([f"{route.pattern}, rover {rover + 1}" for rover in rovers], dtype=object)
    columns = {"name": names, "number": np.array(rovers, dtype=np.int32) + 1}
    write_features(path, lines, columns, WGS84, layer="routes")


def _write_csv(route: Route, path: Path, _: Surroundings) -> None:
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(_CSV_COLUMNS)
    for index, leg in enumerate(route.legs):
        for k, (here, degrees) in enumerate(zip(leg.xy, _lonlat(route, leg.xy, path), strict=True)):
            metres = [f"{value:.4f}" for value in here]
            rows.writerow([leg.rover, index, leg.kind, k, *metres, *(f"{value:.9f}" for value in degrees)])
    write_text(path, text.getvalue())


def _write_wkt(route: Route, path: Path, _: Surroundings) -> None:
    write_text(
        path, "".join(shapely.to_wkt(LineString(leg.xy), rounding_precision=-1) + "\n" for leg in route.legs)
    )


WRITERS: dict[str, Callable[[Route, Path, Surroundings], None]] = {
    ".csv": _write_csv,
    ".geojson": _write_geojson,
    ".gpkg": _write_gpkg,
    ".gpx": _write_gpx,
    ".json": _write_geojson,
    ".kml": write_kml,
    ".kmz": write_kmz,
    ".plan": write_qgc_plan,
    ".waypoints": write_wpl,
    ".wkt": _write_wkt,
}
