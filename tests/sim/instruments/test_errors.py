"""Errors that all instruments share: reading times, Gauss–Markov series."""

import numpy as np
import pytest
from scipy.signal import lfilter

from sim.config.sensors import InstrumentConfig
from sim.instruments.sensor import Clock, GaussMarkov, RandomWalkNoise, gauss_markov


def test_a_clock_reads_each_moment_once():
    clock = Clock(InstrumentConfig(rate_hz=3.0), 1, "test")
    parts = [clock.due(t).at_s for t in (0.5, 0.5, 1.1, 4.0)]
    np.testing.assert_allclose(np.concatenate(parts), np.arange(13) / 3.0)
    assert len(parts[1]) == 0


def test_readings_are_lost_at_the_stated_share():
    clock = Clock(InstrumentConfig(rate_hz=10.0, dropped_share=0.25), 1, "test")
    # Four standard errors of 10 001 readings.
    assert len(clock.due(1000.0).at_s) / 10_001 == pytest.approx(0.75, abs=4.0 * np.sqrt(0.1875 / 10_001))


def test_gauss_markov_has_its_variance_and_memory():
    series = gauss_markov(np.full(200_000, 1.0), 20.0, 3.0, np.random.default_rng(1))[:, 0]
    # About 200 000 / 40 independent values; five standard errors.
    assert series.std() == pytest.approx(3.0, rel=5.0 / np.sqrt(2.0 * 5000.0))
    lagged = np.mean(series[20:] * series[:-20]) / np.mean(series**2)
    assert lagged == pytest.approx(np.exp(-1.0), abs=0.07)


@pytest.mark.parametrize("times", [np.arange(40.0), np.cumsum(np.r_[0.0, np.linspace(0.1, 3.0, 39)])])
def test_a_continued_series_is_the_series_drawn_at_once(times):
    at_once = gauss_markov(np.diff(times), 5.0, 2.0, np.random.default_rng(7), 3)
    continued = GaussMarkov(2.0, 5.0, np.random.default_rng(7), 3)
    parts = [continued.at(times[part]) for part in (slice(0, 1), slice(1, 1), slice(1, 25), slice(25, None))]
    np.testing.assert_allclose(np.vstack(parts), at_once, rtol=1e-12)


def test_a_random_walk_goes_on_from_call_to_call():
    noise = RandomWalkNoise(0.0, 0.0, 1.0, 1.0, np.random.default_rng(1))
    joined = np.vstack([noise.draw(50), noise.draw(50)])
    # Steps have σ = 1, also across the cut; 6 standard deviations of the largest of 3.
    assert np.abs(joined[50] - joined[49]).max() < 6.0
    assert np.diff(joined, axis=0).std() == pytest.approx(1.0, rel=0.3)


def test_even_steps_give_the_bits_of_a_linear_filter():
    noise = np.random.default_rng(5).standard_normal((2000, 3))
    series = gauss_markov(np.full(1999, 0.01), 7.0, 1.0, np.random.default_rng(5), 3)
    a = float(np.exp(-0.01 / 7.0))
    driven = np.sqrt(1.0 - a**2) * noise[1:]
    assert np.array_equal(series[1:], lfilter([1.0], [1.0, -a], driven, axis=0, zi=a * noise[:1])[0])
