import numpy as np
import pytest

from planners.prediction.error_distribution import ErrorDistribution, ErrorMoments


def test_the_probability_is_that_of_drawn_mean_squares(rng):
    made = ErrorDistribution([ErrorMoments(0.05, 0.0003, 1.0, noise=0.01)], spread=0.2, open_spread=0.3)
    factors = np.exp(0.2 * rng.standard_t(4.0, 200_000) + 0.3 * rng.standard_normal(200_000))
    shape = 0.05**2 / 0.0003
    errors = np.sqrt(rng.gamma(shape, (0.04 * factors**2 + 0.01) / shape))
    for limit_m in (0.15, 0.22, 0.3, 0.45):
        assert made.probability(limit_m) == pytest.approx(np.mean(errors <= limit_m), abs=0.01)


def test_an_uncertain_roughness_leaves_errors_of_the_noise_alone():
    noise = ErrorDistribution([ErrorMoments(0.04, 2e-5, 1.0, noise=0.04)], spread=0.5)
    terrain = ErrorDistribution([ErrorMoments(0.04, 2e-5, 1.0)], spread=0.5)
    assert noise.quantile_m(0.95) < 0.22
    assert terrain.quantile_m(0.95) > 0.4


def test_ground_lies_between_the_families_of_covariance():
    parts = [ErrorMoments(0.04, 2e-5, 0.7), ErrorMoments(0.16, 3e-4, 0.3)]
    made = ErrorDistribution(parts)
    # The logarithms of 0.2 and 0.4 m with weights of 0.7 and 0.3, as a normal distribution.
    spread = np.log(2.0) * np.sqrt(0.7 * 0.3)
    assert made.quantile_m(0.5) == pytest.approx(0.2 * 2.0**0.3, rel=0.01)
    assert made.quantile_m(0.9) == pytest.approx(0.2 * 2.0**0.3 * np.exp(1.28 * spread), rel=0.02)


def test_the_quantile_is_the_inverse_of_the_probability():
    made = ErrorDistribution([ErrorMoments(0.04, 0.0002, 1.0)], spread=0.3)
    assert made.probability(made.quantile_m(0.95)) == pytest.approx(0.95, abs=1e-9)


def test_a_shared_error_makes_a_limit_less_probable():
    made = ErrorDistribution([ErrorMoments(0.04, 0.0002, 1.0)], spread=0.1)
    shared = made.with_shared(0.1)
    assert shared.probability(0.25) < made.probability(0.25)
    assert shared.rmse_m > made.rmse_m
    assert shared.shared_share == pytest.approx(0.2)


def test_a_level_of_any_size_makes_every_limit_less_probable(rng):
    made = ErrorDistribution([ErrorMoments(0.9, 0.05, 1.0)], spread=0.1)
    levels = made.by_level(1.0)
    factors = np.exp(0.1 * rng.standard_t(4.0, 200_000))
    squared = rng.gamma(0.9**2 / 0.05, factors**2 * 0.05 / 0.9) + np.square(rng.standard_normal(200_000))
    for limit_m in (0.5, 0.8, 1.2, 2.0):
        found = {name: one.probability(limit_m) for name, one in levels.items()}
        assert found["prior"] == pytest.approx(np.mean(squared <= limit_m**2), abs=0.01)
        assert (
            found["prior"]
            <= found["checkpoint"]
            <= found["stake"]
            <= found["benchmark"]
            <= made.probability(limit_m)
        )
    assert levels["prior"].rmse_m == pytest.approx(np.sqrt(squared).mean(), rel=0.05)
    assert levels["stake"].rmse_m == pytest.approx(made.rmse_m, rel=0.01)


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
