import numpy as np
import pytest

from survey import Dem, Grid
from survey.reconstruction.motion.epoch import MapAge
from survey.reconstruction.motion.priors import uniform_motion


def plane(slope: float) -> Dem:
    grid = Grid((0.0, 0.0, 100.0, 100.0), 5.0, "EPSG:32608")
    return Dem.on(grid, slope * np.tile(grid.x, (len(grid.y), 1)))


def age(slope: float, velocity_sigma: float = 0.0) -> MapAge:
    motion = uniform_motion((2.0, 0.0), 0.1, velocity_sigma=velocity_sigma, lowering_sigma=0.0, epoch_s=50.0)
    mean = plane(slope)
    return MapAge.of(mean, Dem.on(mean.grid(), np.full(mean.shape, 0.3)), motion)


def test_a_slope_that_moves_on_changes_the_height_at_fixed_places():
    # 0.2 of slope by 2 m a day, and 0.1 m of lowering.
    assert age(0.2).growth_m_per_day == pytest.approx(0.5)
    assert age(0.2).hours_within(0.5) == pytest.approx(24.0 * 0.4 / 0.5)


def test_an_uncertain_velocity_ages_the_map_sooner():
    assert age(0.2, velocity_sigma=1.0).growth_m_per_day == pytest.approx(np.hypot(0.5, 0.2))


def test_a_map_beyond_the_limit_at_its_epoch_has_no_time():
    assert age(0.2).hours_within(0.25) == 0.0


def test_recorded_numbers_read_back_equal():
    assert MapAge.from_facts(age(0.1).facts()) == age(0.1)
