from dataclasses import replace

import numpy as np
import pytest

from planners.guarantee.guarantee import guarantee
from planners.guarantee.requirement import MapRequirement
from survey import Dem, Grid
from survey.core.errors import InputError
from tests.planners.guarantee.smooth_site import AREA, CRS, SIDE_M, coarse, smooth_terrain


def test_a_guarantee_holds_on_simulated_terrain_and_states_its_assumptions():
    wanted = MapRequirement(0.4572, noise_m=0.1, n_simulations=30, prior_sigma_m=0.5)
    made = guarantee(AREA, coarse(smooth_terrain()), wanted)
    assert made.holds
    assert made.simulated_share >= 0.9
    assert made.reachable_m <= 0.4572
    assert "length scale" in made.assumptions
    assert "surface unknown" in made.assumptions
    stated = guarantee(AREA, coarse(smooth_terrain()), replace(wanted, assumed="squared-exponential"))
    assert stated.holds
    assert stated.config.swaths <= made.config.swaths
    assert "as stated" in stated.assumptions


def test_guaranteed_swaths_run_across_a_marked_grain():
    grid = Grid((0.0, 0.0, SIDE_M, SIDE_M), 50.0, CRS)
    ridges = Dem.on(grid, np.outer(5.0 * np.sin(np.arange(7.0)), np.ones(7)))
    made = guarantee(AREA, ridges, MapRequirement(1.0, noise_m=0.1, n_simulations=10, prior_sigma_m=0.5))
    for swath in made.route.swaths:
        (east, north) = np.abs(swath.axis[1] - swath.axis[0])
        assert east < 1e-9
        assert north > 150.0


def test_a_prior_that_is_too_coarse_is_refused():
    cells = Dem.on(Grid((75.0, 75.0, 225.0, 225.0), 150.0, CRS), np.zeros((2, 2)))
    with pytest.raises(InputError, match="4 known cells"):
        guarantee(AREA, cells, MapRequirement(0.4572))
