"""Steep ground from bounds alone: always right where the bounds hold, and found where no point was."""

import numpy as np
import pytest

from survey.core.errors import InputError
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.reconstruction.hazards import steep_chords, steep_ground
from survey.reconstruction.terrain_map import Reconstruction

STEP_M = 0.25
GRID = Grid((0.0, 0.0, 10.0, 10.0), STEP_M)


def test_where_the_bounds_hold_no_gentle_ground_is_marked() -> None:
    """Beside a marked node, or at it, the ground rises as steeply as the limit (the mean value theorem)."""
    rng = np.random.default_rng(8)
    ground = np.cumsum(rng.normal(0.0, 0.12, GRID.shape), axis=0)
    lower = ground - rng.uniform(0.0, 0.15, GRID.shape)
    upper = ground + rng.uniform(0.0, 0.15, GRID.shape)
    marked = steep_chords(lower, upper, STEP_M, 30.0, 2.0 * STEP_M)
    rise = np.tan(np.radians(30.0))
    steep = np.zeros(GRID.shape, dtype=bool)
    for north, east in ((0, 1), (1, 0), (1, 1), (1, -1)):
        there = np.roll(ground, (-north, -east), (0, 1))
        here = np.abs(there - ground) > rise * STEP_M * np.hypot(north, east)
        steep |= here | np.roll(here, (north, east), (0, 1))
    # Chords of one step mark both their ends, chords of two the node between.
    assert marked.mean() > 0.1
    assert steep[marked].mean() == 1.0


def reconstruction(lower: float, upper: float) -> Reconstruction:
    level = Dem.on(GRID, np.zeros(GRID.shape))
    low, high = (Dem.on(GRID, np.full(GRID.shape, z)) for z in (lower, upper))
    return Reconstruction(level, level, np.ones(GRID.shape, dtype=int), "field", {}, low, high)


def test_wide_bounds_mark_nothing() -> None:
    assert (steep_ground(reconstruction(-3.0, 3.0), 10.0).elevation == 0.0).all()


def test_a_map_without_bounds_and_a_limit_that_is_no_slope_are_refused() -> None:
    level = Dem.on(GRID, np.zeros(GRID.shape))
    with pytest.raises(InputError, match="has no bounds of its own"):
        steep_ground(Reconstruction(level, level, np.ones(GRID.shape, dtype=int), "tin", {}), 20.0)
    with pytest.raises(InputError, match="is no limit to stay below"):
        steep_ground(reconstruction(-1.0, 1.0), 90.0)
