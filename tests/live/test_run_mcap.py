"""MCAP files of runs: read back by the library of the format."""

import base64
import json

import numpy as np
import pytest
from mcap.reader import make_reader
from typer.testing import CliRunner

from benchmarks.small_inputs import IDEAL_MISSION
from firnline.cli.main import app
from survey import Route, SurfacePoints
from survey.core.run_folder import RunFolder
from survey.data.trajectory import Trajectory


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> RunFolder:
    folder = tmp_path_factory.mktemp("runs")
    mission = folder / "mission.toml"
    mission.write_text(IDEAL_MISSION)
    arguments = ["run", str(mission), "--until", "reconstruct", "--runs", str(folder / "runs"), "-q"]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    (latest,) = (folder / "runs").glob("*/latest")
    return RunFolder.find(latest)


def test_a_run_becomes_path_landmarks_and_map(run, tmp_path):
    out = tmp_path / "run.mcap"
    result = CliRunner().invoke(app, ["export", str(run.path), str(out)])
    assert result.exit_code == 0, result.output
    messages: dict[str, list[dict]] = {}
    with out.open("rb") as stream:
        reader = make_reader(stream)
        for schema, channel, message in reader.iter_messages():
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            messages.setdefault(channel.topic, []).append(json.loads(message.data))
        (frame,) = [record.metadata for record in reader.iter_metadata()]
    crs = Route.read(run.folder("plan") / "route.geojson").crs
    path = Trajectory.read(run.folder("localize") / "trajectory.csv", crs)
    origin = np.array([float(frame[name]) for name in ("east_m", "north_m", "up_m")])
    poses = messages["/rover1/pose"]
    assert len(poses) == len(path.time_s)
    last = poses[-1]["pose"]["position"]
    np.testing.assert_allclose(
        np.array([last[axis] for axis in "xyz"]) + origin, path.position[-1], atol=1e-6
    )
    np.testing.assert_allclose(poses[-1]["position_covariance"], path.covariance[-1].ravel())
    (cloud,) = messages["/rover1/landmarks"]
    rows = np.frombuffer(base64.b64decode(cloud["data"]), "<f4").reshape(-1, 4)
    points = SurfacePoints.read(run.folder("localize") / "surface_points.gpkg")
    np.testing.assert_allclose(rows[:, :3] + origin, points.xyz, atol=1e-3)
    assert (rows[:, 3] > 0.0).all()
    assert len(messages["/map"]) == 1


def test_a_dry_run_writes_nothing_and_options_of_routes_are_refused(run, tmp_path):
    out = tmp_path / "run.mcap"
    assert CliRunner().invoke(app, ["export", str(run.path), str(out), "--dry-run"]).exit_code == 0
    assert CliRunner().invoke(app, ["export", str(run.path), str(out), "--speed", "1"]).exit_code == 4
    assert not out.exists()
