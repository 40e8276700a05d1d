"""Heights and places in feet are converted and said, whoever states the unit; an unstated one is refused beside places in feet."""

import logging
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
import rasterio
from affine import Affine
from pyproj import CRS

from survey.core import InputError
from survey.core.lengths import FOOT_M, US_SURVEY_FOOT_M
from survey.data import Dem, SurfacePoints, SurveyArea
from survey.io.point_files import read_named_points, read_point_table
from survey.io.raster.large import read_averaged
from survey.reconstruction.tiled.job import TiledConfig, tiled_job

XY = np.array([[500010.0, 6700010.0], [500090.0, 6700010.0], [500050.0, 6700090.0]])
Z = np.array([300.0, 310.0, 320.0])


def las(
    file: Path,
    keys: dict[int, int] | None = None,
    wkt: str | None = None,
    foot: float = 1.0,
    place: float = 1.0,
) -> Path:
    """Write three points with GeoKeys or a WKT record, heights and places in units of so many metres."""
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = np.full(3, 1e-4), np.array([5e5 / place, 6.7e6 / place, 0.0])
    if wkt is not None:
        header.add_crs(CRS(wkt))
    if keys is not None:
        directory = laspy.vlrs.known.GeoKeyDirectoryVlr()
        for key, value in keys.items():
            entry = laspy.vlrs.known.GeoKeyEntryStruct(key, 0, 1, value)
            directory.geo_keys.append(entry)
        directory.geo_keys_header.number_of_keys = len(keys)
        header.vlrs.append(directory)
    data = laspy.LasData(header)
    data.x, data.y = (XY / place).T
    data.z = Z / foot
    data.write(str(file))
    return file


US = {"foot": US_SURVEY_FOOT_M}
FEET: list[tuple[dict[str, Any], str]] = [
    ({"keys": {3072: 32608, 4099: 9003}, **US}, ""),
    ({"keys": {3072: 32608, 4099: 9002}, "foot": FOOT_M}, ""),
    ({"keys": {3072: 32608, 4096: 6360}, **US}, "NAVD88 height"),
    ({"keys": {3072: 32608, 4096: 8228}, "foot": FOOT_M}, "NAVD88 height"),
    ({"keys": {3072: 32608, 4096: 5703, 4099: 9003}, **US}, "NAVD88 height"),
    ({"keys": {3072: 32608, 4098: 5103, 4099: 9003}, **US}, "North American Vertical Datum 1988"),
    ({"keys": {3072: 32608, 3076: 9003, 4099: 9003}, **US, "place": US_SURVEY_FOOT_M}, ""),
    ({"wkt": "EPSG:32608+6360", **US}, "NAVD88 height"),
    ({"wkt": "EPSG:32608+8228", "foot": FOOT_M}, "NAVD88 height"),
]


@pytest.mark.parametrize(("made", "datum"), FEET)
def test_heights_in_feet_by_header_are_converted_at_both_doors(
    tmp_path: Path, caplog: Any, made: dict[str, Any], datum: str
) -> None:
    file = las(tmp_path / "a.las", **made)
    with caplog.at_level(logging.WARNING):
        points = SurfacePoints.read(file, sigma_m=0.1)
    assert points.xyz == pytest.approx(np.column_stack([XY, Z]), abs=0.002)
    assert points.vertical_datum == datum
    assert "feet" in caplog.text
    assert "they are converted to metres" in caplog.text
    job = tiled_job([file], tmp_path / "map", TiledConfig())
    assert job.pieces[0].metres == pytest.approx((made.get("place", 1.0), made["foot"]))
    assert job.vertical_datum == datum


def test_a_metric_las_states_metres_whatever_the_option_says(tmp_path: Path, caplog: Any) -> None:
    file = las(tmp_path / "a.las", keys={3072: 32608, 4099: 9001})
    assert SurfacePoints.read(file, sigma_m=0.1, units="ft").z == pytest.approx(Z)
    assert "--units ft is for files that state none" in caplog.text
    bare = las(tmp_path / "b.las", keys={3072: 32608}, foot=FOOT_M)
    assert SurfacePoints.read(bare, sigma_m=0.1, units="ft").z == pytest.approx(Z, abs=0.001)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({3072: 32608, 4099: 12345}, "the unit of length 12345 in its GeoKeys"),
        ({3072: 2263}, "does not state the unit of its heights; name it with --units"),
        ({1024: 1, 3072: 32767, 2048: 4326}, "describes its CRS by GeoKeys without a code"),
    ],
)
def test_units_that_a_header_leaves_open_are_refused(
    tmp_path: Path, keys: dict[int, int], words: str
) -> None:
    file = las(tmp_path / "a.las", keys=keys)
    with pytest.raises(InputError, match=words):
        read_point_table(file)
    with pytest.raises(InputError, match=words):
        tiled_job([file], tmp_path / "map", TiledConfig())


def test_a_named_crs_stands_for_geokeys_without_a_code(tmp_path: Path, caplog: Any) -> None:
    file = las(tmp_path / "a.las", keys={1024: 1, 3072: 32767, 2048: 4326, 4099: 9003}, foot=US_SURVEY_FOOT_M)
    with pytest.raises(InputError, match="--crs"):
        SurfacePoints.read(file, sigma_m=0.1)
    points = SurfacePoints.read(file, sigma_m=0.1, crs="EPSG:32608")
    assert points.xyz == pytest.approx(np.column_stack([XY, Z]), abs=0.002)
    assert "without a code, which are not read; the CRS that was named, EPSG:32608, is used" in caplog.text
    caplog.clear()
    job = tiled_job([file], tmp_path / "map", TiledConfig(), crs="EPSG:32608")
    assert job.map_crs.to_epsg() == 32608
    assert job.pieces[0].metres == pytest.approx((1.0, US_SURVEY_FOOT_M))
    assert "EPSG:32608, is used" in caplog.text


def test_feet_among_metres_on_one_ground_are_refused_by_their_headers(tmp_path: Path) -> None:
    files = [
        las(tmp_path / "a.las", keys={3072: 32608}),
        las(tmp_path / "b.las", keys={3072: 32608}, foot=FOOT_M),
    ]
    with pytest.raises(InputError, match=r"3\.28 times those of .*a\.las.* with --units"):
        tiled_job(files, tmp_path / "map", TiledConfig())


TABLES = [
    ("x,y,Elevation (ft)", {}, FOOT_M, 1.0),
    ("x,y,Elev US survey ft", {}, US_SURVEY_FOOT_M, 1.0),
    ("x,y,z", {"units": "us-ft"}, US_SURVEY_FOOT_M, 1.0),
    ("x,y,z", {"crs": "EPSG:32608+6360"}, US_SURVEY_FOOT_M, 1.0),
    ("x,y,z", {"crs": "EPSG:2263+6360"}, US_SURVEY_FOOT_M, US_SURVEY_FOOT_M),
    ("x,y,z", {"crs": "EPSG:2263", "units": "ft"}, FOOT_M, US_SURVEY_FOOT_M),
    ("Easting (US ft),Northing (US ft),z", {"crs": "EPSG:32118", "units": "m"}, 1.0, US_SURVEY_FOOT_M),
    (
        "Easting (ft),Northing (ft),z",
        {"crs": "EPSG:32118", "units": "us-ft"},
        US_SURVEY_FOOT_M,
        US_SURVEY_FOOT_M,
    ),
    ("Easting (ft),Northing (ft),RL (ft)", {"crs": "EPSG:2263"}, FOOT_M, US_SURVEY_FOOT_M),
]


@pytest.mark.parametrize(("header", "options", "foot", "place"), TABLES)
def test_tables_in_feet_are_converted(
    tmp_path: Path, header: str, options: dict[str, Any], foot: float, place: float
) -> None:
    file = tmp_path / "a.csv"
    rows = [
        f"{x / place!r},{y / place!r},{z / foot!r},0.5"
        for (x, y), z in zip(XY.tolist(), Z.tolist(), strict=True)
    ]
    file.write_text("\n".join([f"{header},SDV", *rows, ""]))
    read = SurfacePoints.read(file, **{"crs": "EPSG:32608", **options})
    assert read.xyz == pytest.approx(np.column_stack([XY, Z]), abs=0.002)
    assert read.sigma_z == pytest.approx(np.full(3, 0.5 * foot), abs=1e-6)
    assert read.crs.axis_info[0].unit_name == "metre"
    named = read_named_points(file, "the checkpoint file", **{"crs": "EPSG:32608", **options}).table
    assert named.columns["z_m"] == pytest.approx(Z, abs=0.002)


@pytest.mark.parametrize(
    ("header", "options", "words"),
    [
        ("x_m,y_m,z_m", {"crs": "EPSG:2263+6360"}, "places in metres, and its CRS counts in US survey feet"),
        ("x,y,z_m", {"crs": "EPSG:32608+6360"}, "heights in metres, and its CRS counts in US survey feet"),
        ("x,y,z", {"crs": "EPSG:2263"}, "does not state the unit of its heights; name it with --units"),
        ("Easting (ft),Northing (ft),z", {"crs": "EPSG:32118"}, "name the foot with --units ft or us-ft"),
        ("Easting (ft),Northing (m),z", {}, "write both columns in one unit"),
        ("x,y,z", {"units": "yd"}, "--units is 'yd'; one of m, ft, us-ft"),
    ],
)
def test_units_that_contradict_are_refused(
    tmp_path: Path, header: str, options: dict[str, Any], words: str
) -> None:
    (tmp_path / "a.csv").write_text(f"{header}\n1.5,2.5,3.5\n4.5,5.5,6.5\n")
    with pytest.raises(Exception, match=words):
        SurfacePoints.read(tmp_path / "a.csv", sigma_m=0.1, **{"crs": "EPSG:32608", **options})


def raster(
    file: Path, crs: str | None, place: float = 1.0, foot: float = 1.0, unit: str | None = None
) -> Path:
    step = Affine.scale(1.0 / place) @ Affine(10.0, 0.0, 500000.0, 0.0, -10.0, 6700100.0)
    profile = {
        "height": 10,
        "width": 10,
        "count": 1,
        "dtype": "float64",
        "driver": "GTiff",
        "transform": step,
    }
    with rasterio.open(file, "w", crs=crs, **profile) as target:
        target.write(np.add.outer(np.arange(10.0), np.arange(10.0) + 300.0) / foot, 1)
        if unit is not None:
            target.units = (unit,)
    return file


@pytest.mark.parametrize(
    ("crs", "unit", "units", "place", "foot"),
    [
        ("EPSG:2263+6360", None, None, US_SURVEY_FOOT_M, US_SURVEY_FOOT_M),
        ("EPSG:2263", "ft", None, US_SURVEY_FOOT_M, FOOT_M),
        ("EPSG:2263", None, "us-ft", US_SURVEY_FOOT_M, US_SURVEY_FOOT_M),
        ("EPSG:32608+8228", None, None, 1.0, FOOT_M),
        ("EPSG:32608", None, "ft", 1.0, FOOT_M),
        ("EPSG:32608", "m", "ft", 1.0, 1.0),
    ],
)
def test_rasters_in_feet_are_converted(
    tmp_path: Path, crs: str, unit: str | None, units: str | None, place: float, foot: float
) -> None:
    file = raster(tmp_path / "a.tif", crs, place, foot, unit)
    whole = Dem.read(file, units=units)
    assert whole.step_m == pytest.approx(10.0)
    assert whole.at([[500045.0, 6700055.0]]) == pytest.approx([308.0])
    part = Dem.read(file, units=units, bounds=(500020.0, 6700020.0, 500060.0, 6700060.0))
    assert part.at([[500045.0, 6700055.0]]) == pytest.approx([308.0])
    assert part.shape < whole.shape
    if place == 1.0:
        assert read_averaged(file, 1, units=units)[0].values == pytest.approx(whole.elevation)


def test_own_maps_are_in_metres_whatever_the_option_says(tmp_path: Path) -> None:
    made = Dem(np.full((3, 3), 812.0), Affine(1.0, 0.0, 5e5, 0.0, -1.0, 6.7e6), "EPSG:32608")
    made.write(tmp_path / "own.tif")
    assert Dem.read(tmp_path / "own.tif", units="ft").elevation[0, 0] == 812.0


def test_an_area_in_feet_is_moved_to_metres(tmp_path: Path) -> None:
    import shapely

    from survey.io.vector import write_features

    square = shapely.box(1e6, 2e5, 1e6 + 1000.0, 2e5 + 1000.0)
    write_features(tmp_path / "a.gpkg", np.array([square]), {}, CRS("EPSG:2263"), layer="area")
    area = SurveyArea.read(tmp_path / "a.gpkg")
    assert area.crs.to_epsg() == 32118
    assert area.polygon.area == pytest.approx((1000.0 * US_SURVEY_FOOT_M) ** 2, rel=1e-6)


POINTS = "CP1,6700010.00,500010.00,300.00,IP, found\nCP2,6700010.00,500090.00,310.00\n3,6700090.00,500050.00,320.00,12\n"


@pytest.mark.parametrize(
    "columns", [{"name": "1", "y_m": "2", "x_m": "3", "z_m": "4"}, {"y_m": "2", "x_m": "3", "z_m": "4"}]
)
def test_a_surveyors_table_without_header_is_read_by_position(
    tmp_path: Path, columns: dict[str, str]
) -> None:
    (tmp_path / "a.txt").write_text(POINTS)
    read = SurfacePoints.read(tmp_path / "a.txt", crs="EPSG:32608", sigma_m=0.1, columns=columns)
    assert read.xyz == pytest.approx(np.column_stack([XY, Z]))
    named = read_named_points(tmp_path / "a.txt", "the checkpoint file", columns)
    assert named.names == (("CP1", "CP2", "3") if "name" in columns else ())
    (tmp_path / "b.txt").write_text(
        "PNT,N,E,RL,Desc\n" + POINTS.replace("IP, found", "IP").replace("310.00\n", "310.00,\n")
    )
    assert SurfacePoints.read(
        tmp_path / "b.txt", crs="EPSG:32608", sigma_m=0.1, columns=columns
    ).z == pytest.approx(Z)


@pytest.mark.parametrize(
    "name", ["RL", "Ortho Ht", "Elev", "Elev.", "Ellip Ht", "Reduced Level", "Ortho Ht (m)"]
)
def test_names_of_heights_of_surveyors_are_known(tmp_path: Path, name: str) -> None:
    (tmp_path / "a.csv").write_text(f"Point,Northing,Easting,{name}\n1,6700010.5,500010.5,300.5\n")
    assert read_point_table(tmp_path / "a.csv").columns["z_m"].tolist() == [300.5]


def test_a_table_without_standard_deviations_is_told_of_sigma(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("x_m,y_m,z_m\n1,2,3\n4,5,6\n")
    with pytest.raises(InputError, match="name one for all with --sigma"):
        SurfacePoints.read(tmp_path / "a.csv", crs="EPSG:32608")
