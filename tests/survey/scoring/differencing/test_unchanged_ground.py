"""Unchanged ground: blunders are left out by robust deviations, and too little of it is refused."""

import numpy as np
import pytest
import shapely

from survey import Grid, InputError
from survey.scoring.differencing.volume_change import ComparedGround, remove_blunders

GRID = Grid((0.0, 0.0, 190.0, 190.0), 10.0, "EPSG:32608")


def test_blunders_of_the_unchanged_ground_are_left_out_and_nothing_else() -> None:
    rng = np.random.default_rng(1)
    difference = 2.0 + 0.1 * rng.uniform(-1.0, 1.0, (20, 20))
    stable = np.ones((20, 20), dtype=bool)
    stable[:5] = False
    difference[10, 10], difference[2, 2] = 9.0, -9.0
    calm = remove_blunders(difference, stable)
    stable[10, 10] = False
    np.testing.assert_array_equal(calm, stable)


def test_less_than_a_hundred_cells_are_refused() -> None:
    few = np.zeros((20, 20), dtype=bool)
    few[:4, :20] = True
    with pytest.raises(InputError, match="80 cells of unchanged ground; 100 are needed"):
        remove_blunders(np.zeros((20, 20)), few)


def test_ground_outside_all_outlines_is_unchanged_unless_a_part_is_named() -> None:
    ice, rock = shapely.box(45.0, 45.0, 105.0, 105.0), shapely.box(-5.0, -5.0, 195.0, 45.0)
    everywhere = ComparedGround.of(GRID, {"ice": ice}, None)
    assert everywhere.inside[0].sum() == 36
    assert everywhere.stable.sum() == 400 - 36
    assert ComparedGround.of(GRID, {"ice": ice}, rock).stable.sum() == 5 * 20
    with pytest.raises(InputError, match="holds no cell"):
        ComparedGround.of(GRID, {"ice": shapely.box(500.0, 500.0, 510.0, 510.0)}, None)
