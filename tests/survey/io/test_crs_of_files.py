"""A CRS comes back from every format that states one, whether it has a code or not."""

from pathlib import Path

import numpy as np
import pytest
from pyproj import CRS
from shapely import box

from survey import Dem, Grid, SurveyArea
from survey.core.crs import crs_text, equal_crs
from survey.data.surface_points import SurfacePoints

OWN = "+proj=tmerc +lat_0=46 +lon_0=10.5 +k=0.9999 +x_0=1000 +y_0=2000 +ellps=GRS80 +units=m"
CONIC = "+proj=lcc +lat_1=60 +lat_2=62 +lat_0=58 +lon_0=-123 +datum=WGS84 +units=m"
SYSTEMS = ["EPSG:32608", "EPSG:3413", "EPSG:2056", OWN, CONIC, CRS(OWN).to_wkt("WKT1_GDAL")]


@pytest.mark.parametrize("stated", SYSTEMS)
def test_text_of_a_crs_gives_it_back(stated: str) -> None:
    crs = CRS(stated)
    assert CRS(crs_text(crs)).equals(crs)
    assert "\n" not in crs_text(crs)


# Each NetCDF is first read by a process of its own: the systems without a code are the ones that may fail there.
@pytest.mark.parametrize(
    ("ending", "stated"),
    [(ending, stated) for ending in ("tif", "asc") for stated in SYSTEMS]
    + [("nc", stated) for stated in ("EPSG:3413", OWN)],
)
def test_rasters(ending: str, stated: str, tmp_path: Path) -> None:
    dem = Dem.on(Grid((5.0, 5.0, 35.0, 25.0), 10.0, stated), np.arange(12.0).reshape(3, 4))
    dem.write(tmp_path / f"a.{ending}")
    back = Dem.read(tmp_path / f"a.{ending}")
    assert_same(back.crs, stated)
    again = tmp_path / f"again.{ending}"
    back.write(again)
    assert_same(Dem.read(again).crs, stated)
    # It is accepted as the same system that was named.
    Dem.read(tmp_path / f"a.{ending}", crs=stated)


@pytest.mark.parametrize("stated", SYSTEMS)
@pytest.mark.parametrize("ending", ["gpkg", "geojson", "shp"])
def test_areas(ending: str, stated: str, tmp_path: Path) -> None:
    area = SurveyArea(box(0.0, 0.0, 300.0, 200.0), stated)
    area.write(tmp_path / f"a.{ending}")
    back = SurveyArea.read(tmp_path / f"a.{ending}")
    assert_same(back.crs, stated)
    np.testing.assert_allclose(back.bounds, area.bounds, atol=1e-6)


@pytest.mark.parametrize("stated", SYSTEMS)
@pytest.mark.parametrize("ending", ["gpkg", "geojson", "las", "laz", "ply"])
def test_points(ending: str, stated: str, tmp_path: Path) -> None:
    points = SurfacePoints(np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]), sigma_m=0.1, crs=stated)
    points.write(tmp_path / f"a.{ending}")
    back = SurfacePoints.read(tmp_path / f"a.{ending}")
    assert_same(back.crs, stated)
    np.testing.assert_allclose(back.xyz, points.xyz, atol=1e-6)


def assert_same(crs: CRS, stated: str) -> None:
    assert equal_crs(crs, CRS(stated)), crs.to_wkt()
