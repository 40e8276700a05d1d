"""One scene has the same lengths and areas on the ground in every CRS."""

import numpy as np
import pytest
import shapely
from pyproj import Geod, Transformer

from survey.core.map_scale import (
    areal_factors,
    ground_area_m2,
    ground_length_m,
    ground_lengths_m,
    scale_factors,
)

LATITUDE = 61.0
SCENES = ("EPSG:3857", "EPSG:3413", "EPSG:32610")


def test_lengths_are_those_of_geodesics() -> None:
    route = np.array([[640_000.0, 5.600e6], [642_000.0, 5.603e6], [650_000.0, 5.600e6]])
    lon, lat = Transformer.from_crs("EPSG:32610", "EPSG:4326", always_xy=True).transform(*route.T)
    expected = Geod(ellps="WGS84").line_lengths(lon, lat)
    assert ground_lengths_m("EPSG:32610", route) == pytest.approx(expected, rel=1e-7)
    assert ground_lengths_m("EPSG:32610", route[:1]).shape == (0,)


def test_a_length_on_the_ground_does_not_depend_on_the_crs() -> None:
    lon_lat = np.array([[-123.4, LATITUDE], [-123.39, LATITUDE + 0.01], [-123.3, LATITUDE]])
    lengths = [ground_length_m(crs, _moved(lon_lat, crs)) for crs in SCENES]
    assert np.ptp(lengths) < 1e-5 * lengths[0]


def test_a_length_in_the_antarctic_does_not_depend_on_the_crs() -> None:
    lon_lat = np.array([[-62.0, -64.5], [-61.95, -64.5], [-61.95, -64.45]])
    lengths = [ground_length_m(crs, _moved(lon_lat, crs)) for crs in ("EPSG:3031", "EPSG:32720", "EPSG:3857")]
    assert np.ptp(lengths) < 1e-5 * lengths[0]


@pytest.mark.parametrize("crs", [*SCENES, "EPSG:3995"])
def test_areas_are_those_of_the_ellipsoid(crs: str) -> None:
    corners = np.array([[-123.4, 61.0], [-123.2, 61.0], [-123.2, 61.1], [-123.4, 61.1]])
    ring = shapely.segmentize(shapely.Polygon(corners), 0.002)
    hole = shapely.segmentize(shapely.Polygon(corners * 0.4 + corners.mean(axis=0) * 0.6), 0.002)
    lake = shapely.Polygon(ring.exterior.coords, [hole.exterior.coords])
    area = sum(
        sign * abs(Geod(ellps="WGS84").polygon_area_perimeter(*part.exterior.xy)[0])
        for part, sign in ((ring, 1.0), (hole, -1.0))
    )
    moved = shapely.transform(lake, lambda xy: _moved(xy, crs))
    assert ground_area_m2(crs, moved) == pytest.approx(area, rel=3e-5)


def test_factors_of_a_large_raster_are_interpolated_closely() -> None:
    x, y = np.linspace(-4e5, 4e5, 201), np.linspace(-1.0e6, -2.0e6, 151)
    found = areal_factors("EPSG:3413", x, y)
    exact = scale_factors("EPSG:3413", np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)).areal.reshape(
        found.shape
    )
    assert np.abs(found / exact - 1.0).max() < 2e-6


def _moved(lon_lat: np.ndarray, crs: str) -> np.ndarray:
    to_crs = Transformer.from_crs("EPSG:4326", crs, always_xy=True)
    return np.column_stack(to_crs.transform(*np.asarray(lon_lat).T))
