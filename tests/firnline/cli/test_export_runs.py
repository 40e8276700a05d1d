"""``firnline export`` of runs that are only simulated: bags, layouts of data sets, MCAP and worlds."""

import json
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from typer.testing import CliRunner

from benchmarks.small_inputs import MISSION
from firnline.actions.run_formats import RUN_FORMATS
from firnline.cli.main import app
from survey import Recording, Trajectory
from survey.core.run_folder import RunFolder
from vision_slam.readers.bags import read_bag
from vision_slam.recordings import read_sequence

IMAGES = """
schema_version = 1
name = "images"
seed = 5
fidelity = "vision"
[terrain]
source = "random"
size_m = 60.0
relief_m = 3.0
[area]
bounds_m = [526020.0, 6478020.0, 526027.0, 6478027.0]
[planner]
pattern = "lawnmower"
swaths = 1
[rover]
mass_kg = 18.0
idle_w = 20.0
[scenery]
crevasses_per_ha = 0.0
[imaging]
width = 96
height = 72
[physics]
engine = "kinematic"
[sensors.lidar]
beams = 4
columns = 32
"""


def simulated(folder: Path, text: str) -> RunFolder:
    (folder / "mission.toml").write_text(text)
    arguments = ["simulate", str(folder / "mission.toml"), "--runs", str(folder / "runs"), "-q"]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    (latest,) = (folder / "runs").glob("*/latest")
    return RunFolder.find(latest)


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> RunFolder:
    return simulated(tmp_path_factory.mktemp("images"), IMAGES)


@pytest.fixture(scope="module")
def plain(tmp_path_factory) -> RunFolder:
    return simulated(tmp_path_factory.mktemp("plain"), MISSION)


@pytest.fixture
def small_textures(monkeypatch) -> None:
    monkeypatch.setattr("sim.world.world_files.MOST_TEXELS", 256)


def export(run: RunFolder, out: Path, *options: str, code: int = 0):
    result = CliRunner().invoke(app, ["export", str(run.path), str(out), *options])
    assert result.exit_code == code, result.output
    return result


def recorded(run: RunFolder) -> Recording:
    return Recording.read(run.folder("simulate") / "recording")


@pytest.mark.parametrize(
    ("name", "options"), [("drive.bag", ()), ("drive", ("--as", "ros2")), ("drive.mcap", ("--as", "ros2"))]
)
def test_a_simulated_run_becomes_a_bag(run, tmp_path, name, options):
    result = export(run, tmp_path / name, *options)
    assert "/camera/image_raw" in result.output
    assert "left out, for ROS has no common message of them: barometer" in result.output
    recording = recorded(run)
    with AnyReader([tmp_path / name]) as reader:
        counts = {one.topic: one.msgcount for one in reader.connections}
        for connection, _, raw in reader.messages():
            reader.deserialize(raw, connection.msgtype)
    assert counts["/camera/image_raw"] == counts["/camera/camera_info"] == len(recording.frames)
    assert counts["/imu/data"] == len(recording.inertial)
    assert counts["/lidar/points"] == len(recording.lidar)
    found = read_bag(tmp_path / name)
    fixes, _ = found.gps.fixes(recording.crs)
    np.testing.assert_allclose(fixes.position, recording.gps.position, atol=1e-6)


def test_a_bag_without_images_holds_odometry_and_fixes(plain, tmp_path):
    export(plain, tmp_path / "drive.bag")
    found = read_bag(tmp_path / "drive.bag")
    recording = recorded(plain)
    np.testing.assert_allclose(np.diff(found.wheels.left_m), recording.odometry.step[:, 0], atol=0.05)


@pytest.mark.parametrize("name", ["euroc", "kitti"])
def test_a_simulated_run_becomes_a_data_set(run, tmp_path, name):
    export(run, tmp_path / "drive", "--as", name)
    found, recording = read_sequence(tmp_path / "drive"), recorded(run)
    np.testing.assert_allclose(found.time_s, recording.frames.time_s, atol=1e-9)
    assert len(found.reference) > 1
    if name == "euroc":
        np.testing.assert_array_equal(found.frames[3], recording.frames[3])


def test_mcap_for_viewers_needs_no_localization(run, tmp_path):
    export(run, tmp_path / "drive.mcap")
    topics: dict[str, list] = {}
    with (tmp_path / "drive.mcap").open("rb") as stream:
        for _, channel, message in make_reader(stream).iter_messages():
            topics.setdefault(channel.topic, []).append(json.loads(message.data))
    assert len(topics["/rover1/image"]) == len(recorded(run).frames)
    (path,) = topics["/rover1/ground_truth/path"]
    real = Trajectory.read(run.folder("simulate") / "truth" / "trajectory.tum", recorded(run).crs)
    end = path["poses"][-1]["position"]
    shift = real.position[-1] - recorded(run).start
    np.testing.assert_allclose([end[axis] for axis in "xyz"], shift, atol=1e-6)


@pytest.mark.usefixtures("small_textures")
@pytest.mark.parametrize("name", ["site.sdf", "site.glb", "site.obj"])
def test_a_simulated_run_becomes_a_world(run, plain, tmp_path, name):
    for each in (run, plain):
        export(each, tmp_path / name, "--force")
        assert (tmp_path / name).stat().st_size > 1000
    if name == "site.sdf":
        (tmp_path / name).unlink()
        refusal = export(run, tmp_path / name, code=3)
        assert "site.heightmap.png exists" in refusal.output


def test_every_format_refuses_an_existing_output_before_work(run, tmp_path):
    for each in RUN_FORMATS:
        out = tmp_path / f"drive{each.suffix}"
        if each.suffix:
            out.write_text("mine")
        else:
            out.mkdir(exist_ok=True)
            (out / "mine.txt").write_text("mine")
        refusal = export(run, out, "--as", each.name, code=3)
        assert "exists; choose another name" in refusal.output
        if not each.suffix:
            refusal = export(run, out, "--as", each.name, "--force", code=3)
            assert "will not delete" in refusal.output


@pytest.mark.parametrize(
    ("name", "options", "code", "sentence"),
    [
        ("drive", (), 4, "name the kind of folder with --as: ros2, euroc, kitti"),
        ("drive.zip", ("--as", "kitti"), 4, "--as kitti writes names with the ending none (a folder)"),
        ("drive", ("--as", "sdf"), 4, "--as sdf writes names with the ending .sdf"),
        ("drive", ("--as", "rosbag"), 4, "--as rosbag is not known"),
        (
            "drive.bag",
            ("--crs", "EPSG:32608", "--speed", "1"),
            4,
            "--speed, --crs goes with routes and files",
        ),
        (
            "drive.bag",
            ("--rover", "2"),
            4,
            "there is no rover 2, and the run has 1; choose one with --rover 0",
        ),
        ("drive.mcap", ("--rover", "0"), 4, "the file holds all rovers; leave --rover out"),
        ("drive", ("--as", "euroc"), 3, "the recording has no images"),
    ],
)
def test_combinations_that_cannot_be_are_refused(plain, tmp_path, name, options, code, sentence):
    for more in ((), ("--dry-run",)):
        assert sentence in " ".join(export(plain, tmp_path / name, *options, *more, code=code).output.split())
    assert not list(tmp_path.iterdir())


def test_a_dry_run_writes_nothing(run, tmp_path):
    result = export(run, tmp_path / "drive", "--as", "ros2", "--dry-run")
    assert "time stamps are 1 s later" in result.output
    assert not list(tmp_path.iterdir())


def test_formats_of_runs_are_refused_for_files(tmp_path):
    (tmp_path / "a.csv").write_text("x,y\n1,2\n")
    result = CliRunner().invoke(app, ["export", str(tmp_path / "a.csv"), str(tmp_path / "b"), "--as", "ros2"])
    assert result.exit_code == 4
    assert "--as ros2 goes with run folders" in result.output
