"""Coordinate columns of other programs are understood, or the file is refused."""

import logging
from pathlib import Path

import numpy as np
import pytest
from pyproj import Transformer

from survey import Dem, Grid, InputError, SurfacePoints
from survey.core.transformation import chosen_crs
from survey.interchange.conversion import convert
from survey.io.point_table import place_columns
from survey.scoring import Checkpoints, compare

UTM = "EPSG:32608"
METRES = [
    "x,y,z",
    "X,Y,Z",
    "easting,northing,elevation",
    "E,N,H",
    "Easting,Northing,Height",
    "x_m,y_m,z_m",
    "e,n,z",
]
DEGREES = [
    "lon,lat,height",
    "longitude,latitude,elevation",
    "Lon,Lat,h",
    "longitude_deg,latitude_deg,height_m",
]


def _file(folder: Path, header: str, rows: str) -> Path:
    path = folder / "points.csv"
    path.write_text(f"{header},sigma_z_m\n{rows}", encoding="utf-8")
    return path


@pytest.mark.parametrize("header", METRES)
def test_metres_are_read_by_any_of_their_names(tmp_path: Path, header: str) -> None:
    points = SurfacePoints.read(_file(tmp_path, header, "500100,6700200,5,0.1\n"), crs=UTM)
    np.testing.assert_array_equal(points.xyz, [[500_100.0, 6_700_200.0, 5.0]])
    assert not points.values


@pytest.mark.parametrize("header", DEGREES)
def test_degrees_are_projected_to_their_utm_zone_and_said_so(
    tmp_path: Path, header: str, caplog: pytest.LogCaptureFixture
) -> None:
    path = _file(tmp_path, header, "-135.1,60.4,5,0.1\n-135.2,60.5,6,0.1\n")
    with caplog.at_level(logging.WARNING):
        points = SurfacePoints.read(path)
    assert points.crs.to_epsg() == 32608
    expected = Transformer.from_crs("EPSG:4326", UTM, always_xy=True).transform(
        [-135.1, -135.2], [60.4, 60.5]
    )
    np.testing.assert_allclose(points.xy.T, expected, atol=1e-6)
    assert points.z.tolist() == [5.0, 6.0]
    assert f"{path} is in degrees (WGS 84); its points are projected to WGS 84 / UTM zone 8N." in caplog.text


def test_degrees_are_projected_to_the_crs_that_is_named(tmp_path: Path) -> None:
    points = SurfacePoints.read(_file(tmp_path, "lon,lat,height", "-135.1,60.4,5,0.1\n"), crs="EPSG:3413")
    assert points.crs.to_epsg() == 3413


def test_a_table_in_metres_and_degrees_is_read_in_metres() -> None:
    header = ["longitude_deg", "latitude_deg", "easting_m", "northing_m", "z_m"]
    assert place_columns(header, "p").names == ("easting_m", "northing_m", "z_m")


def test_the_height_that_belongs_to_the_places_is_taken() -> None:
    assert place_columns(["x", "y", "z", "height"], "p").names[2] == "z"
    assert place_columns(["E", "N", "H", "elevation"], "p").names[2] == "H"


@pytest.mark.parametrize(
    ("header", "words"),
    [
        ("a,b,c", "no columns of places"),
        ("x,y,easting,northing,z", "several columns of places"),
        ("x,y,w", "no column of heights"),
        ("x,y,elevation,altitude", "either could be the height"),
        ("x,X,y,z", "case of letters"),
        ("lon,longitude,lat,h", "mean the same"),
    ],
)
def test_columns_that_could_mean_several_things_are_refused(header: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        place_columns(header.split(","), "p.csv")


def test_metres_under_the_name_of_degrees_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="500100 in the column lon, which is no angle"):
        SurfacePoints.read(_file(tmp_path, "lon,lat,height", "500100,60.4,5,0.1\n"))


def test_places_of_the_sensor_in_metres_beside_degrees_are_refused(tmp_path: Path) -> None:
    path = _file(tmp_path, "lon,lat,height,origin_x_m,origin_y_m,origin_z_m", "-135,60,5,1,2,3,0.1\n")
    with pytest.raises(InputError, match="one projected CRS"):
        SurfacePoints.read(path)


def test_zones_follow_the_middle_across_the_date_line() -> None:
    assert chosen_crs(np.array([179.9, -179.7]), np.array([-60.0, -60.1])).to_epsg() == 32701
    assert chosen_crs(np.array([10.0]), np.array([85.0])).to_epsg() == 3413


def test_checkpoints_in_degrees_are_compared_with_a_map(tmp_path: Path) -> None:
    grid = Grid((500_000.0, 6_700_000.0, 500_100.0, 6_700_100.0), 10.0, UTM)
    lon, lat = Transformer.from_crs(UTM, "EPSG:4326", always_xy=True).transform(500_050.0, 6_700_050.0)
    path = tmp_path / "rtk.csv"
    path.write_text(
        f"name,time_s,latitude_deg,longitude_deg,height_m\nA,0,{lat:.10f},{lon:.10f},7\n", encoding="utf-8"
    )
    points = Checkpoints.read(path, crs=UTM, sigma_m=0.02)
    errors = compare(Dem.on(grid, np.full(grid.shape, 7.5)), points)
    assert errors.errors_m == pytest.approx([0.5])


def test_an_exported_table_in_degrees_names_its_chosen_crs(tmp_path: Path) -> None:
    convert(_file(tmp_path, "lon,lat,height", "-135.1,60.4,5,0.1\n"), tmp_path / "p.gpkg", "points")
    assert SurfacePoints.read(tmp_path / "p.gpkg").crs.to_epsg() == 32608
