"""Linear interpolation in triangles: exact on planes, silent outside the hull."""

import numpy as np
import pytest

from survey.core.errors import InputError
from survey.data.grid import Grid
from survey.data.surface_points import SurfacePoints
from survey.reconstruction.terrain_map import INTERPOLATED, MEASURED, UNSEEN
from survey.reconstruction.triangulation import triangulate

CRS = "EPSG:32608"
GRID = Grid((500_000.0, 6_500_000.0, 500_010.0, 6_500_010.0), 1.0, CRS)


def _points(xy: object, z: object, sigma: object = 0.1) -> SurfacePoints:
    places = np.asarray(xy, dtype=float) + np.array(GRID.bounds[:2])
    return SurfacePoints(np.column_stack([places, z]), sigma_m=sigma, crs=CRS)


def test_a_plane_is_exact_inside_and_unknown_outside() -> None:
    rng = np.random.default_rng(1)
    xy = rng.uniform(2.0, 8.0, (40, 2))
    result = triangulate(_points(xy, 0.5 * xy[:, 0] - 0.2 * xy[:, 1]), GRID)
    east, north = np.meshgrid(GRID.x - GRID.bounds[0], GRID.y - GRID.bounds[1])
    plane = 0.5 * east - 0.2 * north
    known = np.isfinite(result.mean.elevation)
    assert known[5, 5]
    assert not known[0].any()
    # Coordinates of 6.5e6 m leave 1e-9 m of rounding.
    np.testing.assert_allclose(result.mean.elevation[known], plane[known], atol=1e-7)
    assert (result.support[~known] == UNSEEN).all()
    assert set(np.unique(result.support[known])) <= {INTERPOLATED, MEASURED}


def test_the_standard_deviation_is_carried_from_the_corners() -> None:
    result = triangulate(_points([[0, 0], [10, 0], [0, 10]], [0.0, 0.0, 0.0], [0.3, 0.4, 0.5]), GRID)
    std = result.std.elevation
    assert std[10, 0] == pytest.approx(0.3)
    assert std[10, 5] == pytest.approx(np.hypot(0.5 * 0.3, 0.5 * 0.4))


def test_measurements_of_one_place_are_averaged_by_weight() -> None:
    points = _points([[0, 0], [0, 0], [10, 0], [0, 10]], [1.0, 4.0, 0.0, 0.0], [1.0, 0.5, 1.0, 1.0])
    result = triangulate(points, GRID)
    assert result.mean.elevation[10, 0] == pytest.approx((1.0 + 4.0 * 4.0) / 5.0)
    assert result.std.elevation[10, 0] == pytest.approx(np.sqrt(1.0 / 5.0))


@pytest.mark.parametrize(
    ("xy", "word"),
    [
        ([[0, 0], [5, 5]], "at least 3"),
        ([[0, 0], [0, 0], [5, 5]], "at least 3"),
        ([[0, 0], [5, 5], [10, 10]], "one line"),
        ([[0, 0], [500, 0.1], [1000, 0]], "one line"),
        ([[900, 900], [910, 900], [900, 910]], "no node"),
    ],
)
def test_points_that_span_nothing_here_are_refused(xy: list[list[float]], word: str) -> None:
    with pytest.raises(InputError, match=word):
        triangulate(_points(xy, np.zeros(len(xy))), GRID)
