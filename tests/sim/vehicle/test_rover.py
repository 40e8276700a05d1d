"""The rover's physics on ground whose answer is known."""

from importlib.util import find_spec

import numpy as np
import pytest

from planners import Rover
from sim.config.rover import PhysicsConfig
from sim.vehicle.motion import KinematicRover
from sim.vehicle.pursuit import PurePursuit
from sim.vehicle.rover import ContactRover

ENGINES = [engine for engine in ("bullet", "mujoco") if find_spec({"bullet": "pybullet"}.get(engine, engine))]
contact = pytest.mark.parametrize("engine", ENGINES)
ROVER = Rover(mass_kg=18.0, idle_w=20.0)
GAUGE_M = PhysicsConfig().track_gauge_m


class Plane:
    """Ground that rises to the east, or drops into a slot."""

    step_m = 0.25
    bounds = (0.0, 0.0, 100.0, 100.0)

    def __init__(self, deg=0.0, slot=None):
        self.rise, self.slot = np.tan(np.radians(deg)), slot

    def elevation(self, xy):
        z = self.rise * xy[:, 0]
        if self.slot is not None:
            z = np.where(np.abs(xy[:, 0] - self.slot) < 0.6, z - 4.0, z)
        return z


def driven(rover, left, right, seconds):
    for _ in range(round(seconds / rover.dt_s)):
        rover.step(left, right)
    return rover.state


def standing(engine, ground, x=30.0, heading=0.0, **settings):
    config = PhysicsConfig(engine=engine, **settings)
    return ContactRover(ground, config, ROVER, np.array([x, 50.0]), heading)


def slip(engine, deg, friction):
    rover = standing(engine, Plane(deg), 20.0, friction=friction)
    first = driven(rover, 1.0, 1.0, 1.0)
    last = driven(rover, 1.0, 1.0, 3.0)
    way = np.linalg.norm(np.subtract(last.position, first.position))
    return 1.0 - way / np.mean(np.subtract(last.rolled_m, first.rolled_m))


@contact
def test_slip_rises_with_the_slope_and_ice_stalls(engine):
    slips = [slip(engine, deg, 0.5) for deg in (0.0, 10.0, 18.0)]
    assert slips[0] < slips[1] < slips[2]
    assert slips[2] < 0.2  # 0.5 holds tan 18° + resistance 0.1 = 0.42
    assert slip(engine, 5.0, 0.15) > 0.8  # 0.15 does not hold tan 5° + 0.1 = 0.19


@contact
def test_tracks_turn_the_rover_less_than_kinematics_say(engine):
    rover = standing(engine, Plane(), 50.0, 0.0)
    turn = sum((rover.step(0.7, 1.0), rover.state.rate[2])[1] for _ in range(720)) * rover.dt_s
    assert 0.2 < turn / (0.3 / GAUGE_M * 3.0) < 0.9


@contact
def test_a_change_of_the_ground_patch_is_not_felt(engine):
    rover = standing(engine, Plane(6.0), 30.3, 0.2)
    places, patches = [], []
    for _ in range(12 * 240):
        rover.step(1.0, 1.0)
        places.append(rover.state.position)
        patches.append(rover.patch_centre)
    change = int(np.flatnonzero(np.diff(patches, axis=0).any(axis=1))[0])
    jumps = np.linalg.norm(np.diff(places, 2, axis=0), axis=1)
    assert jumps[change - 3 : change + 4].max() < 1e-3


@contact
def test_the_same_commands_give_the_same_drive(engine):
    ends = []
    for _ in range(2):
        rover = standing(engine, Plane(4.0), 30.0, 0.3)
        ends.append(driven(rover, 0.8, 1.0, 2.0))
    assert ends[0] == ends[1]


@contact
def test_standing_costs_the_idle_power_alone_and_moves_nothing(engine):
    rover = standing(engine, Plane(), 50.0, 0.0)
    first = rover.state
    last = driven(rover, 0.0, 0.0, 2.0)
    assert last.energy_j == pytest.approx(2.0 * ROVER.idle_w, rel=0.01)
    assert np.linalg.norm(np.subtract(last.position, first.position)) < 1e-3


@contact
def test_driving_costs_what_the_snow_resists(engine):
    rover = standing(engine, Plane(), 30.0, 0.0)
    first = driven(rover, 1.0, 1.0, 2.0)
    last = driven(rover, 1.0, 1.0, 6.0)
    per_m = (last.energy_j - first.energy_j - 6.0 * ROVER.idle_w) / (last.position[0] - first.position[0])
    resisted = 0.1 * 18.0 * 9.81 / ROVER.efficiency
    # Wheels that roll over the ground's triangles lose up to a third more.
    assert resisted < per_m < 1.4 * resisted


@contact
def test_a_stuck_track_turns_the_rover_towards_it(engine):
    rover = standing(engine, Plane(), 50.0, 0.0)
    rover.drive_share = (0.0, 1.0)
    driven(rover, 0.8, 0.8, 2.0)
    x, y, z, w = rover.state.quaternion
    assert np.arctan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z)) > 0.2


@contact
def test_energy_balance_closes(engine):
    from tests.sim.vehicle.energy_balance import EnergyBalance

    balance = EnergyBalance(standing(engine, Plane(8.0), 30.0, 0.5))
    for _ in range(480):
        balance.step(0.8, 1.0)
    # The bar is 2 %; position corrections of the engine leave about 0.1 %.
    assert abs(balance.missing_j) < 0.02 * balance.motors_j


@pytest.mark.long
@contact
def test_energy_balance_closes_where_the_patch_of_ground_changes(engine):
    from tests.sim.vehicle.energy_balance import EnergyBalance

    rover = standing(engine, Plane(8.0), 30.0, 0.0)
    balance, patch = EnergyBalance(rover), rover.patch_centre
    for _ in range(3200):
        balance.step(0.9, 0.9)
    assert rover.patch_centre != patch
    assert abs(balance.missing_j) < 0.02 * balance.motors_j


def test_kinematic_rover_follows_the_slope():
    rover = KinematicRover(Plane(10.0), PhysicsConfig(), ROVER, np.array([30.0, 50.0]), 0.0)
    state = driven(rover, 1.0, 1.0, 4.0)
    climbed = state.position[2] - np.tan(np.radians(10.0)) * 30.0
    assert climbed == pytest.approx(np.tan(np.radians(10.0)) * (state.position[0] - 30.0))
    way = np.hypot(state.position[0] - 30.0, climbed)
    assert 1.0 - way / 4.0 == pytest.approx(0.01 + np.tan(np.radians(10.0)) ** 2, abs=0.003)


@pytest.mark.parametrize("engine", [*ENGINES, "kinematic"])
def test_pure_pursuit_keeps_to_a_route_with_right_angles(engine):
    path = np.array([[40.0, 40.0], [46.0, 40.0], [46.0, 45.0]])
    config = PhysicsConfig(engine=engine)
    pursuit = PurePursuit(path, 1.0, config)
    kind = KinematicRover if engine == "kinematic" else ContactRover
    rover = kind(Plane(), config, ROVER, path[0], 0.0)
    aside, time_s = [], 0.0
    while not pursuit.is_done(np.array(rover.state.position[:2])) and time_s < 40.0:
        x, y, z, w = (state := rover.state).quaternion
        heading = np.arctan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z))
        place = np.array(state.position[:2])
        driven(rover, *pursuit.track_speeds(place, heading), 0.05)
        time_s += 0.05
        aside.append(min(abs(place[1] - 40.0), abs(place[0] - 46.0)))
    assert time_s < 40.0
    assert max(aside) < 1.0  # corners are cut within the look-ahead


@contact
def test_lateral_friction_holds_a_rover_across_a_slope(engine):
    rover = standing(engine, Plane(10.0), 30.0, 0.5 * np.pi)
    first = rover.state
    last = driven(rover, 0.0, 0.0, 2.0)
    # 0.5 × 0.7 across holds tan 10° = 0.18.
    assert np.linalg.norm(np.subtract(last.position, first.position)) < 2e-3
    slippery = standing(engine, Plane(10.0), 30.0, 0.5 * np.pi, friction=0.2)
    first = slippery.state
    last = driven(slippery, 0.0, 0.0, 2.0)
    assert first.position[0] - last.position[0] > 0.1  # 0.2 × 0.7 does not


@pytest.mark.skipif("mujoco" not in ENGINES, reason="mujoco is not installed")
def test_a_spinning_track_does_not_lift_itself_off_the_ground():
    rover = standing("mujoco", Plane(5.0), 30.0, friction=0.15)
    heights = []
    for _ in range(480):
        rover.step(1.0, 1.0)
        x, _, z = rover.state.position
        heights.append(z - np.tan(np.radians(5.0)) * x)
    assert np.ptp(heights[240:]) < 1e-3
    assert abs(np.mean(heights[240:])) < 2e-3
