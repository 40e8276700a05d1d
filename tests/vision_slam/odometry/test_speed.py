"""Smoothing of the lengths of steps."""

import numpy as np
import pytest

from survey.core.arrays import FloatArray
from vision_slam.odometry.scale_drift import smoothed_steps

N, SECONDS = 80, np.full(80, 0.1)
MOVING = np.ones(N, dtype=bool)


def _ahead(length: FloatArray) -> FloatArray:
    return np.column_stack([length, np.zeros_like(length), np.zeros_like(length)])


def test_noisy_steps_of_a_steady_drive_become_even() -> None:
    noise = 1.0 + 0.01 * np.random.default_rng(1).standard_normal(N)
    found = smoothed_steps(_ahead(noise), SECONDS, MOVING)[:, 0]
    assert np.std(found) < 0.3 * np.std(noise)
    assert found.sum() == pytest.approx(noise.sum(), rel=2e-3)


def test_speed_that_really_changes_stays() -> None:
    length = np.where(np.arange(N) % 20 < 10, 1.0, 0.5)
    found = smoothed_steps(_ahead(length), SECONDS, MOVING)[:, 0]
    assert np.abs(found - length).max() < 0.01


def test_standing_and_unseen_steps_stay_as_they_are() -> None:
    length = 1.0 + 0.01 * np.random.default_rng(1).standard_normal(N)
    length[30:50] = 0.0
    is_moving = MOVING.copy()
    is_moving[72:] = False
    found = smoothed_steps(_ahead(length), SECONDS, is_moving)[:, 0]
    assert (found[30:50] == 0.0).all()
    assert (found[72:] == length[72:]).all()


def test_times_that_jitter_do_not_jitter_the_steps() -> None:
    rng = np.random.default_rng(2)
    times = 0.1 * np.arange(N + 1) + rng.uniform(-0.03, 0.03, N + 1)
    length = np.full(N, 1.0)
    found = smoothed_steps(_ahead(length), np.diff(times), MOVING)[:, 0]
    assert np.abs(found - length).max() < 0.02
