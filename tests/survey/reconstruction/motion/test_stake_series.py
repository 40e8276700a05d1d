import numpy as np
import pytest

from survey import InputError
from survey.reconstruction.motion.stakes import predict_position


def test_a_steady_velocity_is_found_and_predicted():
    rng, days = np.random.default_rng(4), np.linspace(0.0, 5.0, 60)
    found = predict_position(days, 3.0 + 1.2 * days + 0.01 * rng.standard_normal(60), np.array([10.0]))
    assert abs(found.velocity_m_per_day - 1.2) < 2.0 * found.velocity_sigma_m_per_day
    assert abs(found.position_m[0] - 15.0) < 2.0 * found.sigma_m[0]
    assert found.velocity_sigma_m_per_day < 0.2


def test_a_velocity_that_varies_widens_the_prediction():
    rng, days = np.random.default_rng(4), np.linspace(0.0, 5.0, 120)
    steady = 1.2 * days + 0.01 * rng.standard_normal(120)
    varying = steady + 0.3 * np.sin(2.0 * np.pi * days / 1.7)
    calm, wild = (predict_position(days, series, np.array([8.0])) for series in (steady, varying))
    assert wild.sigma_m[0] > 2.0 * calm.sigma_m[0]


def test_errors_grow_with_the_time_ahead():
    days = np.linspace(0.0, 5.0, 40)
    sigma = predict_position(days, 0.8 * days + 0.02 * np.cos(9.0 * days), np.array([5.1, 6.0, 9.0])).sigma_m
    assert (np.diff(sigma) > 0.0).all()


def test_too_short_a_series_is_refused():
    with pytest.raises(InputError, match="at least 6"):
        predict_position(np.arange(3.0), np.arange(3.0), np.array([4.0]))


def test_halves_of_real_series_predict_one_another(real_data):
    from benchmarks.moving_ice.stake_series import predicted

    found = predicted(real_data)
    ends = np.array([axis[-1] for one in found for axis in one["scores"]])
    assert len(found) > 15
    assert np.mean(np.abs(ends) < 1.96) >= 0.93
