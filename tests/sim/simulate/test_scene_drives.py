"""Drives with ground around the site, clouds, ruts and colour: recorded, exported, and localized."""

from pathlib import Path

import numpy as np
import pytest

from sim.config.mission import MissionConfig
from sim.simulate.simulated_drive import Ending, SimulatedDrive
from sim.simulate.vision import simulate_vision
from survey.core.config import validated
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.data.recording import Recording
from survey.data.route import Leg, Route
from survey.interchange.drive_bags import write_bag
from survey.interchange.layouts import write_euroc, write_kitti_sequence
from vision_slam.motion import dead_reckoning
from vision_slam.odometry.visual_odometry import visual_odometry
from vision_slam.readers.bags import read_bag
from vision_slam.recordings import read_sequence

CRS = "EPSG:32608"
WAY = Route((Leg("swath", np.array([[8.0, 12.0], [13.0, 12.0]])),), CRS, "test")


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> tuple[SimulatedDrive, Path]:
    folder = tmp_path_factory.mktemp("scenes")
    grid = Grid((-1600.0, -1600.0, 1600.0, 1600.0), 40.0, CRS)
    x, y = np.meshgrid(grid.x, grid.y)
    Dem.on(grid, 100.0 + 0.2 * np.maximum(np.hypot(x, y) - 500.0, 0.0)).write(folder / "around.tif")
    content = {
        "schema_version": 1,
        "name": "scenes",
        "seed": 5,
        "fidelity": "vision",
        "terrain": {"source": "random"},
        "planner": {"pattern": "lawnmower", "swaths": 1},
        "rover": {"mass_kg": 18.0, "idle_w": 20.0},
        "scenery": {"crevasses_per_ha": 0.0},
        "appearance": {"horizon": "around.tif", "clouds": 0.4, "ruts": True},
        "imaging": {"width": 240, "height": 180, "colour": True, "exposure_s": 0.01, "row_readout_s": 1e-5},
    }
    mission = validated(MissionConfig, content, "the test").read_from(folder)
    site = Grid((0.0, 0.0, 24.0, 24.0), 1.0, CRS)
    done = simulate_vision(Dem.on(site, np.full(site.shape, 100.0)), WAY, mission, folder / "recording")
    done.write(folder)
    return done, folder


def test_a_drive_in_colour_is_recorded_and_localized(drive: tuple[SimulatedDrive, Path]) -> None:
    done, folder = drive
    assert done.ending is Ending.ARRIVED
    recording = Recording.read(folder / "recording")
    assert recording.frames is not None
    assert recording.frames[0].shape == (180, 240, 3)
    found = visual_odometry(recording)
    assert np.mean([health.is_visual for health in found.health[6:]]) > 0.9
    assert not found.is_lost.any()
    path, real = dead_reckoning(found.odometry, np.zeros(3)), done.truth.trajectory.position
    assert np.linalg.norm(path[-1]) == pytest.approx(np.linalg.norm(real[-1] - real[0]), rel=0.05)


def test_exports_keep_the_colours(drive: tuple[SimulatedDrive, Path], tmp_path: Path) -> None:
    done, _ = drive
    recording = done.recording
    assert recording.frames is not None
    first = recording.frames[0]
    for name in ("ros1.bag", "ros2", "ros2.mcap"):
        write_bag(recording, tmp_path / name)
        assert (read_bag(tmp_path / name).frames[0] == first).all()
    write_euroc(recording, tmp_path / "euroc", done.truth.trajectory)
    assert (read_sequence(tmp_path / "euroc").frames[0] == first).all()
    write_kitti_sequence(recording, tmp_path / "kitti", done.truth.trajectory)
    kitti = read_sequence(tmp_path / "kitti")
    assert (tmp_path / "kitti" / "image_2" / "000000.png").exists()
    assert kitti.frames[0].shape == first.shape
    blue, red = (image[:60, :, 0].mean() / image[:60, :, 2].mean() for image in (first, kitti.frames[0]))
    assert blue > 1.1  # the sky
    assert red == pytest.approx(blue, rel=0.05)
