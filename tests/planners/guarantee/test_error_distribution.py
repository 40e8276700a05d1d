import numpy as np
import pytest

from planners.guarantee.error_distribution import ErrorDistribution, ErrorMoments


def test_the_probability_is_that_of_drawn_mean_squares(rng):
    made = ErrorDistribution([ErrorMoments(0.04, 0.0002, 0.7), ErrorMoments(0.09, 0.001, 0.3)], spread=0.3)
    part = rng.random(200_000) < 0.7
    mean, variance = np.where(part, 0.04, 0.09), np.where(part, 0.0002, 0.001)
    squares = rng.gamma(mean**2 / variance, variance / mean)
    errors = np.sqrt(squares) * np.exp(0.3 * rng.standard_t(4.0, 200_000))
    for limit_m in (0.2, 0.3, 0.45):
        assert made.probability(limit_m) == pytest.approx(np.mean(errors <= limit_m), abs=0.01)


def test_the_quantile_is_the_inverse_of_the_probability():
    made = ErrorDistribution([ErrorMoments(0.04, 0.0002, 1.0)], spread=0.3)
    assert made.probability(made.quantile_m(0.95)) == pytest.approx(0.95, abs=1e-9)


def test_a_shared_error_makes_a_limit_less_probable():
    made = ErrorDistribution([ErrorMoments(0.04, 0.0002, 1.0)], spread=0.1)
    shared = made.with_shared(0.1)
    assert shared.probability(0.25) < made.probability(0.25)
    assert shared.parts[0].mean == pytest.approx(0.05)


def test_a_larger_spread_makes_a_likely_limit_less_probable():
    parts = [ErrorMoments(0.04, 0.0002, 1.0)]
    found = [ErrorDistribution(parts, spread).probability(0.35) for spread in (0.0, 0.1, 0.2, 0.4, 0.8)]
    assert found == sorted(found, reverse=True)
    assert found[0] > 0.99


def test_heavy_tails_bring_ground_of_another_kind_into_high_probabilities():
    made = ErrorDistribution([ErrorMoments(0.04, 2e-5, 1.0)], spread=0.3)
    ratio = {p: made.quantile_m(p) / made.quantile_m(0.5) for p in (0.9, 0.95, 0.99)}
    # Student's quantiles for four degrees of freedom are 1.53, 2.13 and 3.75.
    assert ratio[0.9] == pytest.approx(np.exp(0.3 * 1.53), rel=0.05)
    assert ratio[0.95] == pytest.approx(np.exp(0.3 * 2.13), rel=0.05)
    assert ratio[0.99] == pytest.approx(np.exp(0.3 * 3.75), rel=0.05)
