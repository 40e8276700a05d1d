from datetime import date

import numpy as np
import pytest

from planners.prediction.kernel_posterior import KernelPosterior
from planners.season import SeasonConfig, budget_of, mean_error_m
from tests.planners.guarantee.smooth_site import SIDE_M, SMOOTH, lines

CONFIG = SeasonConfig(0.2, "m w.e.", date(2026, 5, 1), date(2026, 9, 18), surface="bare-ice")


def test_the_error_of_the_mean_is_that_of_drawn_surfaces(rng):
    xy, nodes = lines(3)[::3], rng.uniform(0.0, SIDE_M, (40, 2))
    places, n = np.vstack([xy, nodes]), len(xy)
    covariance = SMOOTH.kernel.covariance(places, places) + 1e-6 * np.eye(len(places))
    drawn = np.linalg.cholesky(covariance) @ rng.standard_normal((len(places), 4000))
    measured = drawn[:n] + SMOOTH.noise_m * rng.standard_normal((n, 4000))
    inverse = np.linalg.inv(covariance[:n, :n] + SMOOTH.noise_m**2 * np.eye(n))
    mean = inverse.sum(axis=0) @ measured / inverse.sum()
    found = mean + covariance[n:, :n].mean(axis=0) @ inverse @ (measured - mean)
    actual = np.std(found - drawn[n:].mean(axis=0))
    assert mean_error_m(xy, nodes, KernelPosterior((SMOOTH,))) == pytest.approx(actual, rel=0.08)


def test_more_swaths_and_more_stakes_lower_the_error():
    posterior, nodes = KernelPosterior((SMOOTH,)), lines(7)[::4]
    errors_m = [mean_error_m(lines(n), nodes, posterior) for n in (2, 4, 8)]
    assert errors_m == sorted(errors_m, reverse=True)
    found = [budget_of(CONFIG, errors_m[0], n_stakes, 3).error(CONFIG) for n_stakes in (0, 2, 5, 20)]
    assert found == sorted(found, reverse=True)


def test_the_parts_follow_from_melt_flow_and_density():
    budget = budget_of(CONFIG, 0.0, 0, 12.0)
    # 140 days of 0.04 m w.e., 900 ± 20 kg/m³; two surveys of 12 days, melt known to 30 %.
    assert budget.density_m_we == pytest.approx(0.02 * 140 * 0.04 / 0.9)
    assert budget.duration_m == pytest.approx(np.sqrt(2.0) * 0.3 * 0.04 / 0.9 * np.sqrt(12.0))
    assert budget.flow_m == 0.0
    assert budget.shared_m == pytest.approx(np.sqrt(2.0) * 0.05)
    part = SeasonConfig(5.0, "%", CONFIG.first_day, CONFIG.last_day, surface="bare-ice", emergence_m_year=1.0)
    flow = budget_of(part, 0.0, 0, 1.0)
    assert flow.flow_m == pytest.approx(140 / 365.25)
    assert flow.error(part) == pytest.approx(100 * 1.96 * flow.height_m / (140 * 0.04 / 0.9))
