"""Lines of sight that make no sense are refused, with the reason."""

import numpy as np
import pytest

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.surface_points import SurfacePoints
from survey.reconstruction.line_of_sight.returns import checked_origins


def scan(z: float | FloatArray, origin: FloatArray | None) -> SurfacePoints:
    x, y = np.meshgrid(np.arange(-5.0, 6.0), np.arange(-5.0, 6.0))
    xyz = np.column_stack([x.ravel(), y.ravel(), np.broadcast_to(z, x.size)])
    origins = None if origin is None else np.broadcast_to(origin, xyz.shape)
    return SurfacePoints(xyz, sigma_m=0.02, origins=origins, crs="EPSG:32608")


def test_sensible_rays_pass_also_to_a_hill_above_the_sensor() -> None:
    height = np.zeros(121)
    height[:40] = 3.0
    points = scan(height, np.array([0.2, 0.1, 2.0]))
    assert np.array_equal(checked_origins(points), points.origins)


@pytest.mark.parametrize(
    ("z", "origin", "said"),
    [
        (0.0, None, "do not say where their sensor stood"),
        (0.0, np.array([1.0, 2.0, 0.0]), "1 points lie where their sensor stood"),
        (5.0, np.array([0.0, 0.0, 2.0]), "121 of 121 points lie above their sensor"),
    ],
)
def test_each_senseless_scan_is_refused(z: float, origin: FloatArray | None, said: str) -> None:
    with pytest.raises(InputError, match=said):
        checked_origins(scan(z, origin))


def test_a_sensor_under_the_ground_beside_it_is_refused() -> None:
    """The valley around it lies lower, so that most points are below the sensor all the same."""
    x = np.meshgrid(np.arange(-5.0, 6.0), np.arange(-5.0, 6.0))[0].ravel()
    points = scan(np.where(x > -2.0, 4.0, -4.0), np.array([5.0, 5.0, 1.0]))
    with pytest.raises(InputError, match=r"1 of 1 sensor places are under the ground, the first at \(5.00"):
        checked_origins(points)
