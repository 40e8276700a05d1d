"""Scans in the frame of their sensor become a map by the path of their drive, with its error."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy import sparse
from typer.testing import CliRunner

from firnline.cli.main import app
from survey.core.arrays import FloatArray
from survey.data.path_error import PathError
from survey.data.sensors.lidar import LidarReturns, LidarScans, Scanner
from survey.data.trajectory import Trajectory
from survey.reconstruction.terrain_map import Reconstruction
from tests.survey.interchange.cloud_bags import write_cloud_bag

CRS = "EPSG:32608"
KNOWN = ["fit=false", "variance_m2=4.0", "length_scale_m=20.0"]
GP = [word for setting in KNOWN for word in ("--set", f"reconstruction.gp.{setting}")]
HEIGHT_M = 1.5


def run(*arguments: object) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["reconstruct", *map(str, arguments), "--crs", CRS, "--grid", "4"])
    return result.exit_code, result.output


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A drive of 40 m over level ground, with its path, KITTI scans and the scans of a recording."""
    monkeypatch.chdir(tmp_path)
    times = np.arange(21.0)
    place = np.column_stack([2.0 * times, np.full(21, 20.0), np.zeros(21)])
    level = np.tile([0.0, 0.0, 0.0, 1.0], (21, 1))
    error = PathError(times[[0, -1]], sparse.identity(12, format="csr") * 100.0, 6)
    Trajectory(times, place, level, np.zeros((21, 3, 3)), CRS, error=error).write("trajectory.csv")
    _write_kitti(tmp_path / "kitti")
    _scans().write(tmp_path / "lidar")
    return tmp_path


def _write_kitti(folder: Path) -> None:
    folder.mkdir()
    for number, cloud in enumerate(_clouds()):
        cloud.astype("<f4").tofile(folder / f"{number:06d}.bin")


def _clouds() -> list[FloatArray]:
    """Return 21 clouds (200, 4) of level ground: x, y, z and the horizontal range."""
    rng, clouds = np.random.default_rng(0), []
    for _ in range(21):
        away, turn = rng.uniform(4.0, 15.0, 200), rng.uniform(-np.pi, np.pi, 200)
        columns = [away * np.cos(turn), away * np.sin(turn), np.full(200, -HEIGHT_M), away]
        clouds.append(np.column_stack(columns))
    return clouds


def _scans() -> LidarScans:
    scanner = Scanner(elevation_deg=(-20.0, -10.0), n_columns=60, mount_m=(0.0, 0.0, HEIGHT_M))
    column, beam = np.divmod(np.arange(120), 2)
    ranges = HEIGHT_M / np.sin(np.radians([20.0, 10.0]))[beam]
    turns = [LidarReturns.of(np.full(120, scan), column, beam, ranges) for scan in range(20)]
    minute = LidarReturns(*(np.concatenate(columns) for columns in zip(*turns, strict=True)))
    return LidarScans(scanner, np.arange(20.0), [minute])


def test_kitti_scans_are_mapped_jointly_with_their_path(folder: Path) -> None:
    code, said = run("kitti", "--trajectory", "trajectory.csv", "--sigma", 0.03, *GP)
    assert code == 0, said
    _assert_level(folder)


def test_a_ros_2_bag_given_as_a_folder_is_mapped_jointly_with_its_path(folder: Path) -> None:
    write_cloud_bag(folder / "bag", {second: cloud[:, :3] for second, cloud in enumerate(_clouds())})
    code, said = run("bag", "--trajectory", "trajectory.csv", "--sigma", 0.03, *GP)
    assert code == 0, said
    _assert_level(folder)


def _assert_level(folder: Path) -> None:
    """Check the map of level ground, and that its error is that of the path."""
    made = Reconstruction.read(folder / "reconstruction")
    assert made.hyperparameters["landmark_errors"] == "joint"
    near = np.abs(made.mean.xy[:, 1] - 20.0) < 8.0
    heights, sigma = (dem.elevation.ravel()[near] for dem in (made.mean, made.std))
    assert np.abs(heights + HEIGHT_M).max() < 0.05
    assert 0.1 < np.median(sigma) < 1.0  # the path errs by 0.1 m and 0.1 rad, returns by 0.03 m
    assert (folder / "reconstruction" / "corrected_trajectory.csv").exists()


def test_the_scans_of_a_recording_state_their_own_errors(folder: Path) -> None:
    code, said = run("lidar", "--trajectory", "trajectory.csv", *GP, "--json")
    assert code == 0, said
    assert json.loads(said)["hyperparameters"]["landmark_errors"] == "joint"


def test_the_field_lattice_maps_registered_scans(folder: Path) -> None:
    code, said = run("lidar", "--trajectory", "trajectory.csv", "--method", "field", "--json")
    assert code == 0, said
    sigma = Reconstruction.read(folder / "reconstruction").std.elevation
    assert np.nanmin(sigma) > 0.0


def test_scans_that_state_no_error_need_one(folder: Path) -> None:
    code, said = run("kitti", "--trajectory", "trajectory.csv")
    assert (code, "--sigma" in said) == (3, True)


def test_two_paths_for_one_drive_are_refused(folder: Path) -> None:
    paths = ("--trajectory", "trajectory.csv") * 2
    code, said = run("lidar", *paths)
    assert (code, "1 sources of points and 2 trajectories" in said) == (3, True)


@pytest.mark.parametrize(("source", "problem"), [("nowhere", "do not exist"), ("empty", "holds no scans")])
def test_a_source_without_scans_is_named(folder: Path, source: str, problem: str) -> None:
    (folder / "empty").mkdir()
    code, output = run(source, "--trajectory", "trajectory.csv", "--method", "gp")
    assert code == 3
    assert source in output
    assert problem in " ".join(output.split())
