"""Areas and rasters in degrees on the command line: `plan`, `reconstruct --prior` and `init --dem` accept them."""

import json
import re
import tomllib
import zipfile
from pathlib import Path

import numpy as np
import pytest
import rasterio
import shapely
from affine import Affine
from pyogrio.raw import write
from pyproj import Transformer
from typer.testing import CliRunner

from firnline.cli.main import app
from survey import Dem, Reconstruction, Route, SurfacePoints

SITES = {
    "north": (-134.5, 58.44, 32608),
    "south": (170.2, -43.5, 32759),
    "border": (-138.0005, 60.5, 32607),
    "polar": (30.0, 84.3, 3413),
}


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(*args: str, code: int = 0) -> str:
    result = CliRunner().invoke(app, [*args])
    assert result.exit_code == code, result.output
    return result.stdout


def area_kml(longitude: float, latitude: float, half_m: float = 200.0) -> Path:
    y = half_m / 111_000.0
    x = y / np.cos(np.deg2rad(latitude))
    shape = shapely.box(longitude - x, latitude - y, longitude + x, latitude + y)
    write("area.kml", np.array([shapely.to_wkb(shape)], dtype=object), [np.array(["x"], dtype=object)], ["Name"],
          crs="EPSG:4326", geometry_type="Polygon", driver="KML")  # fmt: skip
    return Path("area.kml")


def dem_in_degrees(longitude: float, latitude: float, n: int = 60) -> Path:
    cell = 1.0 / 3600.0
    wide = cell * max(1.0, round(1.0 / np.cos(np.deg2rad(latitude))))
    place = Affine(wide, 0.0, longitude - n / 2 * wide, 0.0, -cell, latitude + n / 2 * cell)
    x, y = place @ np.meshgrid(np.arange(n) + 0.5, np.arange(n) + 0.5)
    heights = 400.0 + 20.0 * np.sin((y - latitude) * 1500.0) * np.cos((x - longitude) * 800.0)
    profile = {"driver": "GTiff", "count": 1, "dtype": "float32", "nodata": -9999, "crs": "EPSG:9518"}
    with rasterio.open("dem.tif", "w", height=n, width=n, transform=place, **profile) as target:
        target.write(heights.astype("float32"), 1)
    return Path("dem.tif")


@pytest.mark.parametrize("site", SITES)
def test_an_area_in_kml_and_a_prior_in_degrees_are_planned_in_their_zone(site, caplog):
    longitude, latitude, epsg = SITES[site]
    dem_in_degrees(longitude, latitude)
    out = run("plan", str(area_kml(longitude, latitude)), "--prior", "dem.tif", "--swaths", "4", "--json")
    route = Route.read("route.geojson")
    assert route.crs.to_epsg() == epsg
    assert json.loads(out)["prior_covered_share"] == 1.0
    messages = [record.getMessage() for record in caplog.records]
    assert any(
        m.startswith("the area file area.kml is in degrees (WGS 84); it is projected") for m in messages
    )
    assert any("dem.tif is in degrees" in m and "EGM2008 height unchanged" in m for m in messages)


@pytest.mark.parametrize(
    ("longitude", "latitude", "name", "turn"),
    [
        (-72.0, 81.7, "WGS 84 / UTM zone 19N", 0.0),
        (20.0, -83.0, "WGS 84 / Antarctic Polar Stereographic", 0.0),
        (-73.1, -49.2, "WGS 84 / UTM zone 18S", 360.0),  # rasters of 0° to 360°
        (179.99, 71.2, "WGS 84 / UTM zone 60N", 0.0),  # the raster reaches beyond 180°
        (-179.99, 71.2, "WGS 84 / UTM zone 1N", 360.0),
    ],
)
def test_a_prior_with_an_empty_border_is_warped_wherever_the_area_is(longitude, latitude, name, turn):
    dem_in_degrees(longitude + turn, latitude)
    with rasterio.open("dem.tif", "r+") as target:
        heights = target.read(1)
        heights[:4], heights[-4:], heights[:, :4], heights[:, -4:] = (target.nodata,) * 4
        target.write(heights, 1)
    area_kml(longitude, latitude)
    with zipfile.ZipFile("area.kmz", "w") as archive:
        archive.write("area.kml", "doc.kml")
    said = run("plan", "area.kmz", "--prior", "dem.tif", "--dry-run")
    # 400 m on a side; scales differ from 1 by less than 3 %.
    assert re.search(rf"area +area.kmz, 1[5-6]\.\d ha, {re.escape(name)}", said), said


def test_a_map_is_built_around_a_prior_in_degrees():
    longitude, latitude, epsg = SITES["north"]
    dem_in_degrees(longitude, latitude)
    east, north = Transformer.from_crs(4326, epsg, always_xy=True).transform(longitude, latitude)
    xy = np.array([east, north]) + np.random.default_rng(1).uniform(-150.0, 150.0, (80, 2))
    bump = 3.0 * np.exp(-0.5 * ((xy - [east, north]) ** 2).sum(axis=1) / 60.0**2)
    z = Dem.read("dem.tif").at(xy) + bump
    SurfacePoints(np.column_stack([xy, z]), crs=f"EPSG:{epsg}", sigma_m=0.1).write("points.csv")
    run(*f"reconstruct points.csv --crs EPSG:{epsg} --prior dem.tif --grid 10 -o map -q".split())
    mapped = Reconstruction.read("map")
    difference = mapped.mean.elevation - Dem.read("dem.tif").at(mapped.mean.xy).reshape(mapped.mean.shape)
    assert np.nanmax(difference) == pytest.approx(3.0, abs=0.5)
    assert np.nanmedian(np.abs(difference)) < 1.0


def test_a_mission_is_written_for_terrain_in_degrees(caplog):
    dem_in_degrees(*SITES["south"][:2])
    run("init", "mine.toml", "--dem", "dem.tif")
    mission = tomllib.loads(Path("mine.toml").read_text())
    assert mission["terrain"]["file"] == str(Path("dem.tif").resolve())
    # The corners beside the turned raster are unknown.
    assert mission["area"]["clip_to_terrain"] is True
    assert "it is warped to WGS 84 / UTM zone 59S, cells of 26 m, cubic interpolation" in caplog.text
