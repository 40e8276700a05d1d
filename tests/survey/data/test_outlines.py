"""Outlines of files: neighbours that touch, parts inside parts, glaciers of an inventory, outlines of many corners."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
import shapely
from pyproj import CRS
from shapely import MultiPolygon, Polygon

from planners import LawnmowerConfig, plan
from survey import InputError, SurveyArea
from survey.io.vector import write_features
from survey.scoring.differencing.change_files import read_outlines

UTM = CRS("EPSG:32608")
WEST, SOUTH = 500_000.0, 6_470_000.0


def box(west: float, south: float, east: float, north: float) -> Polygon:
    return shapely.box(WEST + west, SOUTH + south, WEST + east, SOUTH + north)


def written(file: Path, shapes: Sequence[object], crs: object = UTM, **columns: list[object]) -> Path:
    attributes = {name: np.array(values, dtype=object) for name, values in columns.items()}
    write_features(file, [*shapes], attributes or {"id": np.arange(len(shapes))}, CRS(crs), layer="area")
    return file


def in_degrees(file: Path, *shapes: object) -> Path:
    found = [
        {"type": "Feature", "properties": {}, "geometry": shapely.geometry.mapping(shape)} for shape in shapes
    ]
    file.write_text(json.dumps({"type": "FeatureCollection", "features": found}))
    return file


LEFT = shapely.box(-135.0, 60.4, -134.99, 60.405)
MORE_CORNERS = Polygon(
    [(-134.99, 60.4), (-134.98, 60.4), (-134.98, 60.405), (-134.99, 60.405), (-134.99, 60.4025)]
)
DIAGONAL = Polygon([(WEST, SOUTH), (WEST + 500, SOUTH + 300), (WEST, SOUTH + 500)])
BELOW = Polygon([(WEST, SOUTH), (WEST + 500, SOUTH), (WEST + 500, SOUTH + 300), (WEST + 250, SOUTH + 149.9)])
# A border of 11 km along a parallel lies 4 m beside the line between its ends in UTM.
NORTH = Polygon([(-135.0, 60.05), (-134.93, 60.05), (-134.8, 60.05), (-134.8, 60.1), (-135.0, 60.1)])
AT_180 = (shapely.box(179.98, 66.0, 180.0, 66.005), shapely.box(-180.0, 66.0, -179.98, 66.005))


@pytest.mark.parametrize(
    ("shapes", "is_closed"),
    [
        ([LEFT, MORE_CORNERS], False),
        ([LEFT, shapely.box(-134.9899999, 60.4, -134.98, 60.405)], True),
        ([LEFT, shapely.box(-134.989998, 60.4, -134.98, 60.405)], True),
        ([shapely.box(-135.0, 60.0, -134.8, 60.05), NORTH], False),
        (AT_180, False),
        ([MultiPolygon(AT_180)], False),
        ([box(0, 0, 500, 500), box(500.006, 0, 900, 500)], True),
        ([box(0, 0, 500, 500), box(500.19, 0, 900, 500)], True),
        ([MultiPolygon([box(0, 0, 500, 500), box(500.006, 0, 900, 500)])], True),
        ([box(0, 0, 500, 500), box(500.01, 0, 900, 500), box(0, 500.01, 900, 900)], True),
        ([DIAGONAL, BELOW], True),
    ],
)
def test_neighbours_that_touch_are_one_area(
    shapes: Sequence[object], is_closed: bool, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    in_utm = shapely.get_coordinates(shapes[0])[0, 0] > 1000.0
    file = written(tmp_path / "a.gpkg", shapes) if in_utm else in_degrees(tmp_path / "a.geojson", *shapes)
    area = SurveyArea.read(file)
    assert isinstance(area.polygon, Polygon)
    assert not area.polygon.interiors
    assert ("apart around" in caplog.text) is is_closed
    assert plan(area, None, LawnmowerConfig(swaths=5)).prediction["left_out_share"] == pytest.approx(
        0.0, abs=1e-6
    )


def test_neighbours_with_room_between_them_stay_two(tmp_path: Path) -> None:
    shapes = [box(0, 0, 500, 500), box(500.3, 0, 900, 500)]
    assert len(SurveyArea.read(written(tmp_path / "a.gpkg", shapes)).polygon.geoms) == 2


def test_a_narrow_bay_of_one_outline_is_not_closed(tmp_path: Path) -> None:
    bay = box(0, 0, 500, 500) - box(250, 100, 250.1, 500)
    file = written(tmp_path / "a.gpkg", [bay, box(500, 0, 900, 500)])
    assert SurveyArea.read(file).polygon.area == pytest.approx(900 * 500 - 0.1 * 400)


NESTED = MultiPolygon([box(0, 0, 500, 500), box(200, 200, 300, 300)])


@pytest.mark.parametrize(
    "shape",
    [NESTED, MultiPolygon([box(0, 0, 500, 500), box(-0.2, 200, 100, 300)]), MultiPolygon(NESTED.geoms[::-1])],
)
def test_a_part_inside_another_part_is_refused_wherever_outlines_are_read(
    shape: object, tmp_path: Path
) -> None:
    for columns in ({}, {"role": ["area"]}):
        file = written(tmp_path / "a.gpkg", [shape], **columns)
        with pytest.raises(InputError, match="feature 1 has a part inside another part of it, around"):
            SurveyArea.read(file)
        with pytest.raises(InputError, match="feature 1 has a part inside another part of it, around"):
            read_outlines(file, UTM)
    zone = written(tmp_path / "b.gpkg", [box(-9, -9, 900, 900), shape], role=["area", "no-go"])
    with pytest.raises(InputError, match="feature 2 has a part inside"):
        SurveyArea.read(zone)


def test_an_island_in_a_hole_is_ground(tmp_path: Path) -> None:
    shape = MultiPolygon([box(0, 0, 500, 500) - box(100, 100, 400, 400), box(200, 200, 300, 300)])
    assert SurveyArea.read(written(tmp_path / "a.gpkg", [shape])).polygon.area == pytest.approx(17e4)


GLACIERS = [box(0, 0, 500, 500), box(600, 0, 800, 300), box(2000, 0, 2100, 100)]
IDS = ["RGI60-11.00001", "RGI60-11.00002", "RGI60-11.00003"]


def inventory(folder: Path) -> Path:
    return written(folder / "rgi.gpkg", GLACIERS, RGIId=IDS, Name=["Small\x1bice", "Big  ice", None])


@pytest.mark.parametrize(
    ("select", "area_m2"),
    [
        ("RGIId=RGI60-11.00002", 6e4),
        (["rgiid=rgi60-11.00003"], 1e4),
        (["big*"], 6e4),
        (["RGI60-11.00001", "RGI60-11.00003"], 26e4),
        (["*"], 32e4),
    ],
)
def test_glaciers_of_an_inventory_are_chosen(select: str | list[str], area_m2: float, tmp_path: Path) -> None:
    assert SurveyArea.read(inventory(tmp_path), select=select).polygon.area == pytest.approx(area_m2)


def test_an_inventory_is_listed_and_a_choice_is_asked_for(tmp_path: Path) -> None:
    file = inventory(tmp_path)
    with pytest.raises(InputError) as error:
        SurveyArea.read(file)
    assert "holds 3 glaciers (RGIId=RGI60-11.00001 (Small\\x1bice), RGIId=RGI60-11.00002 (Big ice)," in str(
        error.value
    )
    assert "such as --select RGIId=RGI60-11.00001, or all with --select '*'" in str(error.value)
    with pytest.raises(InputError, match="has no outline 'Large'; it holds RGIId="):
        SurveyArea.read(file, select=["Large"])
    with pytest.raises(InputError, match=r"has no column 'ID' \(found RGIId, Name\)"):
        SurveyArea.read(file, select=["ID=3"])
    one = written(tmp_path / "one.gpkg", GLACIERS[:1], RGIId=IDS[:1])
    assert SurveyArea.read(one).polygon.area == pytest.approx(25e4)
    assert list(read_outlines(file, UTM, ["big*"])) == ["Big  ice"]


def test_zones_and_starts_stay_with_a_chosen_outline(tmp_path: Path) -> None:
    shapes = [*GLACIERS[:2], box(650, 50, 700, 100), shapely.Point(WEST + 610, SOUTH + 10)]
    names = ["north", "south", None, None]
    file = written(tmp_path / "a.gpkg", shapes, Role=["area", "Area", "NO-GO", "start"], name=names)
    area = SurveyArea.read(file, select=["south"])
    assert (area.polygon.area, len(area.no_go), len(area.starts)) == (pytest.approx(6e4), 1, 1)


def test_an_outline_of_41000_corners_is_simplified_and_planned(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 41_000, endpoint=False)
    radius = 3000.0 + 50.0 * np.sin(40.0 * angle)
    circle = Polygon(np.column_stack([WEST + radius * np.cos(angle), SOUTH + radius * np.sin(angle)]))
    area = SurveyArea.read(written(tmp_path / "a.gpkg", [circle]))
    assert shapely.get_num_coordinates(area.polygon) <= 20_000
    assert "an outline of 41001 corners; it is simplified to" in caplog.text
    assert shapely.hausdorff_distance(area.polygon, circle) <= 0.5
    assert area.polygon.area == pytest.approx(circle.area, rel=1e-4)


COUNTRIES = [
    shapely.box(6.0, 49.5, 6.5, 50.0),
    MultiPolygon([shapely.box(177.0, -18.0, 180.0, -16.0), shapely.box(-180.0, -17.0, -179.5, -16.0)]),
    Polygon([(-180.0, -90.0), (180.0, -90.0), (180.0, -84.0), (0.0, -70.0), (-180.0, -84.0)]),
    MultiPolygon([shapely.box(-5.0, 43.0, 7.0, 49.0), shapely.box(-54.0, 2.0, -52.0, 5.0)]),
]
COUNTRY_NAMES = ["Luxembourg", "Fiji", "Antarctica", "France"]


@pytest.mark.parametrize(
    ("select", "crs", "words"),
    [
        ((), None, r"reaches [\d,]+ km from its middle .*choose outlines near each other with --select"),
        (("France", "Fiji"), None, r"km from its middle \(France\).*--select Fiji"),
        (("Antarctica",), None, r"km from its middle \(Antarctica\).*name a CRS \(--crs, crs=\)"),
        (("Antarctica",), "EPSG:32633", "crosses itself|does not fit into"),
    ],
)
def test_ground_that_no_projection_holds_is_named(
    select: tuple[str, ...], crs: str | None, words: str, tmp_path: Path
) -> None:
    file = written(tmp_path / "countries.gpkg", COUNTRIES, "EPSG:4326", name=COUNTRY_NAMES)
    with pytest.raises(InputError, match=words):
        SurveyArea.read(file, select=select, crs=crs)
    assert SurveyArea.read(file, select="Fiji").crs.to_epsg() in (32760, 32701)


def test_neighbours_across_greenwich_stay_whole_beside_ground_cut_at_180_degrees(tmp_path: Path) -> None:
    shapes = [shapely.box(-1.0, 70.0, 1.0, 71.0), *AT_180]
    file = written(tmp_path / "a.gpkg", shapes, "EPSG:4326")
    area = SurveyArea.read(file, crs="EPSG:3995")
    assert len(shapely.get_parts(area.polygon)) == 2
    alone = SurveyArea.read(written(tmp_path / "b.gpkg", shapes[:1], "EPSG:4326"), crs="EPSG:3995")
    assert max(part.area for part in shapely.get_parts(area.polygon)) == pytest.approx(alone.polygon.area)
