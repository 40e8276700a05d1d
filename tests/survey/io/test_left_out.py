"""Every vector reader gets a file with one element more than it understands, and uses, refuses or names it.

The table holds each format of `VECTOR_SUFFIXES`; a format without a case fails.
"""

import json
import re
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapely
from pyproj import CRS
from shapely import GeometryCollection, LineString, MultiPolygon, Point, Polygon

from survey import InputError, SurveyArea
from survey.io.file_kinds import VECTOR_SUFFIXES
from survey.io.vector import Layer, gdal_bindings, read_features, write_features, write_layers

UTM = CRS("EPSG:32608")
WEST, SOUTH = 500_000.0, 6_700_000.0
RING = "{0},60.4,0 {1},60.4,0 {1},60.405,0 {0},60.405,0 {0},60.4,0"
HOLE = "{0},60.401,0 {1},60.401,0 {1},60.402,0 {0},60.402,0 {0},60.401,0"
HOLES = tuple(HOLE.format(west, west + 0.001) for west in (-135.009, -135.006, -135.003))
GEOJSON = '{"type": "FeatureCollection", "features": [%s]}'
FEATURE = '{"type": "Feature", "properties": {"role": "area"}, "geometry": %s}'


def box(west: float, south: float, east: float, north: float) -> Polygon:
    return shapely.box(WEST + west, SOUTH + south, WEST + east, SOUTH + north)


SQUARE, BESIDE, WITHIN = box(0, 0, 500, 500), box(600, 0, 900, 500), box(200, 200, 300, 300)


def linear(ring: str, prefix: str = "") -> str:
    p = prefix
    return f"<{p}LinearRing><{p}coordinates>{ring}</{p}coordinates></{p}LinearRing>"


def polygon(*inside: str, west: float = -135.01, prefix: str = "") -> str:
    outer = linear(RING.format(west, west + 0.01), prefix)
    boundary = f"{prefix}outerBoundaryIs"
    return f"<{prefix}Polygon><{boundary}>{outer}</{boundary}>{''.join(inside)}</{prefix}Polygon>"


def holes(*rings: str, prefix: str = "") -> str:
    inside = "".join(linear(ring, prefix) for ring in rings)
    return f"<{prefix}innerBoundaryIs>{inside}</{prefix}innerBoundaryIs>"


def placemark(*shapes: str, prefix: str = "") -> str:
    return f"<{prefix}Placemark>{''.join(shapes)}</{prefix}Placemark>"


def kml(*inside: str, prefix: str = "") -> Callable[[Path], None]:
    p, name = prefix, prefix.rstrip(":")
    space = f'xmlns{":" if name else ""}{name}="http://www.opengis.net/kml/2.2"'
    text = f"<{p}kml {space}><{p}Document>{''.join(inside)}</{p}Document></{p}kml>"
    return lambda file: _write_kml(file, text)


def _write_kml(file: Path, text: str) -> None:
    if file.suffix == ".kml":
        file.write_text(text)
        return
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("doc.kml", text)


def two_documents(file: Path) -> None:
    kml(placemark(polygon()))(file)
    with zipfile.ZipFile(file, "a") as archive:
        archive.writestr("more.kml", "<kml/>")


def features(*shapes: object) -> Callable[[Path], None]:
    """Return a writer of shapes, however the format stores them."""

    def write(file: Path) -> None:
        if file.suffix != ".fgb":
            write_features(file, [*shapes], {"id": np.arange(len(shapes))}, UTM, layer="area")
            return
        with gdal_bindings() as gdal:
            gdal.raw.write(
                file, shapely.to_wkb(np.array(shapes, dtype=object)), [np.arange(len(shapes))], ["id"],
                driver="FlatGeobuf", geometry_type="Unknown", crs=UTM.to_wkt(), layer="area",
            )  # fmt: skip

    return write


def layers(**found: object) -> Callable[[Path], None]:
    return lambda file: write_layers(
        file, {name: Layer([shape], {"id": [1]}) for name, shape in found.items()}, UTM
    )


def text(content: str) -> Callable[[Path], None]:
    return lambda file: file.write_text(content) and None


def without_table(file: Path) -> None:
    features(SQUARE)(file)
    file.with_suffix(".dbf").unlink()


def empty(file: Path) -> None:
    with gdal_bindings() as gdal:
        shapes = np.array([shapely.to_wkb(SQUARE), None], dtype=object)
        driver = {".fgb": "FlatGeobuf", ".gpkg": "GPKG", ".shp": "ESRI Shapefile"}[file.suffix]
        gdal.raw.write(
            file, shapes, [np.arange(2)], ["id"], driver=driver, geometry_type="Polygon", crs=UTM.to_wkt(),
            layer="area", **({"SPATIAL_INDEX": "NO"} if driver == "FlatGeobuf" else {}),
        )  # fmt: skip


SHAPE = json.dumps(shapely.geometry.mapping(shapely.box(-135.01, 60.4, -135.0, 60.405)))
WHOLE_M2, LESS_M2 = 307_076.0, 288_640.0  # the square in degrees, and less three holes
OF_KML = {
    "holes in one boundary": (kml(placemark(polygon(holes(*HOLES)))), LESS_M2),
    "holes in one boundary and in one of their own": (
        kml(placemark(polygon(holes(*HOLES[:2]), holes(HOLES[2])))),
        LESS_M2,
    ),
    "holes with a prefix": (
        kml(placemark(polygon(holes(*HOLES, prefix="k:"), prefix="k:"), prefix="k:"), prefix="k:"),
        LESS_M2,
    ),
    "two polygons in a placemark": (kml(placemark(polygon(), polygon(west=-135.03))), "2 of <Polygon>"),
    "two outlines in a polygon": (
        kml(placemark(polygon(f"<outerBoundaryIs>{linear(RING.format(-136, -135.9))}</outerBoundaryIs>"))),
        "2 of <outerBoundaryIs>",
    ),
    "a folder beside": (
        kml(placemark(polygon()), "<Folder><name>more</name>", placemark(polygon(west=-135.03)), "</Folder>"),
        "has 2 layers",
    ),
    "a polygon of several shapes in a folder beside": (
        kml(
            placemark(polygon()),
            "<Folder><name>more</name>",
            placemark("<MultiGeometry>", polygon(west=-135.03), "<Point><coordinates>-135,60</coordinates></Point></MultiGeometry>"),
            "</Folder>",
        ),
        "has 2 layers",
    ),
    "an overlay": (
        kml(placemark(polygon()), "<GroundOverlay><name>map</name></GroundOverlay>"),
        "feature 2 has no shape that can be read",
    ),
    "a ring that is open": (
        kml(placemark(polygon()), placemark(polygon(west=-135.03).replace(" -135.03,60.4,0<", "<"))),
        "feature 2 is an empty polygon; close each ring",
    ),
}  # fmt: skip
OF_JSON = {
    "a list given twice": (text(GEOJSON[:-1] % (FEATURE % SHAPE) + ', "features": []}'), "'features' twice"),
    "a role given twice": (
        text(GEOJSON % (FEATURE % SHAPE).replace('"role"', '"role": "no-go", "role"')),
        "gives the key 'role' twice in one object",
    ),
    "a list in a list": (
        text(GEOJSON % f"{FEATURE % SHAPE}, {GEOJSON % (FEATURE % SHAPE)}"),
        "holds 2 features, of which 1 can be read",
    ),
    "a shape of another kind": (
        text(GEOJSON % f"{FEATURE % SHAPE}, {FEATURE % SHAPE.replace('Polygon', 'Circle')}"),
        "feature 2 has no shape that can be read",
    ),
    "one feature after the other": (text(f"{FEATURE % SHAPE}\n{FEATURE % SHAPE}"), WHOLE_M2),
    "a part inside a part": (features(MultiPolygon([SQUARE, WITHIN])), "feature 1 has a part inside another"),
}
OF_SHAPES = {
    "a part inside a part": (features(MultiPolygon([SQUARE, WITHIN])), "feature 1 has a part inside another"),
    "a feature without a shape": (empty, "feature 2 has no shape that can be read"),
}
MIXED = {
    "a collection": (features(SQUARE, GeometryCollection([BESIDE, Point(0, 0)])), "feature 2 is a Geometry"),
    "a line": (features(SQUARE, LineString([(0, 0), (1, 1)])), "feature 2 is a LineString"),
}
CASES: dict[str, dict[str, tuple[Callable[[Path], None], object]]] = {
    ".kml": OF_KML,
    ".kmz": {**OF_KML, "a second document": (two_documents, "holds 2 KML documents")},
    ".geojson": OF_JSON,
    ".json": OF_JSON,
    ".shp": {**OF_SHAPES, "no table": (without_table, "has no .dbf beside it")},
    ".gpkg": {
        **OF_SHAPES,
        **MIXED,
        "two layers of polygons": (layers(north=SQUARE, south=BESIDE), r"has 2 layers \(north, south\)"),
        "a layer of points beside": (layers(site=SQUARE, camps=Point(0, 0)), "the one with polygons, site"),
    },
    ".fgb": {**OF_SHAPES, **MIXED},
    ".gpx": {
        "a track and a route": (
            text('<gpx version="1.1"><rte><rtept lat="60" lon="-135"/></rte><trk><trkseg/></trk></gpx>'),
            "has no layer|no polygon|polygon was expected|holds no features",
        )
    },
}


def test_every_format_is_in_the_table() -> None:
    assert set(CASES) == set(VECTOR_SUFFIXES)


@pytest.mark.parametrize(("suffix", "case"), [(suffix, case) for suffix in CASES for case in CASES[suffix]])
def test_what_a_reader_would_leave_out_is_used_refused_or_named(
    suffix: str, case: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    write, expected = CASES[suffix][case]
    file = tmp_path / f"area{suffix}"
    write(file)
    if isinstance(expected, float):
        assert SurveyArea.read(file, crs=UTM).ground_area_m2 == pytest.approx(expected, rel=1e-4)
        return
    try:
        SurveyArea.read(file, crs=UTM)
        said = caplog.text
    except InputError as error:
        said = str(error)
        assert "\n" not in said
    assert re.search(str(expected), said), said


@pytest.mark.parametrize("suffix", [".geojson", ".gpkg", ".shp", ".kml"])
def test_a_path_may_hold_an_exclamation_mark(suffix: str, tmp_path: Path) -> None:
    (tmp_path / "we!rd").mkdir()
    file = tmp_path / "we!rd" / f"a!b{suffix}"
    write_features(file, [SQUARE], {"name": np.array(["site"], dtype=object)}, UTM, layer="area")
    assert read_features(file).attributes["Name" if suffix == ".kml" else "name"][0] == "site"
    assert SurveyArea.read(file, crs=UTM).ground_area_m2 == pytest.approx(250_000.0, rel=1e-3)
    assert {other.stem for other in (tmp_path / "we!rd").iterdir()} == {"a!b"}
