"""GPS receivers: errors by profile, disturbances, base station, faults."""

import numpy as np
import pytest

from sim.config.sensors import FaultConfig, GpsConfig, InstrumentsConfig
from sim.instruments.gps import GPS_PROFILES, BaseReceiver, Episodes, GpsFaults, GpsReceiver
from survey.data.sensors.records import GpsFixes
from tests.sim.instruments.motions import standing


@pytest.mark.parametrize("profile", list(GPS_PROFILES))
def test_gps_errors_have_the_profile_s_autocovariance(profile):
    n, model = 40_000, GPS_PROFILES[profile]
    config = InstrumentsConfig(gps=GpsConfig(profile=profile))
    fixes = GpsReceiver(config, 0.0, 1).sense(standing(n - 1.0))
    errors = fixes.position / [1.0, 1.0, 1.7]
    variance = model.bias_sigma_m**2 + model.white_sigma_m**2
    memory = model.correlation_s if model.bias_sigma_m else 1.0
    tolerance = 4.0 * np.sqrt(2.0 * memory / (3 * n))  # four standard errors
    for lag in (0, 1, round(model.correlation_s)):
        expected = model.bias_sigma_m**2 * np.exp(-lag / model.correlation_s)
        expected += model.white_sigma_m**2 * (lag == 0)
        found = np.mean(errors[: n - lag] * errors[lag:])
        assert found == pytest.approx(expected, abs=tolerance * variance)


def test_outages_last_as_long_and_come_as_often_as_asked():
    hours = 40.0
    gps = GpsConfig(outages_per_h=4.0, outage_s=60.0)
    fixes = GpsReceiver(InstrumentsConfig(gps=gps), 0.0, 2).sense(standing(3600.0 * hours))
    gaps = np.diff(fixes.time_s)
    # A gap begins 4 times an hour of those without one: 15 min + 1 min a cycle; 5 standard errors of 150.
    assert (gaps > 1.5).sum() == pytest.approx(hours * 60.0 / 16.0, rel=5.0 / np.sqrt(150.0))
    assert 1.0 - len(fixes) / (3600.0 * hours) == pytest.approx(1.0 / 16.0, rel=0.5)


def test_jumps_and_multipath_are_seen_in_the_errors():
    seconds = 20_000.0
    quiet = GpsConfig(profile="rtk")
    loud = GpsConfig(profile="rtk", jumps_per_h=20.0, jump_m=5.0, multipath_per_h=20.0, multipath_m=8.0)
    spread = []
    for gps in (quiet, loud):
        fixes = GpsReceiver(InstrumentsConfig(gps=gps), 0.0, 2).sense(standing(seconds))
        spread.append(np.abs(fixes.position[:, 0]).max())
    assert spread[0] < 0.2
    assert spread[1] > 5.0


def test_a_base_station_shares_the_slow_error():
    config = InstrumentsConfig(gps=GpsConfig(profile="gauss-markov-60"), base_station=True, base_residual=0.2)
    motion = standing(40_000.0)
    rover = GpsReceiver(config, 0.0, 3).sense(motion)
    base = BaseReceiver(config, np.zeros(3), 3).sense(motion)
    apart = (rover.position - base.position)[:, :2]
    left = 9.0 * 0.04 + 2.0  # the own part and both white noises
    assert np.mean(apart**2) == pytest.approx(left, rel=0.1)
    assert np.mean(rover.position[:, 0] ** 2) == pytest.approx(10.0, rel=0.25)


def test_episodes_are_counted_and_end():
    episodes = Episodes(60.0, 10.0, np.random.default_rng(1))
    numbers = [episodes.number_at(t) for t in np.arange(0.0, 3600.0)]
    during = [number for number in numbers if number]
    assert during == sorted(during)
    # 60 an hour that last 10 s each: one a minute and 10 s, a seventh of the time; 5 standard errors of 51.
    assert max(numbers) == pytest.approx(3600.0 / 70.0, rel=5.0 / np.sqrt(51.0))
    assert not any(Episodes(0.0, 10.0, np.random.default_rng(1)).number_at(t) for t in (0.0, 1e9))


def faulty(failure, strength=None, **times):
    fault = FaultConfig(component="gps", failure=failure, strength=strength, **times)
    fixes = GpsFixes(np.arange(6.0), np.arange(18.0).reshape(6, 3))
    return fixes, GpsFaults([fault], 1).apply(fixes)


def test_a_receiver_that_is_off_gives_no_fix():
    _, reported = faulty("off", from_s=2.0, until_s=4.0)
    assert reported.time_s.tolist() == [0.0, 1.0, 4.0, 5.0]
    assert faulty("off")[1] is None


def test_a_frozen_receiver_repeats_its_last_fix():
    fixes, reported = faulty("frozen", from_s=2.0)
    np.testing.assert_array_equal(reported.position[2:], np.tile(fixes.position[1], (4, 1)))


def test_a_jump_has_the_stated_length():
    fixes, reported = faulty("jump", 15.0, from_s=3.0)
    apart = np.linalg.norm(reported.position - fixes.position, axis=1)
    assert apart == pytest.approx([0.0, 0.0, 0.0, 15.0, 15.0, 15.0])


def test_delayed_fixes_are_those_of_earlier():
    fixes, reported = faulty("delayed", 2.0)
    assert reported.time_s.tolist() == [2.0, 3.0, 4.0, 5.0]
    np.testing.assert_array_equal(reported.position, fixes.position[:4])


def test_a_carried_receiver_is_silent():
    carried = FaultConfig(component="rover", failure="carried", from_s=1.0, until_s=3.0)
    fixes = GpsFixes(np.arange(6.0), np.zeros((6, 3)))
    assert GpsFaults([carried], 1).apply(fixes).time_s.tolist() == [0.0, 3.0, 4.0, 5.0]
