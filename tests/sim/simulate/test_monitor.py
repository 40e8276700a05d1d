"""Endings of a simulated drive."""

import numpy as np
import pytest

from sim.simulate.simulated_drive import STEERED_HZ, DriveMonitor, Ending
from sim.vehicle.motion import RoverState
from sim.vehicle.pursuit import PurePursuit
from tests.sim.simulate.test_vision import mission

SIDEWAYS = (np.sin(np.pi / 4.0), 0.0, 0.0, np.cos(np.pi / 4.0))


class Bounds:
    bounds = (0.0, 0.0, 24.0, 24.0)


def state(time_s=1.0, place=(6.0, 12.0, 100.0), turn=(0.0, 0.0, 0.0, 1.0), energy_j=0.0):
    return RoverState(time_s, place, turn, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0), energy_j)


def ending(*states, **sections):
    config = mission(**sections)
    pursuit = PurePursuit(np.array([[6.0, 12.0], [16.0, 12.0]]), 1.0, config.physics)
    return DriveMonitor(Bounds(), pursuit, config).ending(states, np.array(states[-1].position[:2]))


def test_a_drive_on_its_way_has_not_ended():
    assert ending(state()) is None


@pytest.mark.parametrize(
    ("last", "expected"),
    [
        (state(place=(25.0, 12.0, 100.0)), Ending.LEFT_THE_MAP),
        (state(turn=SIDEWAYS), Ending.TIPPED_OVER),
        (state(place=(6.0, 12.0, 99.0)), Ending.FELL),
        (state(time_s=91.0), Ending.OUT_OF_TIME),  # 3 times 10 m at 1 m/s, and a minute
    ],
)
def test_endings_are_named(last, expected):
    assert ending(state(), last) is expected


def test_an_empty_battery_ends_a_drive():
    rover = {"battery_j": 10.0, "mass_kg": 18.0}
    assert ending(state(energy_j=11.0), rover=rover) is Ending.BATTERY_EMPTY


def test_a_rover_that_stays_where_it_is_has_stalled():
    still = [state() for _ in range(22 * STEERED_HZ)]
    assert ending(*still) is Ending.STALLED
    assert ending(*still[: 20 * STEERED_HZ]) is None


def test_headings_count_from_east():
    assert state(turn=(0.0, 0.0, np.sin(0.4), np.cos(0.4))).heading_rad == pytest.approx(0.8)
