from datetime import date

import numpy as np
import pytest

from planners.season import MeanError, SeasonConfig, SurfaceChange, budget_of, kriged_mean, mean_error
from survey import Dem, Grid
from tests.planners.guarantee.smooth_site import CRS, SIDE_M, lines

CONFIG = SeasonConfig(0.2, "m w.e.", date(2026, 5, 1), date(2026, 9, 18), surface="bare-ice")
CHANGE = SurfaceChange(0.8, 60.0)


def drawn(kernel, places, rng, n):
    covariance = kernel.covariance(places, places) + 1e-9 * kernel.variance_m2 * np.eye(len(places))
    return np.linalg.cholesky(covariance) @ rng.standard_normal((len(places), n))


@pytest.mark.parametrize("family", list(CHANGE.families))
def test_the_error_of_the_mean_is_that_of_drawn_pairs_of_surveys(rng, family):
    xy, nodes = lines(3)[::3], rng.uniform(0.0, SIDE_M, (40, 2))
    places, n, n_drawn = np.vstack([xy, nodes]), len(xy), 4000
    change = CHANGE._replace(families={family: 1.0})
    relief_m = 30.0 * np.sin(places[:, :1] / 40.0)
    melted = -3.0 + drawn(change.kernel(family), places, rng, n_drawn)
    both = [relief_m[:n] + moved + 0.1 * rng.standard_normal((n, n_drawn)) for moved in (0.0, melted[:n])]
    weights, _ = kriged_mean(xy, nodes, change.kernel(family), 0.1 * np.sqrt(2.0))
    actual_m = np.std(weights @ (both[1] - both[0]) - melted[n:].mean(axis=0))
    found = mean_error(xy, nodes, change, 0.1 * np.sqrt(2.0))
    assert np.hypot(found.interpolation_m, found.samples_m) == pytest.approx(actual_m, rel=0.05)
    assert found.families == {family: pytest.approx(found.interpolation_m)}


def test_the_roughest_family_does_not_decide_alone():
    nodes = lines(7)[::4]
    found = mean_error(lines(5), nodes, CHANGE._replace(half_m=200.0), 0.1)
    by_family = found.families
    assert by_family["matern-3/2"] < found.interpolation_m < by_family["whittle"]
    logs = [weight * np.log(by_family[name]) for name, weight in CHANGE.families.items()]
    assert found.interpolation_m == pytest.approx(np.exp(sum(logs)))
    halves = [CHANGE.kernel(name).covariance_of_lag(np.array([60.0, 0.0])) for name in CHANGE.families]
    assert halves == pytest.approx([0.32, 0.32])


def test_lines_that_lie_lower_than_the_area_miss_the_gradient_with_height():
    grid = Grid((-50.0, -50.0, 350.0, 350.0), 10.0, CRS)
    prior = Dem.on(grid, np.repeat(0.2 * grid.y[:, None], len(grid.x), axis=1))
    nodes, low = lines(7)[::4], lines(7)[lines(7)[:, 1] < 0.5 * SIDE_M]
    change = CHANGE._replace(gradient=0.01)
    weights, _ = kriged_mean(low, nodes, change.kernel("matern-3/2"), 0.1)
    single = change._replace(families={"matern-3/2": 1.0})
    uneven_m = 0.2 * abs(float(weights @ low[:, 1]) - nodes[:, 1].mean())
    assert mean_error(low, nodes, single, 0.1, prior).gradient_m == pytest.approx(0.01 * uneven_m)
    assert mean_error(lines(7), nodes, change, 0.1, prior).gradient_m < 0.05 * 0.01 * uneven_m


def test_more_swaths_and_more_stakes_lower_the_error():
    nodes = lines(7)[::4]
    found = [mean_error(lines(n), nodes, CHANGE, 0.1) for n in (2, 4, 8)]
    assert [one[:3] for one in found] == sorted((one[:3] for one in found), reverse=True)
    errors = [budget_of(CONFIG, found[0], n_stakes, 3).error(CONFIG) for n_stakes in (0, 2, 5, 20)]
    assert errors == sorted(errors, reverse=True)


def test_the_parts_follow_from_melt_flow_and_density():
    exact = MeanError(0.0, 0.0, 0.0, {})
    budget = budget_of(CONFIG, exact, 0, 12.0)
    # 140 days of 0.04 m w.e., 900 ± 20 kg/m³; two surveys of 12 days, melt known to 30 %.
    assert budget.density_m_we == pytest.approx(0.02 * 140 * 0.04 / 0.9)
    assert budget.duration_m == pytest.approx(np.sqrt(2.0) * 0.3 * 0.04 / 0.9 * np.sqrt(12.0))
    assert budget.flow_m == 0.0
    assert budget.shared_m == pytest.approx(np.sqrt(2.0) * 0.05)
    part = SeasonConfig(5.0, "%", CONFIG.first_day, CONFIG.last_day, surface="bare-ice", emergence_m_year=1.0)
    flow = budget_of(part, exact, 0, 1.0)
    assert flow.flow_m == pytest.approx(140 / 365.25)
    assert flow.error(part) == pytest.approx(100 * 1.96 * flow.height_m / (140 * 0.04 / 0.9))


def test_the_change_follows_from_the_melt():
    # 6.2 m of ice, of which 15 % vary, and 6.5 °C of 5 °C are lost with each kilometre.
    assert CONFIG.change.std_m == pytest.approx(0.15 * 140 * 0.04 / 0.9)
    assert CONFIG.change.gradient == pytest.approx(140 * 0.04 / 0.9 * 0.0013)
    assert CONFIG.change.redrawn_m == 0.3
