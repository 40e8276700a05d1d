"""Ground under what overhangs it, against every pair of points."""

import numpy as np
import pytest

from survey.core.errors import CapacityError
from survey.reconstruction.line_of_sight.returns import ground


def street() -> tuple[np.ndarray, np.ndarray]:
    """Return a rough slope with a crown over it, a cable, and a wall, and which of the points are ground."""
    rng = np.random.default_rng(3)
    xy = rng.uniform(-10.0, 10.0, (4000, 2))
    # Nothing is seen at the sensor's feet, and the crown is right above.
    xy = xy[np.hypot(*xy.T) > 2.5]
    slope = np.column_stack([xy, 0.15 * xy[:, 0] + 0.03 * rng.standard_normal(len(xy))])
    around = rng.uniform(-2.0, 2.0, (500, 2))
    crown = np.column_stack([around, rng.uniform(4.0, 7.0, 500)])
    cable = np.column_stack([np.linspace(-10.0, 10.0, 200), np.full(200, 5.0), np.full(200, 6.0)])
    wall = np.column_stack([np.full(300, 9.0), rng.uniform(-9.0, 9.0, 300), rng.uniform(2.0, 8.0, 300)])
    xyz = np.concatenate([slope, crown, cable, wall])
    return xyz, np.arange(len(xyz)) < len(slope)


def test_crown_cable_and_wall_are_no_ground() -> None:
    xyz, is_ground = street()
    np.testing.assert_array_equal(ground(xyz), is_ground)


def test_it_agrees_with_all_pairs_of_points() -> None:
    rng = np.random.default_rng(4)
    xyz = rng.uniform(0.0, 1.0, (400, 3)) * (8.0, 8.0, 3.0)
    away = np.hypot(*(xyz[:, None, :2] - xyz[None, :, :2]).transpose(2, 0, 1))

    def below(slope: float, shift_m: float) -> np.ndarray:
        cones: np.ndarray = (xyz[:, 2] + slope * np.maximum(away + shift_m, 0.0)).min(axis=1)
        return xyz[:, 2] <= cones + 0.3

    found = ground(xyz)
    # Cells put points up to 0.36 m too near or too far, eight directions make ways up to 8 % longer.
    assert found[below(1.2, -0.36)].all()
    assert not found[~below(1.3, 0.36)].any()


def test_points_from_another_country_are_refused() -> None:
    with pytest.raises(CapacityError, match="far from the others"):
        ground(np.array([[0.0, 0.0, 0.0], [1e5, 1e5, 0.0]]))
