import json
from pathlib import Path

import numpy as np
import pyproj
import pytest
import shapely
from shapely import Polygon

from survey import InputError, SurveyArea
from survey.io.vector import read_features, write_features

CRS = "EPSG:32608"
SQUARE = Polygon([(0, 0), (100, 0), (100, 100), (0, 100)])


def test_holes_and_no_go_zones_are_not_contained():
    area = SurveyArea(SQUARE, CRS, no_go=(shapely.box(40, 40, 60, 60),))
    np.testing.assert_array_equal(
        area.contains([[10, 10], [50, 50], [0, 0], [101, 50]]), [True, False, True, False]
    )


def test_reference_is_the_centroid_and_the_farthest_point_a_corner():
    area = SurveyArea(SQUARE, CRS)
    np.testing.assert_allclose(area.reference, [50.0, 50.0])
    assert area.farthest_m == pytest.approx(np.hypot(50.0, 50.0))


@pytest.mark.parametrize("name", ["a.gpkg", "a.geojson"])
def test_file_gives_back_outline_no_go_and_starts(tmp_path, name):
    area = SurveyArea(SQUARE, CRS, no_go=(shapely.box(40, 40, 60, 60),), starts=[[1.0, 2.0]])
    area.write(tmp_path / name)
    back = SurveyArea.read(tmp_path / name)
    assert back.polygon.equals(area.polygon)
    assert back.no_go[0].equals(area.no_go[0])
    np.testing.assert_allclose(back.starts, area.starts)
    assert back.crs == area.crs


def test_degrees_are_projected_to_their_utm_zone_or_the_named_crs(tmp_path, caplog):
    ring = [[-134.55, 58.44], [-134.54, 58.44], [-134.54, 58.445], [-134.55, 58.445], [-134.55, 58.44]]
    feature = {"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": [ring]}}
    (tmp_path / "a.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    with caplog.at_level("WARNING"):
        assert SurveyArea.read(tmp_path / "a.geojson").crs.to_epsg() == 32608
    assert "a.geojson is in degrees (WGS 84); it is projected to WGS 84 / UTM zone 8N." in caplog.text
    area = SurveyArea.read(tmp_path / "a.geojson", crs=CRS)
    # 0.01° of longitude at 58.44° N is 583 m, 0.005° of latitude 557 m (WGS 84, to a per cent).
    assert area.polygon.area == pytest.approx(583.0 * 557.0, rel=0.01)


@pytest.mark.parametrize(
    ("polygon", "words"),
    [
        (Polygon([(0, 0), (10, 10), (10, 0), (0, 10)]), "not a simple polygon"),
        (Polygon(), "empty"),
        (shapely.LineString([(0, 0), (1, 1)]), "a polygon was expected"),
        (Polygon([(0, 0), (5, 5), (10, 10)]), "encloses no ground|not a simple"),
        (Polygon([(0, 0), (1e400, 0), (1, 1)]), "NaN or infinite"),
        (Polygon(SQUARE.exterior, [[(200, 200), (210, 200), (210, 210)]]), "not a simple polygon"),
    ],
)
def test_refuses_what_is_no_area(polygon, words):
    with pytest.raises(InputError, match=words):
        SurveyArea(polygon, CRS)


def test_refuses_no_go_that_covers_everything():
    with pytest.raises(InputError, match="cover the whole"):
        SurveyArea(SQUARE, CRS, no_go=(SQUARE.buffer(1.0),))


def test_refuses_a_start_in_a_no_go_zone():
    with pytest.raises(InputError, match="no-go zone"):
        SurveyArea(SQUARE, CRS, no_go=(shapely.box(40, 40, 60, 60),), starts=[[50.0, 50.0]])


def test_refuses_an_unknown_role(tmp_path):
    SurveyArea(SQUARE, CRS).write(tmp_path / "a.geojson")
    text = (tmp_path / "a.geojson").read_text().replace('"role": "area"', '"role": "aria"')
    (tmp_path / "a.geojson").write_text(text)
    with pytest.raises(InputError, match="role 'aria'"):
        SurveyArea.read(tmp_path / "a.geojson")


# A square in which a rock meets the margin at a point, and two lobes that meet at a point.
_ROCK = [(0, 0), (50, 0), (40, 20), (60, 20), (50, 0), (100, 0), (100, 100), (0, 100)]
_LOBES = [(0, 0), (50, 50), (0, 100), (100, 100), (50, 50), (100, 0)]


def _written(path, shapes, name, values, crs=CRS):
    columns = {name: np.array(values, dtype=object)}
    write_features(path, shapes, columns, pyproj.CRS(crs), layer="area")
    return path


def _in_the_zone(shape):
    return shapely.transform(shape, lambda xy: xy + [500_000.0, 6_700_000.0])


@pytest.mark.parametrize(("ring", "area_m2"), [(_ROCK, 9800.0), (_LOBES, 5000.0)])
def test_rings_that_touch_themselves_bound_the_same_ground(tmp_path, ring, area_m2):
    for polygon in (Polygon(ring), Polygon(ring[::-1]), shapely.MultiPolygon([Polygon(ring)])):
        area = SurveyArea(polygon, CRS)
        assert area.polygon.is_valid
        assert area.polygon.area == pytest.approx(area_m2)
        file = _written(tmp_path / "a.gpkg", [_in_the_zone(polygon)], "name", ["ice"])
        assert SurveyArea.read(file).polygon.area == pytest.approx(area_m2)


def test_a_ring_that_crosses_itself_is_named_with_its_place_in_the_file(tmp_path):
    bow = Polygon([(10.0, 46.0), (10.01, 46.01), (10.01, 46.0), (10.0, 46.01)])
    shapes = [shapely.box(10.02, 46.0, 10.03, 46.01), bow]
    file = _written(tmp_path / "a.geojson", shapes, "name", ["a", "b"], "EPSG:4326")
    with pytest.raises(
        InputError, match=r"feature 2 is not a simple polygon \(Self-intersection\[10.005 46.005\]"
    ):
        SurveyArea.read(file)


def test_a_polygon_inside_another_is_asked_for_its_role(tmp_path):
    shapes = [_in_the_zone(shape) for shape in (SQUARE, shapely.box(40, 40, 60, 60))]
    kinds = ["area", "no-go"]
    with pytest.raises(InputError, match="polygon 2 lies inside polygon 1 and adds nothing"):
        SurveyArea.read(_written(tmp_path / "a.gpkg", shapes, "kind", kinds))
    assert len(SurveyArea.read(_written(tmp_path / "b.gpkg", shapes, "role", kinds)).no_go) == 1
    twice = _written(tmp_path / "c.gpkg", shapes[:1] * 2, "kind", kinds)
    assert SurveyArea.read(twice).polygon.area == pytest.approx(1e4)


def test_real_outlines_are_read(real_data):
    release = SurveyArea.read(real_data / "dem_avaframe_tirol" / "polygons" / "relHit.shp")
    assert release.crs.to_epsg() == 31287
    assert release.polygon.area == pytest.approx(213_814, abs=1.0)
    # Rings of three of these twenty outlines touch themselves; the inventory's own areas are in square kilometres.
    glaciers = real_data / "dem_oggm_glaciers" / "outlines" / "rgi_oetztal.shp"
    stated_km2 = read_features(glaciers).attributes["Area"].sum()
    area = SurveyArea.read(glaciers, crs="EPSG:32632", select=["*"])
    assert area.ground_area_m2 == pytest.approx(1e6 * stated_km2, rel=1e-3)
    with pytest.raises(InputError, match="empty polygon; close each ring"):
        SurveyArea.read(real_data / "coverage_fields2cover" / "strips.geojson", crs="EPSG:32632")


def test_the_area_on_the_ground_leaves_no_go_zones_out():
    area = SurveyArea(shapely.box(0.0, 8.5e6, 1000.0, 8.501e6), "EPSG:3857")
    half = SurveyArea(area.polygon, area.crs, no_go=(shapely.box(0.0, 8.5e6, 500.0, 8.501e6),))
    assert area.ground_area_m2 == pytest.approx(1e6 / 4.05, rel=0.02)
    assert half.ground_area_m2 == pytest.approx(0.5 * area.ground_area_m2, rel=1e-6)


def test_several_layers_are_refused_unless_one_is_named(tmp_path):
    import pyogrio

    for name, west in (("mine", 0.0), ("other", 900.0)):
        shape = shapely.to_wkb(np.array([shapely.box(west, 0.0, west + 100.0, 100.0)], dtype=object))
        pyogrio.raw.write(
            tmp_path / "a.gpkg",
            shape,
            field_data=[],
            fields=[],
            geometry_type="Polygon",
            crs=CRS,
            layer=name,
            append=name == "other",
        )
    with pytest.raises(InputError, match=r"has 2 layers \(mine, other\)"):
        SurveyArea.read(tmp_path / "a.gpkg")
    assert SurveyArea.read(tmp_path / "a.gpkg", layer="other").bounds[0] == 900.0


def test_a_ring_that_is_not_closed_is_named_as_the_fault(tmp_path: Path) -> None:
    ring = [[-134.57, 58.44], [-134.56, 58.44], [-134.56, 58.445], [-134.57, 58.445]]
    polygon = {"type": "Polygon", "coordinates": [ring]}
    feature = {"type": "Feature", "properties": {}, "geometry": polygon}
    (tmp_path / "open.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    with pytest.raises(InputError, match="feature 1 is an empty polygon; close each ring"):
        SurveyArea.read(tmp_path / "open.geojson")
