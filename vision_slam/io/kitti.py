"""Image sequences in the KITTI layout."""

from pathlib import Path

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.camera.calibration import Camera
from vision_slam.io.images import read_pixels
from vision_slam.io.sequence import ImageSequence
from vision_slam.io.sequence_files import (
    FORWARD,
    assemble_sequence,
    image_files,
    kitti_poses,
    read_numbers,
    require_as_many,
)
from vision_slam.io.text import read_text

KITTI_IMAGES = ("image_0", "image_l", "image_2")
_KITTI_HEIGHT_M = 1.65
_KITTI_PERIOD_S = 0.1


def read_kitti_sequence(place: Path, camera: Camera | None) -> ImageSequence:
    """Read images and reference poses in the layout of KITTI odometry."""
    names = next((name for name in KITTI_IMAGES if (place / name).is_dir()), None)
    if names is None:
        raise InputError(f"{place} has calib.txt and no image_0, image_l or image_2; get the images.")
    files = image_files(place / names)
    if not files:
        raise InputError(f"{place / names} holds no images; get the complete sequence.")
    if (place / "times.txt").is_file():
        times = read_numbers(place / "times.txt", 1)[:, 0]
    else:
        times = _KITTI_PERIOD_S * np.arange(float(len(files)))
    require_as_many(times, files, place)
    if camera is None:
        mounted = FORWARD.copy()
        mounted[2, 3] = _KITTI_HEIGHT_M
        height, width = read_pixels(files[0]).shape[:2]
        matrix = _kitti_matrix(place / "calib.txt")
        camera = Camera(
            "pinhole", width, height, matrix, np.zeros(5), mounted, distortion_is_assumed=True
        )  # images that are said to be rectified keep 10 pixels of distortion at the border
    reference = None
    if (place / "poses.txt").is_file():
        rows = read_numbers(place / "poses.txt", 12)
        require_as_many(rows, files, place / "poses.txt")
        poses = kitti_poses(rows, place / "poses.txt")
        reference = (times, camera.T_body_camera @ poses @ np.linalg.inv(camera.T_body_camera))
    return assemble_sequence(camera, times, files, reference=reference)


def _kitti_matrix(file: Path) -> FloatArray:
    """Return the left camera of a KITTI calibration: the first projection, with or without its label."""
    words = read_text(file, "the calibration").splitlines()[0].split()
    try:
        numbers = [float(word) for word in words if not word.endswith(":")]
    except ValueError:
        numbers = []
    if len(numbers) < 12:
        raise InputError(f"{file} gives no projection in its first line; 12 numbers (3 × 4) were expected.")
    matrix: FloatArray = np.array(numbers[:12]).reshape(3, 4)[:, :3]
    return matrix
