"""Random wandering: every candidate is equally likely, and changes come as often as configured."""

import numpy as np
import pytest

from planners import RandomWanderConfig
from planners.patterns.random_wander import RandomWanderSteering
from planners.steering import Attitude

N = 40_000


def test_candidates_are_equally_likely_and_change_by_the_toggle_probability() -> None:
    steering, rng = RandomWanderSteering(RandomWanderConfig(swaths=2)), np.random.default_rng(1)
    n, p = len(steering.config.candidates_deg), steering.config.toggle_probability
    before = steering.begin(0.0, rng.random(N))
    after = steering.after_step(before, rng.random(N))
    for state in (before, after):
        assert np.bincount(state.mode, minlength=n) / N == pytest.approx(np.full(n, 1.0 / n), abs=0.02)
    # A toggle draws among all candidates, the present one included.
    assert np.mean(before.mode != after.mode) == pytest.approx(p * (1.0 - 1.0 / n), abs=0.02)


def test_a_draw_of_one_changes_nothing_and_headings_are_those_of_the_candidates() -> None:
    steering = RandomWanderSteering(RandomWanderConfig(swaths=2))
    state = steering.begin(0.3, np.linspace(0.0, 0.999, 12))
    assert (steering.after_step(state, np.ones(12)).mode == state.mode).all()
    headings = steering.steer(Attitude(*np.zeros((3, 12))), state)
    candidates = np.radians(np.array(steering.config.candidates_deg))
    np.testing.assert_allclose(headings - 0.3, candidates[state.mode])
