"""Files of routes with one element more than a route holds: it is used, refused, or named."""

import json
import logging
import re
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapely

from firnline.actions.exporting import read_route
from survey.core.errors import InputError
from survey.core.transformation import WGS84
from survey.data.route import Leg, Route
from survey.interchange.route_formats import read_plan
from survey.interchange.route_readers import READERS
from survey.io.vector import write_features

CRS = "EPSG:32608"
PLACES = [(-135.10, 60.431), (-135.09, 60.431), (-135.09, 60.433), (-135.10, 60.433)]
LINE = shapely.LineString(PLACES)
POINT, RING = shapely.Point(PLACES[0]), shapely.Polygon(PLACES)


def vector(*more) -> Callable[[Path], None]:
    return lambda file: write_features(file, [LINE, *more], {}, WGS84, layer="lines")


def geojson(*more) -> Callable[[Path], None]:
    shapes = [None if shape is None else shapely.geometry.mapping(shape) for shape in (LINE, *more)]
    features = [{"type": "Feature", "properties": {}, "geometry": shape} for shape in shapes]
    content = json.dumps({"type": "FeatureCollection", "features": features})
    return lambda file: file.write_text(content)


def kml_line(places) -> str:
    return f"<LineString><coordinates>{' '.join(f'{x},{y}' for x, y in places)}</coordinates></LineString>"


def kml(*bodies: str, end: str = "") -> Callable[[Path], None]:
    marks = "".join(f"<Placemark>{body}</Placemark>" for body in (kml_line(PLACES), *bodies))
    text = (
        '<?xml version="1.0"?><kml xmlns="http://www.opengis.net/kml/2.2" '
        f'xmlns:gx="http://www.google.com/kml/ext/2.2"><Document><name>d</name>{marks}{end}</Document></kml>'
    )

    def write(file: Path) -> None:
        if file.suffix == ".kmz":
            with zipfile.ZipFile(file, "w") as archive:
                archive.writestr("doc.kml", text)
        else:
            file.write_text(text)

    return write


KML_POINT = "<Point><coordinates>-135,60</coordinates></Point>"


def gpx(more: str, inside: str = "") -> Callable[[Path], None]:
    points = [f'<rtept lat="{y}" lon="{x}">{inside}</rtept>' for x, y in PLACES]
    text = f'<gpx version="1.1" creator="t" xmlns="http://www.topografix.com/GPX/1/1"><rte>{"".join(points)}</rte>{more}</gpx>'
    return lambda file: file.write_text(text)


def table(*rows: str, header: str = "rover,leg,kind,waypoint,easting_m,northing_m") -> Callable[[Path], None]:
    return lambda file: file.write_text("\n".join([header, *rows]) + "\n")


def wkt(*more: str) -> Callable[[Path], None]:
    return lambda file: file.write_text("\n".join(["LINESTRING (0 0, 9 0, 9 9, 0 9)", *more]))


def item(command: int, place=(60.43, -135.09), frame: int = 3, first: float = 0) -> dict:
    return {
        "type": "SimpleItem",
        "command": command,
        "frame": frame,
        "params": [first, 0, 0, None, *place, 5],
    }


def plan(*more: dict, **keys) -> Callable[[Path], None]:
    items = [item(16, (y, x)) for x, y in PLACES] + list(more)
    return lambda file: file.write_text(json.dumps({"fileType": "Plan", "mission": {"items": items}, **keys}))


def waypoints(*more: str) -> Callable[[Path], None]:
    rows = ["0\t1\t0\t16\t0\t0\t0\t0\t60.43\t-135.1\t700\t1"]
    rows += [f"{k}\t0\t3\t16\t0\t0\t0\t0\t{y}\t{x}\t5\t1" for k, (x, y) in enumerate(PLACES, 1)]
    return lambda file: file.write_text("\n".join(["QGC WPL 110", *rows, *more]) + "\n")


LEG = ("0,0,swath,0,0,0", "0,0,swath,1,9,0", "0,0,swath,2,9,9", "0,0,swath,3,0,9")
FENCE = {
    "geoFence": {"polygons": [{"inclusion": True, "polygon": [[y, x] for x, y in PLACES]}], "circles": []}
}

# What the file holds, and how many places the route has then (used) or words of a refusal.
REFUSED, NAMED = "refused", "named"
CASES: dict[str, list[tuple[Callable[[Path], None], str, str | int]]] = {
    ".geojson": [
        (geojson(), "used", 4),
        (geojson(POINT), NAMED, "1 Point"),
        (geojson(RING, POINT, POINT), NAMED, "1 Polygon, 2 Points"),
        (geojson(None), NAMED, "1 feature without a geometry"),
        (geojson(shapely.LineString()), NAMED, "1 feature without a geometry"),
        (geojson(shapely.MultiLineString([LINE, LINE])), "used", 12),
        (geojson(shapely.GeometryCollection([shapely.GeometryCollection([LINE]), POINT])), NAMED, "1 Point"),
    ],
    ".json": [(geojson(POINT), NAMED, "1 Point")],
    ".gpkg": [(vector(POINT), NAMED, "1 Point"), (vector(RING), NAMED, "1 Polygon")],
    ".kml": [
        (kml(KML_POINT), NAMED, "1 Point"),
        (kml(end=f"<Folder><name>f</name><Placemark>{KML_POINT}</Placemark></Folder>"), NAMED, "1 Point"),
        (kml(f"<MultiGeometry>{kml_line(PLACES)}{KML_POINT}</MultiGeometry>"), NAMED, "1 Point"),
        (kml(kml_line(PLACES) * 2), REFUSED, "LineString|3 lines, of which 2"),
        (kml(end=f"</Document><Document><name>e</name><Placemark>{kml_line(PLACES)}</Placemark>"), REFUSED, "2 lines"),
        (kml("<name>only a name</name>"), NAMED, "1 feature without a geometry"),
        (kml("<gx:Track><gx:coord>-135 60 0</gx:coord><gx:coord>-135 61 0</gx:coord></gx:Track>"), "used", 6),
    ],
    ".kmz": [(kml(KML_POINT), NAMED, "1 Point")],
    ".gpx": [
        (gpx('<wpt lat="60" lon="-135"/>'), NAMED, "1 waypoint"),
        (gpx('<trk><trkseg><trkpt lat="60" lon="-135"/></trkseg></trk>'), NAMED, "1 track"),
        (gpx("<rte></rte>"), NAMED, "1 route without places"),
        (gpx('<rte><rtept lat="60"/></rte>'), REFUSED, "5 places of routes .* of which 4"),
        (gpx("", '<extensions><rpt lat="60" lon="-135"/></extensions>'), REFUSED, "4 between them"),
    ],
    ".csv": [
        (table(*LEG), "used", 4),
        (table(*(f"{row},x" for row in LEG), header="rover,leg,kind,waypoint,easting_m,northing_m,speed"), NAMED, "speed"),
        (table(*LEG, "0,0,swath,4,0"), REFUSED, "line 6: it has more or fewer cells"),
        (table(*LEG, "0,0,swath,4,0,0,7"), REFUSED, "line 6: it has more or fewer cells"),
        (table(*LEG[::-1]), REFUSED, "not in their order"),
        (table(*LEG[:2], "0,1,transit,0,9,0", "0,1,transit,1,9,9", *LEG[2:]), REFUSED, "not in their order"),
    ],
    ".wkt": [
        (wkt("POINT (3 3)"), NAMED, "1 Point"),
        (wkt("MULTILINESTRING ((0 9, 0 20), (5 20, 5 30))"), "used", 7),
        (wkt("POLYGON ((0 0, 1 0, 1 1, 0 0))"), NAMED, "1 Polygon"),
        (wkt("LINESTRING EMPTY"), NAMED, "1 feature without a geometry"),
    ],
    ".plan": [
        (plan(), "used", 4),
        (plan(item(82)), NAMED, "item 5 .NAV_SPLINE_WAYPOINT, command 82"),
        (plan(item(201)), NAMED, "item 5 .DO_SET_ROI, command 201"),
        (plan(item(20, (0, 0), 2)), NAMED, "item 5 .NAV_RETURN_TO_LAUNCH"),
        (plan(item(177, (0, 0), 2, 1)), REFUSED, "item 5 .DO_JUMP, command 177"),
        (plan(item(16, (0, 0))), REFUSED, "item 5 .* lies at 0, 0"),
        (plan(item(16, (None, None))), REFUSED, "item 5 .* lies at 0, 0"),
        (plan(item(16, frame=1)), REFUSED, "item 5 .* altitude frame 1"),
        (plan(item(16, (604310000, -1350900000))), REFUSED, "degrees within 90 and 180"),
        (plan(item(36)), REFUSED, "item 5 .command 36. .* has a place"),
        (plan({"type": "ComplexItem", "complexItemType": "StructureScan"}), REFUSED, "item 5 .*StructureScan"),
        (plan({"type": "ComplexItem", "complexItemType": "fwLandingPattern"}), REFUSED, "fwLandingPattern"),
        (plan({"type": "ComplexItem", "complexItemType": "survey", "TransectStyleComplexItem": {}}), REFUSED, "survey"),
        (plan({"type": "ComplexItem", "TransectStyleComplexItem": {"Items": [item(16), item(16, (60.44, -135.0))]}}), "used", 6),
        (plan(**FENCE), NAMED, "its fence of 1 parts"),
        (plan(rallyPoints={"points": [[60, -135, 5]]}), NAMED, "1 rally points"),
    ],
    ".waypoints": [
        (waypoints(), NAMED, "item 0 .the home position"),
        (waypoints("5\t0\t10\t19\t10\t0\t0\t0\t60.44\t-135.1\t5\t1"), NAMED, "item 5 .NAV_LOITER_TIME, command 19"),
        (waypoints("5\t0\t3\t206\t10\t0\t0\t0\t0\t0\t5\t1"), NAMED, "item 5 .DO_SET_CAM_TRIGG_DIST"),
        (waypoints("5\t0\t3\t177\t1\t2\t0\t0\t0\t0\t0\t1"), REFUSED, "item 5 .DO_JUMP"),
        (waypoints("4\t0\t3\t16\t0\t0\t0\t0\t60.44\t-135.1\t5\t1"), REFUSED, "not in the order"),
        (waypoints("5\t0\t3\t16\t0\t0\t0\t0\t60.44\t-135.1\t5\t1\t7"), REFUSED, "damaged"),
        (waypoints("5\t0\t3\t16.5\t0\t0\t0\t0\t60.44\t-135.1\t5\t1"), REFUSED, "not whole"),
    ],
}  # fmt: skip


def test_every_reader_of_routes_has_its_cases():
    assert CASES.keys() == READERS.keys()


@pytest.mark.parametrize(
    ("ending", "case"), [(ending, k) for ending, cases in CASES.items() for k in range(len(cases))]
)
def test_what_a_route_does_not_hold_is_used_refused_or_named(tmp_path, caplog, ending, case):
    write, outcome, expected = CASES[ending][case]
    file = tmp_path / f"plan{ending}"
    write(file)
    if outcome == REFUSED:
        with pytest.raises(InputError, match=expected):
            read_plan(file, CRS)
        return
    with caplog.at_level(logging.WARNING):
        route = read_plan(file, CRS)
    if outcome == NAMED:
        assert re.search(expected, caplog.text), caplog.text
    else:
        assert len(route.path()) == expected


@pytest.mark.parametrize(
    "shape", [POINT, RING, None, shapely.MultiLineString([LINE, shapely.LineString([(0, 0), (1, 1)])])]
)
def test_a_route_of_firnline_with_another_shape_among_its_legs_is_refused(tmp_path, shape):
    file = tmp_path / "route.geojson"
    Route((Leg("swath", np.array([[500_000.0, 6_700_000.0], [500_100.0, 6_700_000.0]])),), CRS, "line").write(
        file
    )
    content = json.loads(file.read_text())
    more = json.loads(json.dumps(content["features"][0]))
    more["geometry"] = None if shape is None else shapely.geometry.mapping(shape)
    content["features"].append(more)
    file.write_text(json.dumps(content))
    with pytest.raises(InputError, match="as feature 2; a line for each leg was expected"):
        read_route(file, None)
