"""Drive that clients see and command: in step with its client, so that its clock is that of the drive alone."""

import base64
import json
import signal
import struct
import subprocess
import sys
import threading
import time

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner
from websockets.sync.client import connect

from firnline.cli.main import app
from live.served_drive import Commands, RealTime, ServedDrive
from sim.simulate.simulated_drive import Ending
from sim.simulate.vision import drive_by_commands
from survey.core.transformation import WGS84, transformed
from survey.data.recording import Recording
from tests.firnline.cli.test_export_runs import IMAGES
from tests.sim.simulate.test_vision import SHORT, ground, mission

COMMANDED_S, END_S = 2.5, 4.5


class InStep:
    """Clock that waits until the client has answered every time up to `COMMANDED_S`, and ends the drive at `END_S`."""

    def begin(self, time_s):
        self.time_s, self.n_told = time_s, 0

    def now_s(self):
        return self.time_s

    def wait_until(self, time_s):
        until = time.monotonic() + 60.0
        while self.drive._commands.n_received < self.n_told:
            assert time.monotonic() < until
            time.sleep(0.001)
        self.time_s = time_s
        self.n_told += time_s <= COMMANDED_S
        if time_s >= END_S:
            self.drive.stop()


def listen(url, heard):
    """Command a turn to the left until `COMMANDED_S`; keep what is received until the server closes."""
    with connect(url, subprotocols=["foxglove.sdk.v1"], max_size=None) as link:
        topics = {
            one["id"]: one["topic"] for one in [json.loads(link.recv()) for _ in range(2)][1]["channels"]
        }
        subscriptions = [{"id": k, "channelId": k} for k in topics]
        link.send(json.dumps({"op": "subscribe", "subscriptions": subscriptions}))
        channel = {"id": 3, "topic": "/cmd_vel", "encoding": "json", "schemaName": "geometry_msgs/Twist"}
        link.send(json.dumps({"op": "advertise", "channels": [channel]}))
        twist = json.dumps({"linear": {"x": 0.5, "y": 0.0}, "angular": {"z": 0.4}}).encode()
        for data in link:
            if data[0] == 1:
                heard.setdefault(topics[struct.unpack_from("<BI", data)[1]], []).append(json.loads(data[13:]))
            elif struct.unpack("<BQ", data)[1] <= COMMANDED_S * 1e9:
                link.send(struct.pack("<BI", 1, 3) + twist)


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    """Return a drive that was served, what its client heard, its account and its folder."""
    folder, heard, clock = tmp_path_factory.mktemp("served"), {}, InStep()
    with ServedDrive(mission(), "127.0.0.1:0", truth=True, clock=clock) as operator:
        clock.drive = operator
        client = threading.Thread(target=listen, args=(operator.url, heard))
        client.start()
        drive = drive_by_commands(ground(), SHORT, mission(), folder / "recording", operator)
        report = operator.finish()
        client.join()
    drive.write(folder)
    return drive, heard, report, folder


def test_the_rover_drives_as_commanded_and_stops_without_commands(served):
    drive, _, report, _ = served
    path = drive.truth.trajectory
    assert drive.ending is Ending.BY_OPERATOR
    assert (report.stops, report.commands) == (1, round(COMMANDED_S * 20))
    moved = np.hypot(*(path.position[:, :2] - path.position[0, :2]).T)
    at = [int(np.searchsorted(path.time_s, seconds - 1e-6)) for seconds in (1.0, 2.5, 3.3, END_S)]
    assert moved[at[0]] < 0.05  # it stands in the first second
    assert moved[at[1]] - moved[at[0]] > 0.3
    assert moved[at[3]] - moved[at[2]] < 0.02  # half a second after the last command
    _, _, z, w = path.quaternion[-1]
    assert 0.3 < 2.0 * np.arctan2(z, w) < 1.2  # to the left, from a heading of 0


def test_the_client_receives_what_is_recorded(served):
    drive, heard, report, folder = served
    recording = Recording.read(folder / "recording")
    assert (
        len(heard["/camera/image"]) == len(recording.frames) == report.images == report.sent["/camera/image"]
    )
    assert (report.late_images, report.dropped) == (0, {})
    jpeg = np.frombuffer(base64.b64decode(heard["/camera/image"][5]["data"]), np.uint8)
    seen = cv2.imdecode(jpeg, cv2.IMREAD_GRAYSCALE).astype(float)
    assert np.abs(seen - recording.frames[5]).mean() < 6.0  # JPEG loses some of the noise
    assert len(heard["/imu/data"]) == len(recording.inertial)
    rate = heard["/imu/data"][150]["angular_velocity"]
    assert [rate[axis] for axis in "xyz"] == recording.inertial.gyro_rad_s[150].tolist()
    degrees = transformed(recording.gps.position[:, :2], recording.crs, WGS84, "the test")
    assert [(fix["longitude"], fix["latitude"]) for fix in heard["/gps/fix"]] == [
        *map(tuple, degrees.tolist())
    ]
    assert heard["/wheel/odometry"][-1]["right_m"] == recording.wheels.right_m[-1]
    real = heard["/ground_truth/pose"][-1]["pose"]["position"]
    place = drive.truth.trajectory.position[-1] - recording.start
    assert [real[axis] for axis in "xyz"] == pytest.approx(place.tolist())


def test_wheel_odometry_is_that_of_the_bags(served):
    from survey.interchange.drive_bags import _rolled_path

    _, heard, _, folder = served
    path = _rolled_path(Recording.read(folder / "recording").wheels, mission().physics.track_gauge_m)
    poses = [one["pose"]["position"] for one in heard["/wheel/odometry"]]
    assert np.array([[one["x"], one["y"]] for one in poses]) == pytest.approx(path.position[:, :2])


def test_frames_are_placed_by_calibration_and_start(served):
    _, heard, _, folder = served
    recording = Recording.read(folder / "recording")
    links = {one["child_frame_id"]: one for one in heard["/tf_static"][0]["transforms"]}
    assert set(links) == {"camera", "gps", "imu", "odom", "map"}
    place = links["map"]["translation"]
    assert [place[axis] for axis in "xyz"] == recording.start.tolist()
    mount = links["camera"]["translation"]
    assert [mount[axis] for axis in "xyz"] == recording.camera.T_body_camera[:3, 3].tolist()
    assert heard["/camera/calibration"][0]["distortion_model"] == "kannala_brandt"
    assert heard["/camera/calibration"][0]["K"] == recording.camera.matrix.ravel().tolist()


def test_real_poses_are_no_topic_unless_asked_for():
    with ServedDrive(mission(), "127.0.0.1:0") as operator, connect(operator.url, subprotocols=["foxglove.sdk.v1"]) as link:  # fmt: skip
        link.recv()
        assert "ground_truth" not in link.recv()


def test_a_drive_that_nobody_joins_is_ended_by_its_operator(tmp_path):
    from survey import InputError

    with ServedDrive(mission(), "127.0.0.1:0") as operator:
        operator.stop()
        with pytest.raises(InputError, match="with fewer than two GPS fixes"):
            drive_by_commands(ground(), SHORT, mission(), tmp_path / "recording", operator)


@pytest.mark.parametrize(
    ("content", "named"),
    [
        ({"linear": {"x": 1.1}}, "at most 1 m/s and 0.8 rad/s"),
        ({"angular": {"z": -0.9}}, "at most 1 m/s and 0.8 rad/s"),
        ({"linear": {"x": float("nan")}}, "at most 1 m/s"),
        ({"linear": {"x": 10**400}}, "at most 1 m/s"),
        ({"linear": {"x": 0.1, "y": 0.1}}, "cannot follow"),
        ({"linear": {"x": "0.1"}}, "malformed"),
        ({"linear": 0.1}, "malformed"),
        ([0.1], "malformed"),
    ],
)
def test_commands_that_cannot_be_followed_are_refused(content, named):
    commands = Commands(1.0, 0.8)
    assert named in commands.receive("/cmd_vel", content)
    assert (commands.n_refused, commands.n_received) == (1, 0)
    assert "publish commands to /cmd_vel" in commands.receive("/other", {})


def test_a_late_image_is_counted():
    class Late(RealTime):
        def now_s(self):
            return 10.3

    drive = ServedDrive(mission(), "127.0.0.1:0", clock=Late())
    with drive:
        drive._count_image(10.25)
        drive._count_image(10.0)
        report = drive.finish()
    assert (report.images, report.late_images) == (2, 1)
    assert report.most_delay_s == pytest.approx(0.3)


@pytest.mark.long
def test_the_command_serves_and_writes_a_run_that_other_commands_continue(tmp_path):
    from benchmarks.closed_loop import drive

    (tmp_path / "mission.toml").write_text(IMAGES, encoding="utf-8")
    command = [sys.executable, "-m", "firnline"]
    options = ["--serve", "--listen", "127.0.0.1:0", "--runs", str(tmp_path / "runs")]
    with subprocess.Popen([*command, "simulate", str(tmp_path / "mission.toml"), *options], stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as server:  # fmt: skip
        url = server.stderr.readline().split(": ")[0]
        driver, _ = drive(url, 3.0)
        server.send_signal(signal.SIGINT)
        out, _ = server.communicate(timeout=120)
    assert server.returncode == 0, out
    assert driver.images >= 13
    assert "ended by the operator after" in out
    (run,) = (tmp_path / "runs").glob("images-served-*/latest")
    account = json.loads((run / "2-simulate" / "served.json").read_text(encoding="utf-8"))
    assert account["images"] == account["sent"]["/camera/image"] >= driver.images
    for further in (["export", str(run), str(tmp_path / "euroc"), "--as", "euroc"], ["show", str(run)]):
        result = CliRunner().invoke(app, further)
        assert result.exit_code == 0, result.output


@pytest.mark.parametrize(
    ("options", "code", "said"),
    [
        (["--serve", "--set", "fidelity=statistical"], 4, "add --set fidelity=vision"),
        (["--serve", "--set", "fleet.rovers=2"], 4, "one is served"),
        (["--listen", "127.0.0.1:0"], 4, "add --serve"),
        (["--serve", "--listen", "8765"], 4, "HOST:PORT was expected"),
        (["--serve", "--listen", "127.0.0.1:0"], 0, "images-served-"),
    ],
)
def test_a_dry_run_checks_what_would_be_served(tmp_path, options, code, said):
    (tmp_path / "mission.toml").write_text(IMAGES, encoding="utf-8")
    arguments = ["simulate", str(tmp_path / "mission.toml"), "--dry-run", "--runs", str(tmp_path / "runs")]
    result = CliRunner().invoke(app, [*arguments, *options])
    assert (result.exit_code, said in " ".join(result.output.split())) == (code, True), result.output
    assert not (tmp_path / "runs").exists()
