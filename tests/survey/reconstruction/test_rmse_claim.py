"""Posterior of a map's error from its joint covariance."""

import json

import numpy as np
import pytest

from survey.reconstruction.checks import RmseClaim, sampled_nodes


def covariance(n: int = 60) -> np.ndarray:
    place = np.arange(n)
    return 0.04 * np.exp(-np.abs(place[:, None] - place[None]) / 15.0) + 0.09


def test_true_errors_lie_below_the_upper_limit_in_95_percent_of_maps():
    claim = RmseClaim.of(covariance(), np.sqrt(np.diag(covariance())))
    rng = np.random.default_rng(1)
    drawn = rng.standard_normal((20000, 60)) @ np.linalg.cholesky(covariance()).T
    size = np.exp(rng.normal(-(0.22**2), 0.22, 20000))
    absolute = size * np.sqrt(np.mean(drawn**2, axis=1))
    relative = size * drawn.std(axis=1)
    for rmse, posterior in ((absolute, claim.absolute), (relative, claim.relative)):
        assert np.mean(rmse <= posterior.upper_m) == pytest.approx(0.95, abs=0.006)
        assert np.sqrt(np.mean(rmse**2)) == pytest.approx(posterior.expected_m, rel=0.03)
    assert claim.offset_sigma_m == pytest.approx(drawn.mean(axis=1).std(), rel=0.04)


def test_many_independent_errors_leave_the_size_of_their_deviations_uncertain():
    claim = RmseClaim.of(0.04 * np.eye(400), np.full(400, 0.2))
    assert claim.relative.sigma_m == pytest.approx(0.2 * np.hypot(0.22, 0.5 * (2.0 / 400) ** 0.5), rel=0.01)
    assert claim.relative.upper_m == pytest.approx(0.2 * np.exp(-(0.22**2) + 1.645 * 0.223), rel=0.01)


def test_the_claim_follows_the_stated_deviations():
    one = RmseClaim.of(covariance(), np.sqrt(np.diag(covariance())))
    two = RmseClaim.of(covariance(), 2.0 * np.sqrt(np.diag(covariance())))
    assert two.absolute.upper_m == pytest.approx(2.0 * one.absolute.upper_m)


def test_a_claim_comes_back_from_its_record():
    claim = RmseClaim.of(covariance(), np.sqrt(np.diag(covariance())))
    assert RmseClaim.from_facts(json.loads(json.dumps(claim.facts()))) == claim


def test_sampled_nodes_lie_inside_and_are_few():
    inside = np.zeros((200, 100), dtype=bool)
    inside[40:, :50] = True
    rows = sampled_nodes(inside)
    assert 300 <= len(rows) <= 400
    assert inside.ravel()[rows].all()
