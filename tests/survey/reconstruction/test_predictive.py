"""Test of a standard deviation by held-out points, on errors drawn from a known distribution."""

import json

import numpy as np
import pytest

from survey.reconstruction.checks import HeldOut, HeldOutGroups, PredictiveCheck, PredictiveScores


def held_out(rng: np.random.Generator, times: float = 1.0, n: int = 240) -> HeldOut:
    """Errors that are correlated over 10 places of 100, `times` as large as claimed."""
    place = np.sort(rng.uniform(0.0, 100.0, n))
    claimed = 0.09 * np.exp(-np.abs(place[:, None] - place[None]) / 10.0)
    error = times * np.linalg.cholesky(claimed + 1e-9 * np.eye(n)) @ rng.standard_normal(n)
    noise = np.full(n, 0.05**2)
    error = error + 0.05 * rng.standard_normal(n)
    averages = np.kron(np.eye(n // 4), np.full((1, 4), 0.25))
    noise_of_mean = averages**2 @ noise
    covariance = averages @ claimed @ averages.T + np.diag(noise_of_mean)
    variance = np.diag(covariance) - noise_of_mean
    groups = HeldOutGroups(averages @ error, variance, noise_of_mean, averages @ place, covariance)
    return HeldOut("swaths", 4, error, np.full(n, 0.09), noise, place, groups)


def test_honest_deviations_are_rejected_as_rarely_as_the_level_says():
    checks = [PredictiveCheck.of(held_out(np.random.default_rng(seed))) for seed in range(300)]
    assert sum(check.contradicts for check in checks) <= 9


def test_deviations_three_times_too_small_are_widened_by_about_three():
    check = PredictiveCheck.of(held_out(np.random.default_rng(5), times=3.0))
    assert check.contradicts
    assert 2.0 < np.mean(check.factor) < 4.5
    assert check.before.coverage_95 < 0.7
    assert check.after.coverage_95 > 0.85
    assert "contradicts" in check.sentence
    assert "widened by a factor of up to" in check.sentence


def test_correlated_points_count_as_fewer():
    check = PredictiveCheck.of(held_out(np.random.default_rng(6)))
    assert all(1.0 < n < 15.0 for n in check.n_effective)


def test_the_mixture_of_two_predictions_counts_how_far_they_are_apart():
    one, other = held_out(np.random.default_rng(8)), held_out(np.random.default_rng(9), times=2.0)
    mixed = HeldOut.mixture([one, other], np.array([0.3, 0.7]))
    assert mixed.error_m == pytest.approx(0.3 * one.error_m + 0.7 * other.error_m)
    assert mixed.variance_m2 == pytest.approx(0.09 + 0.21 * (one.error_m - other.error_m) ** 2)
    apart = one.groups.error_m - other.groups.error_m
    claimed = 0.3 * one.groups.covariance_m2 + 0.7 * other.groups.covariance_m2
    assert mixed.groups.covariance_m2 == pytest.approx(claimed + 0.21 * np.outer(apart, apart))
    assert np.diag(mixed.groups.covariance_m2) == pytest.approx(
        mixed.groups.variance_m2 + mixed.groups.noise_m2
    )


def test_too_few_points_make_no_test():
    assert PredictiveCheck.of(held_out(np.random.default_rng(7), n=32)) is None


def test_a_check_comes_back_from_its_record():
    check = PredictiveCheck.of(held_out(np.random.default_rng(8), times=2.0))
    assert PredictiveCheck.from_facts(json.loads(json.dumps(check.facts()))) == check


def test_scores_of_normal_errors_are_those_of_a_normal_distribution():
    scores = PredictiveScores.of(0.2 * np.random.default_rng(9).standard_normal(20_000), np.full(20_000, 0.2))
    assert scores.coverage_95 == pytest.approx(0.95, abs=0.005)
    assert scores.pit_tenths == pytest.approx([0.1] * 10, abs=0.01)
    assert scores.log_score == pytest.approx(-0.5 - np.log(0.2 * np.sqrt(2.0 * np.pi)), abs=0.02)
