"""Wheel encoders: ticks and scale, faults."""

import numpy as np
import pytest

from sim.config.sensors import FaultConfig, WheelConfig
from sim.instruments.dead_reckoning import WheelEncoders, WheelFaults
from survey.data.sensors.records import Wheels
from tests.sim.instruments.motions import circling


def test_encoders_count_ticks_with_their_scale():
    config = WheelConfig(scale_error=0.02, scale_difference=0.01, tick_m=0.001)
    read = WheelEncoders(config, 1).sense(circling())
    assert read.left_m[-1] == pytest.approx(3.8 * 5.0 * 1.025, abs=0.001)
    assert read.right_m[-1] == pytest.approx(4.2 * 5.0 * 1.015, abs=0.001)


def test_a_wrong_calibration_scales_the_counts():
    fault = FaultConfig(component="calibration", failure="wheels", strength=0.1)
    wheels = Wheels([0.0, 1.0], [0.0, 2.0], [0.0, 3.0])
    reported = WheelFaults([fault], 1).apply(wheels)
    assert reported.left_m == pytest.approx([0.0, 2.2])
    assert reported.right_m == pytest.approx([0.0, 3.3])
    assert WheelFaults([], 1).apply(wheels) is wheels


def test_carried_wheels_stand_still():
    fault = FaultConfig(component="rover", failure="carried", from_s=2.0, until_s=4.0)
    times = np.arange(7.0)
    reported = WheelFaults([fault], 1).apply(Wheels(times, times, 2.0 * times))
    assert reported.left_m == pytest.approx([0.0, 1.0, 1.0, 1.0, 2.0, 3.0, 4.0])
