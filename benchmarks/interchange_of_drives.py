"""Exported drives and worlds, read by the programs that they are for: ``python -m benchmarks.interchange_of_drives``.

A drive in images with a LiDAR is simulated, and exported in every format without being localized. Each format is read by a
reader that is not ours: rosbags (every message deserialized), mcap, ORB-SLAM3 (it gets the images of EuRoC's layout; inertial
readings and real poses are read by the rules of that layout), pykitti, trimesh, and
libsdformat, whose check of a world is that of ``gz sdf --check``. ``FIRNLINE_PEERS`` names a Python with pyorbslam3, pykitti,
trimesh and OpenCV; rows of readers that are not installed are left out. The ROS 2 bag is localized, too, and its path
compared with those of the same records and of all records of the run.
"""

import ctypes
import json
import os
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.peers_in_vision.vocabulary import write_vocabulary
from benchmarks.report import Row, main
from firnline import actions
from survey import Recording, Trajectory
from survey.core import FloatArray
from survey.core.run_folder import RunFolder

MISSION = Path(__file__).parents[1] / "examples" / "short_drive.toml"
_SETTINGS = ("planner.swaths=1", "sensors.lidar.beams=16", "sensors.lidar.columns=256")
_SMALL = (
    "area.bounds_m=[526025.0, 6478040.0, 526033.0, 6478048.0]", "physics.engine=kinematic",
    "physics.steer_by=position", "imaging.width=160", "imaging.height=120", "satellite.cell_m=4.0",
)  # fmt: skip
_PYTHON = os.environ.get("FIRNLINE_PEERS", sys.executable)
_SCRIPT = Path(__file__).with_name("interchange_peers.py")
_EVERY = 6


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows of every format, and those of the localized bag."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        settings = [*_SETTINGS, *(_SMALL if quick else ())]
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
    """Yield how far the path by the bag is from that by the same records, and from that by all that the rover sensed."""
    recording = Recording.read(run.folder("simulate") / "recording")
    gps = recording.gps
    # What a bag has no place for: the surveyed start, and readings without a common message.
    carried = replace(
        recording, start=gps.position[0], start_is_surveyed=False, barometer=None, compass=None, weather=None
    )
    carried.write(folder / "carried")
    sources = {
        "bag": folder / "ros2",
        "carried": folder / "carried",
        "all": run.folder("simulate") / "recording",
    }
    paths = {name: _path_of(place, 0.5 if name == "bag" else None) for name, place in sources.items()}
    for name, what, limit in (("carried", "the records in it", 0.1), ("all", "all records of the run", None)):
        off, sigma = _apart(paths["bag"], paths[name])
        yield Row(f"localized ROS 2 bag: largest distance from the path by {what}", float(off.max()), "m")
        title = f"localized ROS 2 bag: largest distance from the path by {what}, over its own σ"
        ratio = float((off / sigma).max())
        yield Row(title, ratio, "σ") if limit is None else Row.of(title, ratio, "σ", "<=", limit)


def _path_of(source: Path, antenna_m: float | None) -> Trajectory:
    path = actions.localize(actions.LocalizeRequest(source=source, antenna_m=antenna_m)).estimate.trajectory
    assert path is not None
    return path


def _apart(path: Trajectory, other: Trajectory) -> tuple[FloatArray, FloatArray]:
    """Return distances (N, 3) of a path from another at its own poses, and its standard deviations (N, 3) [m]."""
    at_s = path.time_s + other.time_s[0] - path.time_s[0]
    there = np.column_stack([np.interp(at_s, other.time_s, axis) for axis in other.position.T])
    return np.abs(there - path.position), np.sqrt(np.diagonal(path.covariance, axis1=1, axis2=2))


if __name__ == "__main__":
    main("Interchange of drives", measure, ("numpy", "rosbags", "mcap"))
