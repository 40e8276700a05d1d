"""Tests of the least distance for predictions with a spread."""

import numpy as np
import pytest

from benchmarks.promise_on_real_ground.least_distance import Lawnmowers, share_of_limit, spread_of
from benchmarks.promise_on_real_ground.surveys import Outcome


def test_the_first_lawnmower_within_the_limit_is_the_shortest() -> None:
    found = Lawnmowers([100.0, 200.0, 300.0], [0.9, 0.4, 0.2])
    assert found.least_m(0.5) == 200.0
    assert found.least_m(0.1) == 300.0


def test_predictions_within_the_share_meet_the_limit_with_the_probability() -> None:
    spread = 0.3
    actual = share_of_limit(0.9, spread) * np.exp(spread * np.random.default_rng(1).standard_normal(100_000))
    assert np.mean(actual <= 1.0) == pytest.approx(0.9, abs=0.005)


def test_the_spread_is_that_of_the_logarithm_of_actual_over_predicted_error() -> None:
    outcomes = [Outcome(True, 1.0, float(np.exp(sign * 0.2)), 1.0, 4) for sign in (-1, 1)]
    assert spread_of(outcomes) == pytest.approx(0.2)
