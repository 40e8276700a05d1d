"""Magnetic compass: errors that depend on the heading."""

import numpy as np
import pytest

from sim.config.sensors import CompassConfig
from sim.instruments.dead_reckoning import MagneticCompass
from tests.sim.instruments.motions import circling


def test_compass_error_repeats_with_the_heading():
    config = CompassConfig(white_sigma_deg=0.0, declination_error_deg=0.5)
    motion = circling(seconds=8.0 * np.pi)
    read = MagneticCompass(config, 1).sense(motion)
    error = np.degrees((read.heading_rad - 0.5 * read.time_s + np.pi) % (2.0 * np.pi) - np.pi)
    assert error.mean() == pytest.approx(0.5, abs=0.1)  # two whole turns but for one reading
    assert np.abs(error - 0.5).max() == pytest.approx(6.0, abs=1.1)  # between 5 and 7 for any two phases
