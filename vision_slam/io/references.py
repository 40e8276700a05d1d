"""Reference poses in a frame of their own: TUM and KITTI text."""

from pathlib import Path

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.core.files.reading import existing_file
from survey.data.camera.calibration import Camera
from survey.io.pose_files import read_tum
from vision_slam.io.sequence_files import kitti_poses, poses_of, read_numbers

_KITTI_COLUMNS = 12


def is_kitti(path: str | Path) -> bool:
    """Return whether a text file has the twelve numbers a line of KITTI poses.

    Parameters
    ----------
    path : str or pathlib.Path
        The file.

    Returns
    -------
    bool
        By its first line that is no comment; False for a file that is no text.
    """
    try:
        content = existing_file(path, "the reference").read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        return False
    lines = (line for line in content.splitlines() if line.strip() and not line.startswith("#"))
    return len(next(lines, "").split()) == _KITTI_COLUMNS


def read_poses(path: str | Path, frame_s: FloatArray, camera: Camera) -> tuple[FloatArray, FloatArray]:
    """Read reference poses as KITTI or TUM text.

    KITTI text has no times, one pose of the camera for each image. TUM text has times and poses
    of the body.

    Parameters
    ----------
    path : str or pathlib.Path
        Twelve or eight numbers a line.
    frame_s : (N,) ndarray
        Times of the images [s].
    camera : Camera
        Its mounting turns poses of the camera into poses of the body.

    Returns
    -------
    time_s : (R,) ndarray
        Times [s].
    poses : (R, 4, 4) ndarray
        Body to the frame of the reference.

    Raises
    ------
    InputError
        Missing, damaged, or KITTI poses of another number than the images.
    """
    if not is_kitti(path):
        rows = read_tum(path)
        return rows[:, 0], poses_of(rows[:, 1:4], _unit(rows[:, 4:8]), Path(path))
    numbers = read_numbers(Path(path), _KITTI_COLUMNS)
    if len(numbers) != len(frame_s):
        raise InputError(
            f"{path} has {len(numbers)} poses without times and the drive {len(frame_s)} images; name the poses of "
            "these images, or poses with times (TUM)."
        )
    poses = kitti_poses(numbers, Path(path))
    return frame_s, camera.T_body_camera @ poses @ np.linalg.inv(camera.T_body_camera)


def _unit(quaternion: FloatArray) -> FloatArray:
    unit: FloatArray = quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)
    return unit
