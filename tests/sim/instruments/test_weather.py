"""Weather: lapse, variation over the site, noise of the station."""

import numpy as np
import pytest

from sim.config.sensors import WeatherConfig
from sim.instruments.environment import WeatherField, WeatherStation
from tests.sim.instruments.motions import standing


def test_weather_falls_with_height_and_varies_over_the_site():
    config = WeatherConfig(temperature_sd_c=0.8)
    field = WeatherField(config, 100.0, 1)
    here, above = field.at(np.array([[0.0, 0.0, 100.0], [0.0, 0.0, 1100.0]]))
    assert here[0] - above[0] == pytest.approx(6.5)
    places = np.column_stack([np.random.default_rng(1).uniform(0.0, 2e4, (4000, 2)), np.full(4000, 100.0)])
    assert field.at(places)[:, 0].std() == pytest.approx(0.8, rel=0.1)


def test_a_station_reads_the_field_with_its_noise():
    config = WeatherConfig()
    field = WeatherField(config, 0.0, 1)
    read = WeatherStation(config, field, 1).sense(standing(4000.0))
    here = field.at(np.zeros((1, 3)))[0]
    # Four standard errors of 4000 readings.
    assert read.temperature_c.mean() == pytest.approx(here[0], abs=4.0 * 0.1 / np.sqrt(4000.0))
    assert read.temperature_c.std() == pytest.approx(0.1, rel=4.0 / np.sqrt(2.0 * 4000.0))
    assert read.humidity_percent.max() <= 100.0
