"""Barometer: a datum of its own, drift of the stated size, and white noise."""

import numpy as np
import pytest

from sim.config.sensors import BarometerConfig
from sim.instruments.dead_reckoning import PressureAltimeter
from tests.sim.instruments.motions import standing


def heights(seed: int, **settings: float) -> np.ndarray:
    readings = PressureAltimeter(BarometerConfig(rate_hz=2.0, **settings), seed).sense(standing(400.0))
    assert readings is not None
    return readings.height_m


def test_noise_and_datum_have_the_stated_sizes() -> None:
    quiet = {"drift_sigma_m": 0.0}
    assert np.std(heights(1, **quiet, white_sigma_m=0.3)) == pytest.approx(0.3, rel=0.1)
    datums = [float(np.mean(heights(seed, **quiet, white_sigma_m=0.0))) for seed in range(40)]
    # The standard deviation of 40 values errs by a ninth.
    assert np.std(datums) == pytest.approx(10.0, rel=0.35)


def test_drift_has_the_stated_deviation_and_correlation_time() -> None:
    drift = [
        heights(seed, drift_sigma_m=1.0, correlation_time_s=20.0, white_sigma_m=0.0) for seed in range(20)
    ]
    change = np.stack(drift) - np.stack(drift)[:, :1]
    # E (x_t - x_0)² = 2 σ² (1 - exp(-t / τ)): 0.78 σ² after 10 s, 2 σ² in the end.
    assert np.mean((np.stack(drift)[:, 20:] - np.stack(drift)[:, :-20]) ** 2) == pytest.approx(
        0.787, rel=0.15
    )
    assert np.mean(change[:, 400:] ** 2) == pytest.approx(2.0, rel=0.6)
