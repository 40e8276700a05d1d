"""Programs that find a path from images: firnline, an odometry of OpenCV's functions, ORB-SLAM3 and COLMAP.

The last two run in the Python that ``FIRNLINE_PEERS`` names, else in this one. What each program found on a drive is stored
as it is found, for as long as the code that runs it stays the same: ours is that of vision_slam.
"""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.peers_in_vision.drives import PeerDrive, drives
from benchmarks.peers_in_vision.opencv_odometry import OpenCvOdometry
from benchmarks.peers_in_vision.vocabulary import write_vocabulary
from benchmarks.report import cpu_seconds
from benchmarks.stored_parts import code_digest, stored
from survey.core.arrays import FloatArray, IntArray
from survey.core.errors import FirnlineError
from survey.data.frames import Frames
from vision_slam.evaluation import compare_from_start
from vision_slam.pipeline import localize_images
from vision_slam.readers.sequence import scale_by_reference

OURS, OPENCV, ORB_SLAM3, COLMAP = "firnline", "OpenCV odometry", "ORB-SLAM3", "COLMAP"
_SCALE_FROM_M = 10.0
_NAMES = {ORB_SLAM3: "orbslam3", COLMAP: "colmap"}
_PYTHON = os.environ.get("FIRNLINE_PEERS", sys.executable)
_SCRIPT = Path(__file__).with_name("peer_script.py")
_HERE = "benchmarks/peers_in_vision"
_CODE_OF = {
    OURS: ("vision_slam", f"{_HERE}/drives.py", f"{_HERE}/programs.py"),
    OPENCV: (f"{_HERE}/opencv_odometry.py", f"{_HERE}/drives.py"),
    ORB_SLAM3: (f"{_HERE}/peer_script.py", f"{_HERE}/vocabulary.py", f"{_HERE}/drives.py"),
    COLMAP: (f"{_HERE}/peer_script.py", f"{_HERE}/drives.py"),
}
# ORB-SLAM3 maps in a thread of its own, and no two of its runs are alike: the run with the median error counts.
_RUNS_ON_STREETS = {ORB_SLAM3: 3}
# COLMAP gets images at least so far apart [s], and no more than so many: its time grows with their square.
_COLMAP_STEP_S, _COLMAP_MOST = 0.19, 50
_VOCABULARY_EVERY = 6
_WARM_UP = 12


@dataclass(frozen=True)
class FoundPath:
    """Poses of the camera (K, 4, 4) at the images `index` (K,), and the CPU time of all images [s].

    `n_given`: number of images that the program got. `nees_2d`: mean normalised squared error, 2 for true covariances; NaN
    where none are stated. `failed`: why there is no path.
    """

    index: IntArray
    poses: FloatArray
    cpu_s: float
    n_given: int
    nees_2d: float = float("nan")
    failed: str = ""

    @classmethod
    def of(cls, facts: dict[str, Any]) -> "FoundPath":
        """Return what was stored."""
        index, poses = np.array(facts["index"], dtype=np.int64), np.array(facts["poses"]).reshape(-1, 4, 4)
        return cls(**{**facts, "index": index, "poses": poses})

    def facts(self) -> dict[str, Any]:
        """Return the fields as they are stored."""
        return {**vars(self), "index": self.index.tolist(), "poses": self.poses.reshape(-1, 16).tolist()}


def programs_for(drive: PeerDrive) -> list[str]:
    """Return the programs that run on a drive: COLMAP on streets alone, for 100 images take it many minutes."""
    return [name for name in PROGRAMS if name != COLMAP or not drive.is_snow]


def found_paths(drive: PeerDrive, program: str) -> list[FoundPath]:
    """Return what each run of a program found on a drive, stored ones where there are any."""
    folder = Path(tempfile.gettempdir()) / "firnline-peers-in-vision" / code_digest(_CODE_OF[program])
    return [
        FoundPath.of(
            stored(
                folder / f"{drive.name}-{program}-{k}.json".replace(" ", "_"), partial(_facts, drive, program)
            )
        )
        for k in range(1 if drive.is_snow else _RUNS_ON_STREETS.get(program, 1))
    ]


def _facts(drive: PeerDrive, program: str) -> dict[str, Any]:
    return PROGRAMS[program](drive).facts()


def _ours(drive: PeerDrive) -> FoundPath:
    """Run our localization of images alone, with the scale of the reference's first metres."""
    sequence = replace(drive.sequence, frames=Frames(drive.time_s, drive.images))
    first = Frames(drive.time_s[:_WARM_UP], drive.images)
    localize_images(
        replace(sequence, frames=first, reference=None, reference_time_s=None)
    )  # loads compiled loops
    scaled = scale_by_reference(sequence, _SCALE_FROM_M)
    try:
        estimate, cpu_s = cpu_seconds(lambda: localize_images(scaled))
    except FirnlineError as refusal:
        return _failure(str(refusal), len(drive.time_s))
    poses = np.tile(np.eye(4), (len(estimate.time_s), 1, 1))
    poses[:, :3, :3] = Rotation.from_quat(estimate.quaternion).as_matrix()
    poses[:, :3, 3] = estimate.position
    assert sequence.reference_time_s is not None
    assert sequence.reference is not None
    tracked = estimate.T_body_tracked
    compared = compare_from_start(estimate, sequence.reference_time_s, sequence.reference @ tracked)
    index = np.abs(drive.time_s[:, None] - estimate.time_s).argmin(axis=0)
    is_followed = np.ones(len(index), dtype=bool) if estimate.is_lost is None else ~estimate.is_lost
    cameras = poses @ np.linalg.inv(tracked) @ sequence.camera.T_body_camera
    nees_2d = compared.figures["nees_2d"]
    return FoundPath(index[is_followed], cameras[is_followed], cpu_s, len(drive.time_s), nees_2d)


def _opencv(drive: PeerDrive) -> FoundPath:
    """Run the odometry of OpenCV's functions."""
    cv2.setRNGSeed(0)
    odometry = OpenCvOdometry(drive.sequence.camera)
    poses, cpu_s = cpu_seconds(lambda: [odometry.add(image) for image in drive.images])
    index = np.array([k for k, pose in enumerate(poses) if pose is not None])
    return FoundPath(index, np.array([poses[k] for k in index]), cpu_s, len(poses))


def _by_script(program: str, drive: PeerDrive) -> FoundPath:
    """Run a peer in its Python; return its last line where it fails."""
    step_s = max(_COLMAP_STEP_S, np.ptp(drive.time_s) / _COLMAP_MOST) if program == COLMAP else 0.0
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        n_given = _write_drive(folder, drive, step_s)
        command = [_PYTHON, str(_SCRIPT), _NAMES[program], place, str(folder / "found.npz")]
        done = subprocess.run(command, check=False, capture_output=True, text=True, errors="replace")
        if done.returncode:
            said = [line for line in done.stderr.splitlines() if line.strip()]
            return _failure(said[-1] if said else f"ended with code {done.returncode}", n_given)
        with np.load(folder / "found.npz") as found:
            return FoundPath(found["index"], found["poses"], float(found["cpu_s"]), n_given)


def _write_drive(folder: Path, drive: PeerDrive, least_step_s: float) -> int:
    """Write images, calibration and vocabulary as the script reads them; return how many images are so far apart."""
    (folder / "images").mkdir()
    slot = np.floor((drive.time_s - drive.time_s[0]) / max(least_step_s, 1e-9))
    chosen = (
        np.unique(slot, return_index=True)[1].tolist() if least_step_s else list(range(len(drive.time_s)))
    )
    for k in chosen:
        cv2.imwrite(str(folder / "images" / f"{k:06d}.png"), drive.images[k])
    np.save(folder / "frames.npy", np.array(drive.images))
    camera = drive.sequence.camera
    is_fisheye, matrix = camera.model == "fisheye", camera.matrix
    names = ("k1", "k2", "k3", "k4") if is_fisheye else ("k1", "k2", "p1", "p2")
    facts = {
        **{"fx": matrix[0, 0], "fy": matrix[1, 1], "cx": matrix[0, 2], "cy": matrix[1, 2]},
        **{"width": camera.width, "height": camera.height, "is_fisheye": is_fisheye},
        "distortion": dict(zip(names, camera.distortion.tolist(), strict=False)),
        "fps": round(1.0 / float(np.median(np.diff(drive.time_s)))),
        "time_s": drive.time_s.tolist(),
    }
    (folder / "drive.json").write_text(json.dumps(facts), encoding="utf-8")
    (folder / "vocabulary.txt").symlink_to(_vocabulary())
    return len(chosen)


@cache
def _vocabulary() -> Path:
    """Return the vocabulary that was trained on every sixth image of all drives, which is in favour of ORB-SLAM3."""
    digest = code_digest((f"{_HERE}/vocabulary.py", f"{_HERE}/drives.py"))
    file = Path(tempfile.gettempdir()) / "firnline-peers-in-vision" / f"vocabulary-{digest}.txt"
    if not file.exists():
        file.parent.mkdir(parents=True, exist_ok=True)
        images = (image for drive in drives(quick=False) for image in drive.images[::_VOCABULARY_EVERY])
        print(f"  vocabulary of {write_vocabulary(file, images)} words", file=sys.stderr)
    return file


def _failure(message: str, n_given: int) -> FoundPath:
    none = np.zeros(0, dtype=np.int64), np.zeros((0, 4, 4))
    return FoundPath(*none, float("nan"), n_given, failed=message)


PROGRAMS: dict[str, Callable[[PeerDrive], FoundPath]] = {
    OURS: _ours,
    OPENCV: _opencv,
    ORB_SLAM3: partial(_by_script, ORB_SLAM3),
    COLMAP: partial(_by_script, COLMAP),
}
