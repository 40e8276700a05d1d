import numpy as np
import pytest

from planners.guarantee.error_distribution import ErrorDistribution, ErrorMoments


def test_the_probability_is_that_of_drawn_mean_squares(rng):
    made = ErrorDistribution([ErrorMoments(0.04, 0.0002, 0.7), ErrorMoments(0.09, 0.001, 0.3)], spread=0.3)
    part = rng.random(200_000) < 0.7
    mean, variance = np.where(part, 0.04, 0.09), np.where(part, 0.0002, 0.001)
    squares = rng.gamma(mean**2 / variance, variance / mean)
    errors = np.sqrt(squares) * np.exp(0.3 * rng.standard_normal(200_000))
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
