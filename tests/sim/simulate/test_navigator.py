"""The onboard computer: the same drive and the same records wherever it is, and what `visual_odometry` says of them."""

import hashlib
import os
import signal
import subprocess
import sys

import numba
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sim.config.mission import MissionConfig
from sim.simulate.navigator import OnboardComputer, Start, Subprocess, drive_over_texture, navigating
from sim.simulate.simulated_drive import Ending
from sim.simulate.vision import simulate_vision
from survey.core.config import validated
from survey.core.errors import InputError
from survey.data.camera import Camera
from survey.data.recording import Readings, Recording
from survey.data.sensors.records import Inertial
from tests.sim.simulate.test_vision import ground, route
from vision_slam import LocalizationConfig
from vision_slam.odometry import global_adjustment, resection, window
from vision_slam.odometry.onboard import read_visual_odometry
from vision_slam.odometry.visual_odometry import visual_odometry

WAY = route((6.0, 12.0), (10.5, 12.0), (10.5, 14.0))


def mission() -> MissionConfig:
    given = {
        "schema_version": 1,
        "name": "closed-loop",
        "seed": 5,
        "fidelity": "vision",
        "terrain": {"source": "random"},
        "planner": {"pattern": "lawnmower", "swaths": 2},
        "physics": {"engine": "kinematic", "steer_by": "estimate"},
        "imaging": {"width": 320, "height": 240},
        "scenery": {"crevasses_per_ha": 0.0},
    }
    return validated(MissionConfig, given, "the test")


def navigating_for(config, workers):
    return navigating(config.assumed, config.rover.antenna_height_m, config.seed, workers)


@pytest.fixture(scope="module")
def drives(tmp_path_factory):
    made = []
    for workers in (1, 2):
        folder = tmp_path_factory.mktemp("drive")
        with navigating_for(mission(), workers) as navigate:
            drive = simulate_vision(ground(), WAY, mission(), folder / "recording", navigate)
        drive.write(folder)
        made.append((drive, folder))
    return made


@pytest.mark.long
def test_a_computer_of_its_own_gives_the_same_bytes(drives):
    def digests(folder):
        files = sorted(file for file in folder.rglob("*") if file.is_file())
        return {file.relative_to(folder): hashlib.sha256(file.read_bytes()).hexdigest() for file in files}

    (_, here), (_, apart) = drives
    assert digests(here) == digests(apart)
    assert (here / "recording" / "onboard" / "sightings.csv").exists()


def test_the_rover_finds_its_way_by_what_it_sees(drives):
    drive, _ = drives[0]
    assert drive.ending is Ending.ARRIVED
    # Fixes err by a metre; over 6 m the images and the known start hold it to decimetres, and the goal has 0.5 m.
    assert np.hypot(*(drive.truth.trajectory.position[-1, :2] - [10.5, 14.0])) < 0.8


def test_what_was_seen_on_board_agrees_with_the_recording(drives):
    _, folder = drives[0]
    on_board = read_visual_odometry(folder / "recording" / "onboard")
    afterwards = visual_odometry(Recording.read(folder / "recording"))
    np.testing.assert_array_equal(on_board.odometry.time_s, afterwards.odometry.time_s)
    np.testing.assert_array_equal(on_board.odometry.step, afterwards.odometry.step)
    np.testing.assert_array_equal(on_board.odometry.attitude_rad, afterwards.odometry.attitude_rad)
    np.testing.assert_array_equal(on_board.sightings.offset, afterwards.sightings.offset)
    # The table holds one triangle of matrices that are symmetric but for rounding.
    np.testing.assert_allclose(
        on_board.sightings.covariance, afterwards.sightings.covariance, rtol=1e-9, atol=1e-15
    )
    assert on_board.health == afterwards.health
    np.testing.assert_array_equal(on_board.is_lost, afterwards.is_lost)
    assert sum(frame.is_visual for frame in on_board.health) > 20


def test_the_drive_over_texture_compiles_every_loop_that_a_real_drive_runs(drives, monkeypatch):
    entries = {
        window: ["adjusted"],
        resection: ["_resected"],
        global_adjustment: ["seen_from_anchors", "add_observations", "eliminate_points", "add_scores"],
    }
    called = set()

    def noted(name, loop):
        def run(*arguments):
            called.add((name, tuple(numba.typeof(argument) for argument in arguments)))
            return loop(*arguments)

        return run

    for module, names in entries.items():
        for name in names:
            monkeypatch.setattr(module, name, noted(name, getattr(module, name)))
    found = drive_over_texture()
    np.testing.assert_allclose(found.odometry.step, np.tile([0.25, 0.0, 0.0], (3, 1)), atol=2e-3)
    by_texture = called.copy()
    called.clear()
    visual_odometry(Recording.read(drives[0][1] / "recording"))
    assert called == by_texture


def test_what_images_do_not_tell_the_filter_hears_from_the_gyro_and_of_how_unsure_a_bridged_step_is():
    camera = Camera("pinhole", 8, 6, [[8, 0, 4], [0, 8, 3], [0, 0, 1]], np.zeros(5), np.eye(4))
    computer = OnboardComputer(Start(camera, np.zeros(3), 0.0), LocalizationConfig(), 1.0, 1)
    times = np.arange(1, 81) / 80.0
    rates, force = np.tile([0.0, 0.0, 0.2], (80, 1)), np.tile([0.0, 0.0, 9.81], (80, 1))
    computer._sense(Readings(inertial=Inertial(times, rates, force)))
    poses = np.array([np.eye(4), np.eye(4)])
    poses[1, :3, :3] = Rotation.from_euler("z", 0.05).as_matrix()
    turn = computer._turn_by_gyro(0.5, poses)
    assert (turn.beyond_rad, turn.turned_rad) == pytest.approx((0.05, 0.05))
    assert computer._turn_by_gyro(3.0, poses) is None
    steps = [computer._unseen_m(0.25, is_visual) for is_visual in (True, False, False, False, True)]
    # What was bridged errs by one share of the whole of it: 5 % of 0.75 m.
    assert np.hypot.reduce(steps) == pytest.approx(0.05 * 0.75)
    assert steps[0] == steps[-1] == 0.0


def test_a_computer_whose_process_ends_is_reported_in_one_sentence():
    camera = Camera("pinhole", 8, 6, [[8, 0, 4], [0, 8, 3], [0, 0, 1]], np.zeros(5), np.eye(4))
    start = Start(camera, np.zeros(3), 0.0)
    with navigating_for(mission(), 2) as navigate:
        navigator = navigate(start)
        connection = navigator._computer
        assert isinstance(connection, Subprocess)
        os.kill(connection._process.pid, signal.SIGKILL)
        with pytest.raises(InputError, match="ended with code -9 after about 0 images"):
            _step_often(navigator)


def _step_often(navigator):
    for _ in range(5):
        navigator.step(Readings())


def test_the_process_of_the_onboard_computer_imports_no_simulator():
    code = "import sys, sim.simulate.navigator as _; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    parts = ("planners", "sim.config", "sim.instruments", "sim.rendering", "sim.vehicle", "sim.world")
    assert [name for name in done.stdout.split() if name.startswith(parts)] == []
