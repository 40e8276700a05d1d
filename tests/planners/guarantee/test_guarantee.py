from dataclasses import replace

import numpy as np
import pytest

import planners
from firnline.actions.guaranteeing import reachable_lines, refusal_text
from planners.guarantee.guarantee import SwathSearch, guarantee
from planners.guarantee.requirement import MapRequirement
from survey import Dem, Grid
from survey.core.errors import InputError
from survey.core.streams import stream
from survey.terrain import random_dem
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


def test_a_plan_of_the_guaranteed_route_predicts_the_same_error():
    prior, wanted = coarse(smooth_terrain()), MapRequirement(0.4572, n_simulations=10, max_swaths=8)
    made = guarantee(AREA, prior, wanted)
    model = planners.prior_model(prior, AREA, wanted)
    planned = planners.plan(AREA, prior, made.config, model=model).prediction
    assert planned["rmse_m"] == pytest.approx(made.predicted.rmse_m, rel=1e-9)
    assert planned["rmse_low_m"] < planned["rmse_m"] < planned["rmse_high_m"]
    one = next(option for option in made.options if option.swaths == made.config.swaths)
    assert (one.rmse_m, one.low_m, one.high_m) == pytest.approx(
        [planned[name] for name in ("rmse_m", "rmse_low_m", "rmse_high_m")], rel=1e-9
    )
    assert made.level_m == planned["prior_level_m"]
    for name, held in one.by_level.items():
        assert held.rmse_m == pytest.approx(planned[f"rmse_{name}_level_m"], rel=1e-9)
    assert one.prior_level_share == pytest.approx(planned["prior_level_share"], rel=1e-9)
    errors, chances = np.array([(each.rmse_m, each.probability) for each in made.options]).T
    assert (np.diff(errors) < 0.0).all()
    assert (np.diff(chances) >= 0.0).all()
    assert all(
        each.with_stakes >= each.probability > each.by_level["prior"].probability for each in made.options
    )


@pytest.mark.long
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


def test_a_harder_requirement_never_takes_fewer_swaths():
    prior = coarse(smooth_terrain())
    easy = MapRequirement(0.6, 0.8, noise_m=0.1, prior_sigma_m=0.5, max_swaths=12)
    harder = [
        replace(easy, limit_m=0.3),
        replace(easy, probability=0.97),
        replace(easy, prior_sigma_m=10.0),
        replace(easy, noise_m=0.3),
    ]
    few, *many = (_fewest(prior, one) for one in (easy, *harder))
    assert all(n >= few for n in many)


def test_the_error_that_can_be_reached_does_not_depend_on_the_limit():
    prior, wanted = coarse(smooth_terrain()), MapRequirement(0.05, n_simulations=10, max_swaths=6)
    strict, loose = (guarantee(AREA, prior, replace(wanted, limit_m=limit_m)) for limit_m in (0.05, 3.0))
    assert not strict.holds
    assert any("5 lines" in line for line in reachable_lines(strict))
    assert "instead of --require plans the densest" in refusal_text(strict)
    assert loose.holds
    assert strict.reachable_m == loose.reachable_m


def test_no_more_swaths_than_allowed_are_considered():
    wanted = MapRequirement(0.05, n_simulations=10, max_swaths=5)
    assert guarantee(AREA, coarse(smooth_terrain()), wanted).config.swaths == 5


def test_swaths_are_never_farther_apart_than_five_cells_of_the_prior():
    flat = Dem.on(
        Grid((5.0, 5.0, 295.0, 295.0), 10.0, CRS), np.add.outer(np.arange(30.0), np.arange(30.0) % 3)
    )
    made = guarantee(AREA, flat, MapRequirement(50.0, n_simulations=10))
    assert made.config.swaths >= 6


def test_relief_of_the_prior_contradicts_a_class_that_is_too_smooth():
    rough = random_dem("diamond_square", Grid((0.0, 0.0, SIDE_M, SIDE_M), 5.0, CRS), stream(5), 40.0)
    wanted = MapRequirement(0.05, noise_m=0.1, surface="snow", n_simulations=10, max_swaths=8)
    refused, fitting = (guarantee(AREA, coarse(dem), wanted) for dem in (rough, smooth_terrain()))
    assert not refused.holds
    assert refused.is_contradicted
    assert refused.unstated_m == pytest.approx(0.74, abs=0.2)
    text = refusal_text(refused)
    assert "contradicts surface snow" in text
    assert "leave --surface out" in text
    assert not fitting.is_contradicted
    assert fitting.unstated_m is None


def _fewest(prior, requirement):
    search = SwathSearch.of(AREA, prior, requirement)
    found = [search.fewest(shape) for shape in search.patterns()]
    return min((n for n in found if n is not None), default=np.inf)
