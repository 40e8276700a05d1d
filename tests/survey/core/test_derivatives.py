"""Derivatives of projections against distances over the ellipsoid."""

import numpy as np
import pytest
from pyproj import CRS, Transformer

from survey.core.errors import InputError
from survey.core.map_scale import ground_jacobian


def test_the_central_meridian_of_a_utm_zone_has_the_scale_of_its_definition() -> None:
    (jacobian,) = ground_jacobian("EPSG:32608", (500_000.0, 6_500_000.0))
    np.testing.assert_allclose(jacobian, np.eye(2) / 0.9996, atol=1e-8)


@pytest.mark.parametrize("crs", ["EPSG:32608", "EPSG:3413", "EPSG:31287"])
def test_a_step_on_the_map_is_as_long_as_over_the_ellipsoid(crs: str, rng: np.random.Generator) -> None:
    projected = CRS.from_user_input(crs)
    origin = {"EPSG:32608": (620_000.0, 6_700_000.0), "EPSG:3413": (300_000.0, -1_200_000.0)}.get(
        crs, (300_000.0, 350_000.0)
    )
    to_degrees = Transformer.from_crs(projected, projected.geodetic_crs, always_xy=True)
    steps = rng.uniform(-1.0, 1.0, (8, 2))
    places = np.asarray(origin) + rng.uniform(-5e4, 5e4, (8, 2))
    ground = np.hypot(*np.einsum("nij,nj->ni", ground_jacobian(projected, places), steps).T)
    geod = projected.get_geod()
    assert geod is not None
    a, b = to_degrees.transform(*places.T), to_degrees.transform(*(places + steps).T)
    _, _, lengths = geod.inv(*a, *b)
    np.testing.assert_allclose(ground, lengths, rtol=1e-5)


def test_a_local_plan_has_the_scale_of_one() -> None:
    local = CRS.from_wkt('LOCAL_CS["site",UNIT["metre",1],AXIS["X",EAST],AXIS["Y",NORTH]]')
    jacobian = ground_jacobian(local, [[0.0, 0.0], [5.0, 5.0]])
    np.testing.assert_array_equal(jacobian, np.broadcast_to(np.eye(2), (2, 2, 2)))


def test_a_place_that_the_projection_cannot_show_is_refused() -> None:
    with pytest.raises(InputError, match=r"outside what|cannot be computed"):
        ground_jacobian("EPSG:32608", (1e12, 1e12))
