import numpy as np
import pytest

from survey import InputError
from survey.data.ice_motion import IceMotion
from survey.data.sensors.stakes import StakeSurveys
from survey.reconstruction.motion.priors import uniform_motion
from survey.reconstruction.motion.stakes import mean_stakes, motion_with_stakes

DAY_S, SIGMA_M = 86400.0, 0.03
XY = np.array([[0.0, 0.0], [600.0, 0.0], [0.0, 600.0], [600.0, 600.0]])


def prior(change_sigma: float = 0.0) -> IceMotion:
    return uniform_motion(
        (0.0, 0.0),
        0.0,
        velocity_sigma=5.0,
        lowering_sigma=0.2,
        epoch_s=0.0,
        velocity_change_sigma=change_sigma,
    )


def surveys(rng: np.random.Generator, real: IceMotion, scatter_m: float = 0.0) -> StakeSurveys:
    """Four stakes, surveyed at the beginning, in the middle and at the end of a day."""
    time_s = np.repeat([0.0, 0.5, 1.0], 4) * DAY_S
    stake = np.tile(np.arange(4.0), 3)
    foot = np.column_stack([XY, [100.0, 110.0, 95.0, 90.0]])[stake.astype(int)]
    place = foot + real.displacement(foot[:, :2], time_s)
    err = np.hypot(SIGMA_M, scatter_m) * rng.standard_normal(place.shape)
    return StakeSurveys(time_s, stake, place + err, np.full(12, SIGMA_M))


def test_velocity_and_lowering_lie_within_their_errors():
    real = uniform_motion((1.5, -0.4), 0.05, velocity_sigma=0.0, lowering_sigma=0.0, epoch_s=0.0)
    scores = []
    for seed in range(300):
        found = motion_with_stakes(prior(), surveys(np.random.default_rng(seed), real))
        scores.append(((found.rates(XY[:1]) - real.rates(XY[:1])) / found.rates_sigma(XY[:1]))[0])
    # The standard deviation of 900 normal numbers errs by 2.4 %.
    assert np.std(scores) == pytest.approx(1.0, abs=0.08)
    assert found.rates_sigma(XY[:1]).max() < 0.03


def test_a_change_of_velocity_across_the_site_is_found():
    coefficients = np.array([[1.5, 0.0, -0.8], [0.0, 0.0, 0.0], [0.05, 0.0, 0.0]])
    real = IceMotion(coefficients, 0.0, np.zeros(2), np.zeros((9, 0)))
    found = motion_with_stakes(prior(2.0), surveys(np.random.default_rng(1), real))
    assert (np.abs(found.rates(XY) - real.rates(XY)) < 3.0 * found.rates_sigma(XY)).all()


def test_stakes_that_scatter_by_more_than_they_err_widen_the_errors():
    real = uniform_motion((1.0, 0.0), 0.0, velocity_sigma=0.0, lowering_sigma=0.0, epoch_s=0.0)
    calm, torn = (motion_with_stakes(prior(), surveys(np.random.default_rng(2), real, s)) for s in (0.0, 0.3))
    assert torn.rates_sigma(XY[:1])[0, 0] > 4.0 * calm.rates_sigma(XY[:1])[0, 0]


def test_stakes_that_were_surveyed_once_leave_the_motion_as_it_was():
    once = StakeSurveys(np.zeros(2), [0.0, 1.0], np.zeros((2, 3)), np.full(2, 0.05))
    np.testing.assert_allclose(motion_with_stakes(prior(), once).covariance, prior().covariance, atol=1e-9)


def test_mean_stakes_have_the_mean_time():
    real = uniform_motion((1.0, 0.0), 0.0, velocity_sigma=0.0, lowering_sigma=0.0, epoch_s=0.0)
    stakes = mean_stakes(surveys(np.random.default_rng(5), real))
    np.testing.assert_allclose(stakes.time_s, 0.5 * DAY_S)
    np.testing.assert_allclose(stakes.sigma_m, SIGMA_M / np.sqrt(3.0))


def test_a_stake_that_is_missing_is_named():
    with pytest.raises(InputError, match="stake 0 was never surveyed"):
        mean_stakes(StakeSurveys(np.zeros(1), [1.0], np.zeros((1, 3)), [0.1]))
