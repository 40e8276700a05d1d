"""Length, turns, time and energy of driving, worked by hand."""

import numpy as np
import pytest
from affine import Affine

from planners.routes.rover import Mobility, effort, energy_per_metre, predicted
from survey.core.errors import InputError
from survey.data.dem import Dem
from survey.data.route import Leg

SIMPLE = Mobility(
    speed_m_s=2.0, turn_s=5.0, mass_kg=100.0, rolling_resistance=0.1, efficiency=0.5, idle_w=40.0
)


def test_level_ground() -> None:
    # 0.1 * 100 * 9.81 / 0.5 J/m to roll and 40 W / 2 m/s to be on.
    assert SIMPLE.flat_j_per_m == pytest.approx(196.2 + 20.0)
    result = effort(np.array([[0.0, 0.0], [30.0, 0.0], [30.0, 40.0]]), SIMPLE)
    assert (result.length_m, result.n_turns) == (70.0, 1)
    assert result.time_s == pytest.approx(35.0 + 5.0)
    assert result.energy_j == pytest.approx(70.0 * 216.2 + 5.0 * 40.0)


def test_uphill_takes_the_height_and_downhill_gives_nothing_back() -> None:
    # A plane that rises one in ten to the east.
    x = np.arange(0.0, 201.0, 10.0)
    dem = Dem(np.tile(0.1 * x, (21, 1)), Affine(10.0, 0.0, -5.0, 0.0, -10.0, 205.0), "EPSG:32608")
    up = effort(np.array([[0.0, 100.0], [200.0, 100.0]]), SIMPLE, dem)
    down = effort(np.array([[200.0, 100.0], [0.0, 100.0]]), SIMPLE, dem)
    lift_j = 100.0 * 9.81 * 20.0 / 0.5
    slant_m = np.hypot(200.0, 20.0)
    rolling_j = 0.1 * 100.0 * 9.81 * 200.0 / 0.5  # cos θ times the slant is the run
    assert up.energy_j == pytest.approx(lift_j + rolling_j + 20.0 * slant_m)
    # One in ten is just what the ground resists: downhill only the idle power counts.
    assert down.energy_j == pytest.approx(20.0 * slant_m, abs=1e-6)
    assert up.length_m == 200.0
    assert up.time_s == pytest.approx(slant_m / 2.0)


def test_energy_grows_with_slope_and_never_is_negative() -> None:
    slope = np.radians(np.linspace(-40.0, 40.0, 81))
    energy = energy_per_metre(slope, SIMPLE)
    assert (np.diff(energy) >= 0.0).all()
    assert (energy >= 20.0).all()


def test_a_fleet_is_as_late_as_its_last_rover() -> None:
    legs = [
        Leg("swath", [[0, 0], [100, 0]], 0),
        Leg("swath", [[0, 10], [60, 10]], 1),
        Leg("transit", [[60, 10], [60, 20]], 1),
    ]
    result = predicted(legs, SIMPLE)
    assert result["time_s"] == 50.0
    assert result["length_m"] == 170.0
    assert result["transit_share"] == pytest.approx(10.0 / 160.0)


def test_a_route_off_the_known_heights_is_refused() -> None:
    dem = Dem(np.zeros((5, 5)), Affine(1.0, 0.0, 0.0, 0.0, -1.0, 5.0), "EPSG:32608")
    with pytest.raises(InputError, match="the DEM has no height"):
        effort(np.array([[1.0, 1.0], [9.0, 1.0]]), SIMPLE, dem)
