"""Missions with a LiDAR: scans in the recording, their points in the map."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.small_inputs import BARE_SCENERY
from sim.config.mission import MissionConfig
from sim.mission.runs import open_run
from sim.mission.stages import run_mission
from survey import Reconstruction, SurfacePoints
from survey.core.config import validated
from survey.core.errors import ConfigError
from survey.core.run_folder import RunFolder
from survey.data.recording import Recording
from survey.data.truth import Truth
from survey.reconstruction.registration.config import ScanPointsConfig
from survey.reconstruction.registration.scan_points import BeamErrors, scan_points

SMALL = {
    "schema_version": 1,
    "name": "scanned",
    "terrain": {"source": "random", "size_m": 90.0, "step_m": 3.0, "origin_m": (500000.0, 6700000.0)},
    "planner": {"pattern": "lawnmower", "swaths": 1},
    "sensors": {"lidar": {"beams": 16, "columns": 60}},
    "reconstruction": {"grid_step_m": 5.0, "gp": {"fit": False, "variance_m2": 8.0, "length_scale_m": 30.0}},
}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    mission = validated(MissionConfig, SMALL, "the test")
    run = open_run(mission, tmp_path_factory.mktemp("runs"))
    run_mission(mission, run, workers=1)
    return run


@pytest.mark.long
def test_scans_are_recorded_and_their_points_are_mapped(run: RunFolder) -> None:
    recording = Recording.read(run.folder("simulate") / "recording")
    assert recording.lidar is not None
    assert len(recording.lidar) == len(recording.gps) // 2 - 1
    points = SurfacePoints.read(run.folder("localize") / "scan_points.gpkg")
    landmarks = SurfacePoints.read(run.folder("localize") / "surface_points.gpkg")
    assert points.keyframe is not None
    assert points.range_m is not None
    assert points.range_m.max() > 25.0
    assert np.ptp(points.xy[:, 1]) > np.ptp(landmarks.xy[:, 1])
    mapped = Reconstruction.read(run.folder("reconstruct"))
    assert mapped.hyperparameters["landmark_errors"] == "joint"


def test_scan_points_err_as_they_state(run: RunFolder) -> None:
    points = SurfacePoints.read(run.folder("localize") / "scan_points.gpkg")
    truth = Truth.read(run.folder("simulate") / "truth")
    error = points.z - truth.dem.at(points.xy)
    known = np.isfinite(error)
    assert np.mean(np.abs(error[known]) < 3.0 * points.sigma_z[known]) > 0.9


def test_the_report_shows_the_cover_of_the_scans(run: RunFolder) -> None:
    page = (run.folder("report") / "index.html").read_text(encoding="utf-8")
    assert "Density of the measured points" in page
    assert (run.folder("report") / "run.qgz").exists()


def test_the_perfect_sensor_has_no_lidar() -> None:
    with pytest.raises(ConfigError, match="no LiDAR"):
        validated(MissionConfig, {**SMALL, "fidelity": "ideal"}, "the test")


@pytest.mark.parametrize("method", ["field", "emap"])
def test_scan_points_are_mapped_by_the_methods_of_scans(run: RunFolder, method: str, tmp_path: Path) -> None:
    other = validated(
        MissionConfig,
        {**SMALL, "reconstruction": {"grid_step_m": 5.0, "method": method, "use_prior": False}},
        "the test",
    )
    again = open_run(other, tmp_path)
    run_mission(other, again, until="reconstruct", workers=1)
    assert Reconstruction.read(again.folder("reconstruct")).method == method


@pytest.mark.long
@pytest.mark.slow
def test_a_rover_in_images_scans_the_ground_that_it_drives_on(tmp_path: Path) -> None:
    settings = {
        "name": "scanned-in-images",
        "fidelity": "vision",
        "terrain": SMALL["terrain"] | {"size_m": 30.0, "step_m": 0.5, "relief_m": 1.0},
        "area": {"bounds_m": (500008.0, 6700008.0, 500022.0, 6700022.0)},
        "satellite": {"cell_m": 10.0},
        "rover": {"mass_kg": 18.0, "idle_w": 20.0},
        "scenery": BARE_SCENERY | {"dune_sd_m": 0.3},
        "imaging": {"width": 320, "height": 240},
        "physics": {"engine": "kinematic"},
        "sensors": {"lidar": {"beams": 16, "columns": 60, "ghost_share": 0.0, "spray_share": 0.0}},
    }
    mission = validated(MissionConfig, SMALL | settings, "the test")
    run = open_run(mission, tmp_path)
    run_mission(mission, run, until="reconstruct", workers=1)
    lidar = Recording.read(run.folder("simulate") / "recording").lidar
    assert lidar is not None
    truth = Truth.read(run.folder("simulate") / "truth")
    points = scan_points(
        lidar, truth.trajectory, BeamErrors.of(lidar.scanner), config=ScanPointsConfig(cell_m=1.0)
    )
    error = points.z - truth.dem.at(points.xy)
    assert np.nanstd(error[points.range_m < 12.0]) < 0.05  # the dunes have 0.3 m
    assert Reconstruction.read(run.folder("reconstruct")).hyperparameters["landmark_errors"] == "joint"
