from dataclasses import replace
from datetime import date

import pytest

from planners.season import SeasonConfig, design_season
from tests.planners.guarantee.smooth_site import AREA, coarse, smooth_terrain

CONFIG = SeasonConfig(
    0.4, "m w.e.", date(2026, 5, 1), date(2026, 9, 18), surface="bare-ice", max_swaths=6, km_a_day=1.0
)


@pytest.fixture(scope="module")
def prior():
    return coarse(smooth_terrain())


def test_the_best_design_has_the_fewest_days_of_those_that_are_enough(prior):
    design = design_season(AREA, prior, CONFIG)
    enough = [one for one in design.options if one.error <= CONFIG.wanted]
    assert design.holds
    assert design.best.n_days == min(one.n_days for one in enough)
    assert len(design.route.swaths) == design.best.n_swaths
    first, second = design.dates(design.best)
    assert (first[1] - first[0]).days == design.best.n_days - 1
    assert first[0] <= CONFIG.first_day <= first[1]
    assert second[0] <= CONFIG.last_day <= second[1]


def test_relief_that_persists_does_not_enter_the_error(prior):
    still = replace(CONFIG, melt_m_we_day=0.0, change_std_m=0.5)
    rough = replace(prior, elevation=4.0 * prior.elevation)
    one, other = (design_season(AREA, dem, still).options for dem in (prior, rough))
    assert [a.error for a in one] == pytest.approx([b.error for b in other])


def test_errors_of_place_count_on_slopes(prior):
    placed = design_season(AREA, prior, replace(CONFIG, localization_m=2.0)).options
    for one, other in zip(design_season(AREA, prior, CONFIG).options, placed, strict=False):
        assert other.budget.samples_m > one.budget.samples_m


def test_an_error_below_that_of_the_density_cannot_be_reached(prior):
    design = design_season(AREA, prior, replace(CONFIG, wanted=0.1))
    assert not design.holds
    assert design.best.error == min(one.error for one in design.options)
    assert max(design.best.budget) == design.best.budget.density_m_we
