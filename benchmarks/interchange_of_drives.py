"""Exported drives and worlds, read by the programs that they are for: ``python -m benchmarks.interchange_of_drives``.

A drive in images with a LiDAR is simulated, and exported in every format without being localized. Each format is read by a
reader that is not ours: rosbags (every message deserialized), mcap, ORB-SLAM3 on EuRoC's layout, pykitti, trimesh, and
libsdformat, whose check of a world is that of ``gz sdf --check``. ``FIRNLINE_PEERS`` names a Python with pyorbslam3, pykitti,
trimesh and OpenCV; rows of readers that are not installed are left out. The ROS 2 bag is localized, too, and its path
compared with the one of the same recording.
"""

import ctypes
import json
import os
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.peers_in_vision.vocabulary import write_vocabulary
from benchmarks.report import Row, main
from firnline import actions
from survey import Recording, Trajectory
from survey.core.run_folder import RunFolder

MISSION = Path(__file__).parents[1] / "examples" / "short_drive.toml"
_LIDAR = ("sensors.lidar.beams=16", "sensors.lidar.columns=256")
_SMALL = (
    "area.bounds_m=[526025.0, 6478040.0, 526033.0, 6478048.0]", "planner.swaths=1", "physics.engine=kinematic",
    "physics.steer_by=position", "imaging.width=160", "imaging.height=120", "satellite.cell_m=4.0",
)  # fmt: skip
_PYTHON = os.environ.get("FIRNLINE_PEERS", sys.executable)
_SCRIPT = Path(__file__).with_name("interchange_peers.py")
_EVERY = 6


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows of every format, and those of the localized bag."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        settings = [*_LIDAR, *(_SMALL if quick else ())]
        made = actions.simulate(
            actions.SimulateRequest(mission=MISSION, runs=folder / "runs", settings=settings)
        )
        yield from _bags(made.run, folder)
        yield from _layouts(made.run, folder)
        yield from _worlds(made.run, folder)
        if not quick:
            yield from _localized(made.run, folder)


def _export(run: RunFolder, out: Path, name: str | None = None) -> Path:
    actions.export(actions.ExportRequest(source=run.path, out=out, holds=name)).write()
    return out


def _rows(name: str, reader: str, written: int, read: int, place: Path) -> Iterator[Row]:
    """Yield the number of records that were written, the share that a reader got, and the size."""
    files = [place] if place.is_file() else [file for file in place.rglob("*") if file.is_file()]
    yield Row(f"{name}: written", float(written), "records")
    yield Row.of(f"{name}: read by {reader}", read / written, "of those written", ">=", 1.0)
    yield Row(f"{name}: size", sum(file.stat().st_size for file in files) / 1e6, "MB")


def _bags(run: RunFolder, folder: Path) -> Iterator[Row]:
    written = _written(run)
    for name, file, kind in (
        ("ROS 2 bag", "ros2", "ros2"),
        ("ROS 1 bag", "drive.bag", "ros1"),
        ("MCAP, ROS 2 messages", "ros2.mcap", "ros2"),
    ):
        place = _export(run, folder / file, kind)
        read = _by_rosbags(place)
        same = sum(min(read[topic], n) for topic, n in written.items())
        yield from _rows(name, "rosbags", sum(written.values()), same, place)
    yield from _foxglove(run, folder)


def _written(run: RunFolder) -> Counter[str]:
    """Return the records of the drive by the topics of a bag, one message each."""
    place = run.folder("simulate")
    recording = Recording.read(place / "recording")
    real = Trajectory.read(place / "truth" / "trajectory.tum", recording.crs)
    assert recording.frames is not None
    parts: dict[str, Any] = {
        "/camera/image_raw": recording.frames,
        "/camera/camera_info": recording.frames,
        "/imu/data": recording.inertial,
        "/gps/fix": recording.gps,
        "/wheel/odometry": recording.wheels,
        "/lidar/points": recording.lidar,
        "/ground_truth/odometry": real.time_s,
    }
    return Counter({topic: len(part) for topic, part in parts.items()})


def _by_rosbags(place: Path) -> Counter[str]:
    """Return how many messages of each topic rosbags deserializes."""
    from rosbags.highlevel import AnyReader

    found: Counter[str] = Counter()
    with AnyReader([place]) as reader:
        for connection, _, raw in reader.messages():
            reader.deserialize(raw, connection.msgtype)
            found[connection.topic] += 1
    return found


def _foxglove(run: RunFolder, folder: Path) -> Iterator[Row]:
    from mcap.reader import make_reader

    place = _export(run, folder / "viewer.mcap")
    with place.open("rb") as stream:
        topics = [
            channel.topic
            for _, channel, message in make_reader(stream).iter_messages()
            if json.loads(message.data)
        ]
    written = _written(run)["/camera/image_raw"] + 1  # and the real path
    yield from _rows("MCAP, Foxglove's schemas", "mcap", written, len(topics), place)


def _layouts(run: RunFolder, folder: Path) -> Iterator[Row]:
    written = _written(run)
    n_images = written["/camera/image_raw"]
    frames = Recording.read(run.folder("simulate") / "recording").frames
    assert frames is not None
    write_vocabulary(folder / "vocabulary.txt", (frames[k] for k in range(0, len(frames), _EVERY)))
    place = _export(run, folder / "euroc", "euroc")
    read = _by_peer("euroc", place)
    if read is not None:
        n = n_images + written["/imu/data"] + written["/ground_truth/odometry"]
        yield from _rows("EuRoC", "ORB-SLAM3", n, sum(read.values()), place)
    place = _export(run, folder / "sequences" / "00", "kitti")
    (folder / "poses").mkdir()
    (folder / "poses" / "00.txt").symlink_to(place / "poses.txt")
    read = _by_peer("kitti", folder)
    if read is not None:
        n = 3 * n_images + written["/lidar/points"]
        yield from _rows("KITTI", "pykitti", n, sum(read.values()), place)


def _by_peer(kind: str, place: Path) -> dict[str, Any] | None:
    """Return what a peer reads in its Python; None where that has no such package."""
    command = [_PYTHON, str(_SCRIPT), kind, str(place)]
    done = subprocess.run(command, check=False, capture_output=True, text=True, errors="replace")
    if done.returncode and "ModuleNotFoundError" in done.stderr:
        return None
    if done.returncode:
        raise RuntimeError(done.stderr)
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def _worlds(run: RunFolder, folder: Path) -> Iterator[Row]:
    for name, file in (("glTF", "site.glb"), ("OBJ", "site.obj")):
        (folder / name).mkdir()
        made = actions.export(actions.ExportRequest(source=run.path, out=folder / name / file)).write()
        written = int(made.text.rsplit("mesh of ", 1)[1].split()[0])
        read = _by_peer("mesh", folder / name / file)
        if read is not None and read["texels"] > 1:
            yield from _rows(name, "trimesh, with the texture", written, read["vertices"], folder / name)
    (folder / "SDF").mkdir()
    world = _export(run, folder / "SDF" / "site.sdf")
    try:
        library = ctypes.CDLL("libsdformat12.so.12")
    except OSError:
        return
    yield from _rows(
        "SDF", "libsdformat 12, checked", 1, int(library.cmdCheck(str(world).encode()) == 0), folder / "SDF"
    )


def _localized(run: RunFolder, folder: Path) -> Iterator[Row]:
    """Yield how far the path by the bag is from that by the recording, over the standard deviation that both state."""
    recording, bag = (
        actions.localize(actions.LocalizeRequest(source=source, antenna_m=antenna_m)).estimate.trajectory
        for source, antenna_m in ((run.folder("simulate") / "recording", None), (folder / "ros2", 0.5))
    )
    assert recording is not None
    assert bag is not None
    at_s = recording.time_s + bag.time_s[0] - recording.time_s[0]
    there = np.column_stack([np.interp(at_s, bag.time_s, axis) for axis in bag.position.T])
    off = np.abs(there - recording.position)
    sigma = np.sqrt(np.diagonal(recording.covariance, axis1=1, axis2=2))
    yield Row(
        "localized: largest distance of the path by the ROS 2 bag from that by the recording", off.max(), "m"
    )
    yield Row.of(
        "localized: largest distance over its standard deviation", (off / sigma).max(), "σ", "<=", 1.0
    )


if __name__ == "__main__":
    main("Interchange of drives", measure, ("numpy", "rosbags", "mcap"))
