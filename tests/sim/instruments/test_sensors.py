"""Instruments of the simulated rover: their noise is what their models say."""

from dataclasses import fields
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sim.config.sensors import (
    CompassConfig,
    GpsConfig,
    InertialConfig,
    InstrumentsConfig,
    StakeConfig,
    WeatherConfig,
    WheelConfig,
)
from sim.instruments.gps import GPS_PROFILES, GpsReceiver
from sim.instruments.sensors import InertialUnit, MagneticCompass, StakeSpotter, WeatherField, WheelEncoders
from sim.instruments.suite import Instruments, Log
from sim.vehicle.motion import RoverMotion


def standing(seconds):
    zero, turn = np.zeros((2, 3)), np.tile([0.0, 0.0, 0.0, 1.0], (2, 1))
    return RoverMotion(np.array([0.0, seconds]), zero, turn, zero, zero, np.zeros((2, 2)))


def circling(seconds=10.0, rate=0.5, radius=4.0, hz=80):
    """Motion on a level circle: all that sensors read of it is known."""
    t = np.arange(round(seconds * hz) + 1) / hz
    angle = rate * t
    position = radius * np.column_stack([np.sin(angle), 1.0 - np.cos(angle), 0.0 * t])
    velocity = radius * rate * np.column_stack([np.cos(angle), np.sin(angle), 0.0 * t])
    turn = Rotation.from_euler("z", angle[:, None]).as_quat()
    spin = np.tile([0.0, 0.0, rate], (len(t), 1))
    rolled = np.column_stack([(radius - 0.2) * angle, (radius + 0.2) * angle])
    return RoverMotion(t, position, turn, velocity, spin, rolled)


def parts_of(motion, n):
    """Return the same motion in stretches that overlap by one state."""
    edges = np.linspace(0, len(motion.time_s) - 1, n + 1).astype(int)
    for first, last in pairwise(edges):
        window = slice(max(first - 4, 0), last + 1)
        yield RoverMotion(*(getattr(motion, f)[window] for f in RoverMotion.__dataclass_fields__))


@pytest.mark.parametrize("profile", list(GPS_PROFILES))
def test_gps_errors_have_the_profile_s_autocovariance(profile):
    n, model = 40_000, GPS_PROFILES[profile]
    config = InstrumentsConfig(gps=GpsConfig(profile=profile))
    fixes, _ = GpsReceiver(config, 0.0, 1).sense(standing(n - 1.0), np.zeros(3))
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
    fixes, _ = GpsReceiver(InstrumentsConfig(gps=gps), 0.0, 2).sense(standing(3600.0 * hours), np.zeros(3))
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
        fixes, _ = GpsReceiver(InstrumentsConfig(gps=gps), 0.0, 2).sense(standing(seconds), np.zeros(3))
        spread.append(np.abs(fixes.position[:, 0]).max())
    assert spread[0] < 0.2
    assert spread[1] > 5.0


def test_a_base_station_shares_the_slow_error():
    config = InstrumentsConfig(gps=GpsConfig(profile="gauss-markov-60"), base_station=True, base_residual=0.2)
    rover, base = GpsReceiver(config, 0.0, 3).sense(standing(40_000.0), np.zeros(3))
    apart = (rover.position - base.position)[:, :2]
    left = 9.0 * 0.04 + 2.0  # the own part and both white noises
    assert np.mean(apart**2) == pytest.approx(left, rel=0.1)
    assert np.mean(rover.position[:, 0] ** 2) == pytest.approx(10.0, rel=0.25)


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


def test_encoders_count_ticks_with_their_scale():
    config = WheelConfig(scale_error=0.02, scale_difference=0.01, tick_m=0.001)
    read = WheelEncoders(config, 1).sense(circling())
    assert read.left_m[-1] == pytest.approx(3.8 * 5.0 * 1.025, abs=0.001)
    assert read.right_m[-1] == pytest.approx(4.2 * 5.0 * 1.015, abs=0.001)


def test_compass_error_repeats_with_the_heading():
    config = CompassConfig(white_sigma_deg=0.0, declination_error_deg=0.5)
    motion = circling(seconds=8.0 * np.pi)
    read = MagneticCompass(config, 1).sense(motion)
    error = np.degrees((read.heading_rad - 0.5 * read.time_s + np.pi) % (2.0 * np.pi) - np.pi)
    assert error.mean() == pytest.approx(0.5, abs=0.1)  # two whole turns but for one reading
    assert np.abs(error - 0.5).max() == pytest.approx(6.0, abs=1.1)  # between 5 and 7 for any two phases


def test_weather_falls_with_height_and_varies_over_the_site():
    config = WeatherConfig(temperature_sd_c=0.8)
    field = WeatherField(config, 100.0, 1)
    here, above = field.at(np.array([[0.0, 0.0, 100.0], [0.0, 0.0, 1100.0]]))
    assert here[0] - above[0] == pytest.approx(6.5)
    places = np.column_stack([np.random.default_rng(1).uniform(0.0, 2e4, (4000, 2)), np.full(4000, 100.0)])
    assert field.at(places)[:, 0].std() == pytest.approx(0.8, rel=0.1)


def test_stakes_are_seen_within_reach_and_no_better_than_stated():
    feet = np.array([[0.0, 3.0, 0.0], [50.0, 0.0, 0.0]])
    config = StakeConfig(range_m=8.0, survey_sigma_m=0.05)
    spotter = StakeSpotter(config, feet, 1)
    seen = spotter.sense(standing(2000.0))
    assert set(seen.index) == {0}
    error = seen.offset - feet[0]
    normalised = np.einsum("ni,nij,nj->n", error, np.linalg.inv(seen.covariance), error)
    assert normalised.mean() == pytest.approx(3.0, abs=4.0 * np.sqrt(6.0 / len(seen)))


def test_readings_do_not_depend_on_how_the_drive_is_cut():
    motion = circling()
    records = []
    for n in (1, 7):
        config = InstrumentsConfig(
            base_station=True, gps=GpsConfig(rate_hz=5.0, dropped_share=0.2, clock_offset_s=0.03)
        )
        instruments = Instruments(config, 0.5, np.zeros(3), np.array([[1.0, 1.0, 0.0]]), 4)
        log = Log()
        for part in parts_of(motion, n):
            log.add(instruments.read(part))
        records.append(log.records())
    for name, whole in records[0].items():
        for field in fields(whole):
            # Summing biases in pieces rounds in another order.
            expected = pytest.approx(getattr(whole, field.name), abs=1e-9)
            assert getattr(records[1][name], field.name) == expected, name
    gps = records[0]["gps"]
    assert (gps.time_s * 5.0) % 1.0 == pytest.approx(
        np.full(len(gps), 0.15)
    )  # the clock shows 0.03 s too much
    assert 30 < len(gps) < 51  # of 51, a fifth is lost
