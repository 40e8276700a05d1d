"""Visual SLAM on drives whose world is known, and on a real camera.

Run with ``python -m benchmarks.visual_slam``. Drives are those of ``examples/glacier_drive.toml``, 280 m with four
turns and wheels that are 1.5 % off, with other seeds than the settings were chosen on; their images are rendered
once and stored in the system's folder for temporary files, as are the figures of each drive. Positions are judged without any alignment but the pose at
the start, which is given, unless Sim(3) is said. No fix is used: the scale is that of the wheels, as the height of
the camera above the ground corrects it.

Processors differ: where ``FIRNLINE_EARLIER`` names a checkout of commit e7dc4dd with an environment of its own, its
visual SLAM processes the images of the first drive in turn with today's, for the ratio. The bar of 25 frames was set
where that commit processed 20 on its slowest drive.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from benchmarks.image_surveys import keep
from benchmarks.report import Row, main
from benchmarks.stored_parts import parts_folder, simulated_folder, stored
from survey.core.arrays import FloatArray
from survey.data.dem import Dem
from survey.data.frames import Frames, Image
from survey.data.recording import Recording
from survey.data.trajectory import Trajectory
from vision_slam.config import VisualOdometryConfig
from vision_slam.evaluation import absolute_errors_m
from vision_slam.motion import MotionSensors
from vision_slam.odometry.visual_odometry import visual_odometry
from vision_slam.odometry.window import half_turned
from vision_slam.readers.sequence import scale_by_reference
from vision_slam.recordings import read_sequence

# The settings were chosen on seeds 11 to 13 and 21 to 25. With seed 28 the rover is stuck on a hummock for good after
# 13.5 m: no drive to take shares of the way of; its odometry ends 0.64 m off.
# With seed 29 it drives over a dirt cone that turns the camera by 25 degrees from one image to the next. The map is
# too small for some metres after that, so that 285 of 13,175 landmarks have four fifths of the squared errors.
SEEDS = (26, 27, 29, 30, 31)
DRIVES = simulated_folder("drives")
MISSION = Path(__file__).parents[1] / "examples" / "glacier_drive.toml"
KITTI = Path(__file__).parents[2] / "shared" / "data" / "seq_kitti_mini" / "KITTI_sequence_1"
EARLIER = os.environ.get("FIRNLINE_EARLIER")
BAR, BAR_EARLIER = 25.0, 20.0
# 1.8 % of contrast, of which 0.7 % are the sensor's noise.
FAINT = ("appearance.contrast=0.5", "appearance.ridges_deg=0.0")
_NEW_FIELDS = ("camera_height_m", "start_is_surveyed")
_TIMED = (
    "import sys, cv2; from pathlib import Path; from benchmarks.visual_slam import _driven; cv2.setNumThreads(1); "
    "print(_driven(Path(sys.argv[1]))['speed'])"
)
SHORT = ("planner.swaths=1", "area.bounds_m=[526040.0, 6478040.0, 526070.0, 6478060.0]")


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows."""
    if KITTI.is_dir():
        yield _real_camera()
    if quick:
        yield from _drives("drive of 30 m: ", [_judged(SEEDS[0], SHORT)])
        return
    yield from _drives("", [_judged(seed) for seed in SEEDS])
    if EARLIER is not None:
        yield from _ratio(Path(EARLIER), rendered_drive(SEEDS[0]))
    for clip in (4.0, 0.0):
        yield from _faint(bool(clip), [_judged(seed, FAINT, clip) for seed in SEEDS[:2]])


def _faint(is_enhanced: bool, done: list[dict[str, float]]) -> Iterator[Row]:
    """Snow of half the contrast under an empty horizon, with and without CLAHE."""
    name = f"faint snow, no mountains, {'with' if is_enhanced else 'without'} CLAHE: "
    drift, lost = (max(drive[key] for drive in done) for key in ("drift", "lost"))
    if is_enhanced:
        blindly = max(drive["blindly"] for drive in done)
        yield Row(
            "faint snow, no mountains, wheels and gyro without any image: end drift, worst", blindly, "%"
        )
        yield Row.of(f"{name}end drift, worst", drift, "%", "<=", 2.5)
    else:
        least = min(drive["drift"] for drive in done)
        is_broken = all(drive["drift"] > 10.0 or drive["lost"] > 0.0 for drive in done)
        yield Row(f"{name}end drift, worst", drift, "%")
        yield Row(f"{name}end drift, least", least, "%", "> 10 or lost", is_broken)
    yield Row(f"{name}frames that wheels and gyro bridged, most", max(drive["blind"] for drive in done), "1")
    yield Row(f"{name}share of frames declared lost, most", lost, "1")
    yield Row(f"{name}landmarks per metre, least", min(drive["landmarks"] for drive in done), "1/m")


def _drives(name: str, done: list[dict[str, float]]) -> Iterator[Row]:
    def all_of(key: str) -> FloatArray:
        return np.array([drive[key] for drive in done])

    yield Row.of(f"{name}frames per CPU second, slowest drive", all_of("speed").min(), "1/s", ">=", BAR)
    yield Row.of(
        f"{name}image to pose, 95th percentile, worst drive", all_of("latency").max(), "ms", "<=", 100.0
    )
    yield Row.of(f"{name}end drift, worst", all_of("drift").max(), "%", "<=", 1.5)
    yield Row.of(
        f"{name}end drift, worst, by the bar for an estimated scale (by the camera's height, no fixes)",
        all_of("drift").max(),
        "%",
        "<=",
        0.8,
    )
    yield Row(f"{name}end drift, median", float(np.median(all_of("drift"))), "%")
    yield Row(f"{name}drift of the wheels' travel alone, worst", all_of("wheels").max(), "%")
    yield Row.of(f"{name}Sim(3) ATE per path, worst", all_of("shape").max(), "%", "<=", 0.2)
    yield Row(f"{name}Sim(3) ATE per path, median", float(np.median(all_of("shape"))), "%")
    yield Row.of(f"{name}landmarks per metre, least", all_of("landmarks").min(), "1/m", ">=", 40.0)
    yield Row(f"{name}landmarks per metre, median", float(np.median(all_of("landmarks"))), "1/m")
    yield Row.of(f"{name}landmarks first seen > 5 m, least", all_of("distant").min(), "1/m", ">=", 5.0)
    yield Row.of(f"{name}local elevation RMSE, worst", all_of("elevation").max(), "m", "<=", 0.10)
    yield Row(f"{name}local elevation RMSE, median", float(np.median(all_of("elevation"))), "m")
    normalized = all_of("normalized")
    held = bool((normalized >= 0.8).all() and (normalized <= 1.3).all())
    yield Row(f"{name}normalized local elevation error, least", normalized.min(), "1", "0.8 to 1.3", held)
    yield Row(f"{name}normalized local elevation error, most", normalized.max(), "1", "0.8 to 1.3", held)


def _ratio(earlier: Path, folder: Path) -> Iterator[Row]:
    """Yield the frames per CPU second of an earlier checkout, and those of today over them."""
    with tempfile.TemporaryDirectory() as place:
        copied = Path(place) / "drive" / "2-simulate"
        shutil.copytree(folder, copied)
        header = copied / "recording" / "recording.json"
        read = json.loads(header.read_text())
        # Fields that the earlier reader does not know.
        header.write_text(json.dumps({key: read[key] for key in read if key not in _NEW_FIELDS}))
        program = [str(earlier / ".venv" / "bin" / "python"), "-c", _TIMED, str(copied)]
        setting = os.environ | {"PYTHONPATH": str(earlier)}
        done = subprocess.run(program, cwd=earlier, env=setting, check=True, capture_output=True, text=True)
    before, today = float(done.stdout.split()[-1]), _driven(folder)["speed"]
    yield Row("one drive, frames per CPU second of e7dc4dd", before, "1/s")
    name = "one drive, frames per CPU second over those of e7dc4dd"
    yield Row.of(name, today / before, "x", ">=", BAR / BAR_EARLIER)


def rendered_drive(seed: int, settings: tuple[str, ...] = ()) -> Path:
    """Return the folder of a rendered drive, rendered now if it has not been yet."""
    words = [str(seed), *settings]
    runs = DRIVES / "-".join(re.sub(r"[^\w.,]+", "_", word).strip("_") for word in words)
    made = runs / "glacier-drive" / "latest" / "2-simulate"
    if not (made / "recording" / "recording.json").exists():
        chosen = [word for text in (f"seed={seed}", *settings) for word in ("--set", text)]
        program = [sys.executable, "-m", "firnline.cli.main", "simulate"]
        command = [*program, str(MISSION), "--runs", str(runs), *chosen]
        subprocess.run(command, check=True, capture_output=True, stdin=subprocess.DEVNULL)
    return made


def _judged(seed: int, settings: tuple[str, ...] = (), clip: float | None = None) -> dict[str, float]:
    """Return the figures of one drive, stored for as long as the code stays the same."""
    config = None if clip is None else VisualOdometryConfig(clahe_clip=clip)
    words = "-".join(re.sub(r"\W+", "_", word) for word in (str(seed), *settings, str(clip)))
    file = parts_folder("visual-slam", "benchmarks/visual_slam.py") / f"{words}.json"
    figures: dict[str, float] = stored(file, lambda: _driven(rendered_drive(seed, settings), config))
    return figures


def _driven(folder: Path, config: VisualOdometryConfig | None = None) -> dict[str, float]:
    """Run visual SLAM over one drive, image by image, and judge it by the world."""
    recording = Recording.read(folder / "recording")
    assert recording.frames is not None
    clocked = _Clocked(recording.frames)
    recording = replace(recording, frames=Frames(recording.frames.time_s, clocked))
    found = visual_odometry(recording, config, clocked.done)
    if config is None:
        keep(folder.parent, found)
    seconds = np.array(clocked.seconds[1:])
    times = found.odometry.time_s
    place, turn = _reference(folder / "truth" / "trajectory.tum", times, recording)
    own = Rotation.from_euler("xyz", found.odometry.attitude_rad).as_matrix()
    steps = np.einsum("nij,nj->ni", turn[0] @ own[0].T @ own[:-1], found.odometry.step)
    path = place[0] + np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
    length = float(np.linalg.norm(np.diff(place, axis=0), axis=1).sum())
    assert recording.wheels is not None
    rolled = 0.5 * (recording.wheels.left_m + recording.wheels.right_m)[-1]
    seen = found.sightings
    landmark = place[seen.pose] + np.einsum("nij,nj->ni", turn[seen.pose], seen.offset)
    ground = Dem.read(folder / "truth" / "dem.tif").at(landmark[:, :2])
    upward = turn[seen.pose, 2]
    sigma = np.sqrt(np.einsum("ni,nij,nj->n", upward, seen.covariance, upward))
    near = np.isfinite(ground) & (sigma < 0.5)
    off = (landmark[:, 2] - ground)[near]
    return {
        "speed": 1.0 / float(seconds.mean()),
        "latency": 1e3 * float(np.percentile(seconds, 95.0)),
        "drift": 100.0 * float(np.linalg.norm(path[-1] - place[-1])) / length,
        "blindly": 100.0
        * float(np.linalg.norm(_blindly(recording, turn[0]) - place[-1] + place[0]))
        / length,
        "wheels": 100.0 * abs(rolled / length - 1.0),
        "shape": 100.0 * float(np.sqrt(np.mean(absolute_errors_m(path, place, "sim3") ** 2))) / length,
        "landmarks": len(seen.pose) / length,
        "distant": float((seen.range_m > 5.0).sum()) / length,
        "elevation": float(np.sqrt(np.mean(off**2))),
        "normalized": float(np.sqrt(np.mean((off / sigma[near]) ** 2))),
        "blind": float(sum(not frame.is_visual for frame in found.health[1:])),
        "lost": float(found.is_lost.mean()),
    }


def _blindly(recording: Recording, turn: FloatArray) -> FloatArray:
    """Where wheels and gyro alone, with its bias from the rest at the start, put the last image beside the first [m]."""
    assert recording.frames is not None
    sensors, times, place = MotionSensors(recording), recording.frames.time_s.tolist(), np.zeros(3)
    for first_s, last_s in pairwise(times):
        motion = sensors.between(first_s, last_s)
        assert motion.rotation is not None
        place = place + turn @ half_turned(motion.rotation) @ [motion.travel_m, 0.0, 0.0]
        turn = turn @ motion.rotation
    return place


class _Clocked:
    """Image sequence that records the CPU time between its images, without their reading [s]."""

    def __init__(self, images: Frames) -> None:
        self.seconds: list[float] = []
        self._images, self._began = images, 0.0

    def __len__(self) -> int:
        return len(self._images)

    def __getitem__(self, index: int) -> Image:
        image = self._images[index]
        self._began = time.process_time()
        return image

    def done(self, _stage: str, _n: int, _n_all: int) -> None:
        """Take the time since the image was there."""
        self.seconds.append(time.process_time() - self._began)


def _reference(file: Path, times: FloatArray, recording: Recording) -> tuple[FloatArray, FloatArray]:
    real = Trajectory.read(file, recording.crs)
    place = np.column_stack([np.interp(times, real.time_s, axis) for axis in real.position.T])
    turns = Slerp(real.time_s, Rotation.from_quat(real.quaternion))
    return place, turns(times.clip(*real.time_s[[0, -1]])).as_matrix()


def _real_camera() -> Row:
    """End error on the streets of Karlsruhe, scale from the first 10 m."""
    sequence = read_sequence(KITTI)
    assert sequence.reference is not None
    found = visual_odometry(scale_by_reference(sequence, 10.0))
    turns = Rotation.from_euler("xyz", found.odometry.attitude_rad[:-1]).as_matrix()
    end = np.einsum("nij,nj->i", turns, found.odometry.step)
    reference = sequence.reference[:, :3, 3]
    length = np.linalg.norm(np.diff(reference, axis=0), axis=1).sum()
    error = 100.0 * np.linalg.norm(end - (reference[-1] - reference[0])) / length
    return Row.of("KITTI, 60 m, scale of the first 10 m: end error", error, "%", "<=", 1.5)


if __name__ == "__main__":
    cv2.setNumThreads(1)
    main("Visual SLAM", measure, packages=("numpy", "scipy", "opencv-python-headless"))
