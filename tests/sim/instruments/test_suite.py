"""All instruments together: readings, faults, collected records."""

from dataclasses import fields

import numpy as np
import pytest

from sim.config.sensors import FaultConfig, GpsConfig, InstrumentsConfig
from sim.config.world import IceConfig
from sim.instruments.registry import SENSORS, Instruments, ReadingLog, SensorFaults
from sim.instruments.sensor import InstrumentSetup
from sim.world.moving_ice import MovingIce
from survey.data.recording import table_types
from survey.data.sensors.records import Compass, GpsFixes
from tests.sim.instruments.motions import circling, parts_of


def test_readings_do_not_depend_on_how_the_drive_is_cut():
    motion = circling()
    records = []
    for n in (1, 7):
        config = InstrumentsConfig(
            base_station=True, gps=GpsConfig(rate_hz=5.0, dropped_share=0.2, clock_offset_s=0.03)
        )
        setup = InstrumentSetup(config, 0.5, np.zeros(3), np.array([[1.0, 1.0, 0.0]]), 4, 4)
        instruments = Instruments(setup)
        log = ReadingLog()
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


def test_every_sensor_of_the_registry_is_a_table_of_a_recording():
    names = [sensor.name for sensor in SENSORS]
    assert sorted(names) == sorted(table_types())
    assert all(sensor.instrument is not None or sensor.draw is not None for sensor in SENSORS)


def test_a_carried_rover_silences_what_is_aboard_alone():
    faults = SensorFaults([FaultConfig(component="rover", failure="carried", from_s=1.0)], 1)
    times = np.arange(3.0)
    assert len(faults.apply("compass", Compass(times, times))) == 1
    base = GpsFixes(times, np.zeros((3, 3)))
    assert faults.apply("base", base) is base
    assert faults.apply("compass", None) is None


def test_on_moving_ice_receivers_read_fixed_coordinates_and_wheels_the_way_on_the_ice():
    ice = MovingIce(IceConfig(velocity_m_per_day=86400.0, direction_deg=90.0), np.zeros(2))
    config, stakes = InstrumentsConfig(), np.zeros((0, 3))
    still, moved = (
        Instruments(InstrumentSetup(config, 0.5, np.zeros(3), stakes, 4, 4, one)).read(circling())
        for one in (None, ice)
    )
    # The ice moves by a metre a second to the north.
    np.testing.assert_allclose(
        moved.gps.position[:, 1] - still.gps.position[:, 1], still.gps.time_s, atol=1e-9
    )
    np.testing.assert_array_equal(moved.wheels.left_m, still.wheels.left_m)
