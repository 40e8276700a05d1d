"""Scale factors agree with the formulas of the projections."""

import numpy as np
import pytest
from pyproj import CRS, Geod, Proj, Transformer

from survey.core.errors import InputError
from survey.core.map_scale import MapScale, scale_factors

LATITUDE = 61.0


def _projected(crs: str, lon: float, lat: float) -> np.ndarray:
    to_crs = Transformer.from_crs(CRS(crs).geodetic_crs, CRS(crs), always_xy=True)
    return np.array([to_crs.transform(lon, lat)])


@pytest.mark.parametrize("lat", [-75.0, -30.0, 0.0, 45.0, LATITUDE, 80.0])
def test_mercator_has_the_scale_of_its_formula(lat: float) -> None:
    crs = "EPSG:3395"  # World Mercator on the ellipsoid
    found = scale_factors(crs, _projected(crs, 12.0, lat))
    squared = CRS(crs).geodetic_crs.get_geod().es  # type: ignore[union-attr]
    sine = np.sin(np.deg2rad(lat))
    expected = np.sqrt(1.0 - squared * sine**2) / np.cos(np.deg2rad(lat))
    assert found.meridional[0] == pytest.approx(expected, rel=1e-8)
    assert found.parallel[0] == pytest.approx(expected, rel=1e-8)
    assert found.areal[0] == pytest.approx(expected**2, rel=1e-8)


def test_mercator_on_a_sphere_has_the_secant_of_the_latitude() -> None:
    crs = "+proj=merc +R=6371000 +units=m"
    found = scale_factors(crs, _projected(crs, 3.0, LATITUDE))
    assert found.linear[0] == pytest.approx(1.0 / np.cos(np.deg2rad(LATITUDE)), rel=1e-8)


@pytest.mark.parametrize("lat", [5.0, 60.0, 84.0])
def test_utm_has_0_9996_on_its_central_meridian(lat: float) -> None:
    found = scale_factors("EPSG:32610", _projected("EPSG:32610", -123.0, lat))
    assert found.linear[0] == pytest.approx(0.9996, abs=1e-9)


def test_polar_stereographic_is_true_at_its_standard_parallel() -> None:
    found = scale_factors("EPSG:3413", _projected("EPSG:3413", -45.0, 70.0))
    assert found.linear[0] == pytest.approx(1.0, abs=1e-8)
    south = scale_factors("EPSG:3031", _projected("EPSG:3031", 10.0, -71.0))
    assert south.linear[0] == pytest.approx(1.0, abs=1e-8)


def test_the_pole_itself_has_the_scale_of_its_neighbours() -> None:
    at_pole, beside = scale_factors("EPSG:3031", [[0.0, 0.0], [500.0, 0.0]]).linear
    assert at_pole == pytest.approx(beside, rel=1e-7)
    assert at_pole == pytest.approx(0.97276901, abs=1e-7)


@pytest.mark.parametrize("crs", ["EPSG:32610", "EPSG:3413", "EPSG:3035", "EPSG:2154", "EPSG:3395"])
def test_factors_agree_with_proj(crs: str) -> None:
    place = _projected(crs, -120.0 if crs in ("EPSG:32610", "EPSG:3413", "EPSG:3395") else 8.0, 55.0)
    lon, lat = Transformer.from_crs(CRS(crs), CRS(crs).geodetic_crs, always_xy=True).transform(*place.T)
    proj = Proj(CRS(crs)).get_factors(lon, lat)
    found = scale_factors(crs, place)
    for name in ("meridional", "parallel", "areal"):
        measured, expected = getattr(found, name), getattr(proj, f"{name}_scale")
        assert measured == pytest.approx(np.asarray(expected), rel=2e-7), name


def test_an_equal_area_projection_has_an_areal_factor_of_one() -> None:
    found = scale_factors("EPSG:3035", _projected("EPSG:3035", 30.0, 65.0))
    assert found.areal[0] == pytest.approx(1.0, rel=1e-8)
    assert found.least[0] < 0.995
    assert found.largest[0] > 1.005


def test_web_mercator_is_measured_on_the_ellipsoid() -> None:
    place = _projected("EPSG:3857", -123.0, LATITUDE)
    found = scale_factors("EPSG:3857", place)
    assert found.parallel[0] != pytest.approx(1.0 / np.cos(np.deg2rad(LATITUDE)), rel=1e-3)
    lon, lat = Transformer.from_crs("EPSG:3857", "EPSG:4326", always_xy=True).transform(
        *(place + [[-50.0, 0.0], [50.0, 0.0]]).T
    )
    ground_m = Geod(ellps="WGS84").inv(lon[0], lat[0], lon[1], lat[1])[2]
    assert 100.0 / found.parallel[0] == pytest.approx(ground_m, rel=1e-8)


@pytest.mark.parametrize(
    "crs",
    [
        "EPSG:32610+5773",
        CRS("EPSG:32610").to_3d(),
        CRS("EPSG:32610").to_wkt("WKT1_GDAL"),
        CRS("+proj=utm +zone=10 +ellps=WGS84 +towgs84=0,0,0 +units=m +type=crs"),
    ],
    ids=["compound", "3-D", "WKT 1", "bound"],
)
def test_every_form_of_a_crs_has_the_same_scale(crs: object) -> None:
    place = [[650_000.0, 5_600_000.0]]
    expected = scale_factors("EPSG:32610", place).areal
    assert scale_factors(crs, place).areal == pytest.approx(expected, rel=1e-9)


def test_easting_comes_first_whatever_the_axis_order() -> None:
    crs = "EPSG:31467"  # Gauss-Krüger zone 3: northing is its first axis
    found = scale_factors(crs, [[3_500_000.0, 5_400_000.0]])
    assert found.linear[0] == pytest.approx(1.0, abs=1e-8)


def test_a_local_crs_has_the_scale_one() -> None:
    local = 'LOCAL_CS["site",UNIT["metre",1],AXIS["x",EAST],AXIS["y",NORTH]]'
    assert scale_factors(local, [[5.0, 7.0]]).linear.tolist() == [1.0]
    assert MapScale.over(local, (0.0, 0.0, 10.0, 10.0)).warning == ""


def test_a_place_that_the_projection_cannot_show_is_refused() -> None:
    with pytest.raises(InputError, match="a place lies outside what WGS 84 / UTM zone 10N can show"):
        scale_factors("EPSG:32610", [[0.0, 5e6], [1e12, 1e12]])


def test_a_warning_names_the_crs_and_the_factor() -> None:
    place = _projected("EPSG:3857", -123.0, LATITUDE)
    scale = MapScale.at("EPSG:3857", place)
    assert "WGS 84 / Pseudo-Mercator are 2.0" in scale.warning
    assert scale.to_dict()["areal"]["mean"] == pytest.approx(4.23, abs=0.03)


def test_the_range_over_a_rectangle_includes_its_corners() -> None:
    bounds = (0.0, -2.2e6, 1e5, -2.0e6)
    scale = MapScale.over("EPSG:3413", bounds)
    corners = scale_factors("EPSG:3413", [[0.0, -2.2e6], [1e5, -2.2e6], [0.0, -2.0e6], [1e5, -2.0e6]]).linear
    assert (scale.linear.min, scale.linear.max) == pytest.approx((corners.min(), corners.max()), abs=1e-6)
    assert scale.linear.min < scale.linear.mean < scale.linear.max


def test_a_factor_within_one_percent_is_not_notable() -> None:
    assert MapScale.over("EPSG:32608", (0.0, 0.0, 600.0, 600.0)).notable_factor == 1.0
    assert MapScale.over("EPSG:3857", (0.0, 8.5e6, 600.0, 8.5006e6)).notable_factor == pytest.approx(
        2.01, abs=0.02
    )
