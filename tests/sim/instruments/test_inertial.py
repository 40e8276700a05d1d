"""Gyro and accelerometer: Allan deviation, readings of a known motion."""

import numpy as np
import pytest

from sim.config.sensors import InertialConfig
from sim.instruments.dead_reckoning import InertialUnit
from tests.sim.instruments.motions import circling, standing


def test_gyro_and_accelerometer_have_the_stated_allan_deviation():
    rate_hz, n, hour = 20.0, 100_000, 3600.0
    config = InertialConfig(
        rate_hz=rate_hz, gyro_bias_walk_deg_h_sqrt_h=120.0, force_bias_walk_m_s2_sqrt_h=0.3
    )
    read = InertialUnit(config, 1).sense(standing(n / rate_hz))
    models = (
        (read.gyro_rad_s, np.radians(0.3) / hour**0.5, np.radians(120.0) / hour**1.5),
        (read.specific_force_m_s2 - [0.0, 0.0, 9.81], 0.002, 0.3 / hour**0.5),
    )
    for values, density, walk in models:
        for tau in (1.0, 10.0, 100.0):
            m = round(tau * rate_hz)
            angle = np.vstack([np.zeros((1, 3)), np.cumsum(values, axis=0) / rate_hz])
            second = angle[2 * m :] - 2.0 * angle[m:-m] + angle[: -2 * m]
            allan = np.sqrt(np.mean(second**2) / 2.0) / tau
            model = np.sqrt(density**2 / tau + walk**2 * tau / 3.0)
            # About 3 T / τ independent averages; four standard errors.
            assert allan == pytest.approx(model, rel=4.0 / np.sqrt(6.0 * n / rate_hz / tau))


def test_inertial_readings_on_a_circle():
    exact = InertialConfig(
        gyro_noise_deg_sqrt_h=0.0,
        gyro_bias_deg_h=0.0,
        gyro_bias_walk_deg_h_sqrt_h=0.0,
        force_noise_m_s2_sqrt_hz=0.0,
        force_bias_m_s2=0.0,
        force_bias_walk_m_s2_sqrt_h=0.0,
    )
    read = InertialUnit(exact, 1).sense(circling())
    assert read.gyro_rad_s == pytest.approx(np.tile([0.0, 0.0, 0.5], (len(read), 1)), abs=1e-9)
    # Centripetal ω² r = 1 m/s² to the left, gravity up; the mean over a step lags by (ω dt)²/24.
    assert read.specific_force_m_s2 == pytest.approx(np.tile([0.0, 1.0, 9.81], (len(read), 1)), abs=1e-4)
