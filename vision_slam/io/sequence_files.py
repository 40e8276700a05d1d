"""Assembly of an image sequence from files: images, times and tables of numbers."""

from io import StringIO
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.camera.calibration import Camera
from survey.data.camera.frames import Frames
from survey.data.sensors.aiding import Inertial
from vision_slam.io.images import PICTURES, images_of, refuse_other_sizes
from vision_slam.io.photos.names import natural_key
from vision_slam.io.sequence import ImageSequence
from vision_slam.io.text import read_text

# Where x right, y down, z forward lie on a body with x forward, y left, z up.
FORWARD = np.array([[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])

# Names of units, their number per second, and times since 1970 and intervals between images that are in them.
_UNITS = (
    ("nanoseconds", 1e9, 1e17, 1e6),
    ("microseconds", 1e6, 1e14, 2e3),
    ("milliseconds", 1e3, 1e11, np.inf),
)
_NO_ROTATION = 1e-2  # of the product of a matrix and its transpose


def assemble_sequence(
    camera: Camera,
    times: FloatArray,
    files: list[Path],
    inertial: Inertial | None = None,
    reference: tuple[FloatArray, FloatArray] | None = None,
) -> ImageSequence:
    """Assemble a sequence after checking all images for completeness and size."""
    images = images_of(files)
    refuse_other_sizes(files, camera)
    time_s, poses = reference or (None, None)
    frame_s, unit_note = seconds_of(times)
    try:
        frames = Frames(frame_s, images)
    except InputError as error:
        raise InputError(f"{files[0].parent}: {error}") from error
    return ImageSequence(
        camera,
        frames,
        inertial=inertial,
        reference_time_s=None if time_s is None else seconds_of(time_s)[0],
        reference=poses,
        notes=(*unit_note, *images.notes),
    )


def seconds_of(times: FloatArray) -> tuple[FloatArray, tuple[str, ...]]:
    """Return times of images in seconds, and a note where their size or interval shows another unit.

    Examples
    --------
    >>> seconds_of(np.array([5e12, 5.1e12]))[1]
    ('the times of the images were taken as nanoseconds',)
    >>> seconds_of(np.array([0.0, 0.1]))[1]
    ()
    """
    interval = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    for name, per_second, since_1970, least_interval in _UNITS:
        if times[0] > since_1970 or interval > least_interval:
            return times / per_second, (f"the times of the images were taken as {name}",)
    return times, ()


def calibrated_camera(place: Path) -> Camera:
    """Read the calibration beside the images of a folder."""
    if not (place / "camera.toml").is_file():
        raise InputError(
            f"{place} holds images and no camera.toml; calibrate the camera (firnline calibrate) and put it there, or name "
            "it with --camera."
        )
    return Camera.read(place / "camera.toml")


def image_files(folder: Path) -> list[Path]:
    """Return the image files of a folder in the natural order of their names; hidden files are left out."""
    files = folder.iterdir() if folder.is_dir() else ()
    images = (file for file in files if file.suffix.lower() in PICTURES and not file.name.startswith("."))
    return sorted(images, key=natural_key)


def poses_of(place: FloatArray, quaternion: FloatArray, where: Path) -> FloatArray:
    """Return poses (N, 4, 4) of places (N, 3) [m] and unit quaternions (N, 4)."""
    if (np.abs(np.linalg.norm(quaternion, axis=1) - 1.0) > 1e-3).any():
        raise InputError(f"{where} holds orientations that are no unit quaternions; correct them.")
    poses = np.tile(np.eye(4), (len(place), 1, 1))
    poses[:, :3, :3] = Rotation.from_quat(quaternion).as_matrix()
    poses[:, :3, 3] = place
    return poses


def kitti_poses(rows: FloatArray, where: Path) -> FloatArray:
    """Return poses (N, 4, 4) of rows of twelve numbers; refuse those without a rotation."""
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3] = rows.reshape(-1, 3, 4)
    turn = poses[:, :3, :3]
    off = np.abs(turn @ turn.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    wrong = np.flatnonzero((off > _NO_ROTATION) | (np.linalg.det(turn) < 0.0))
    if len(wrong):
        raise InputError(f"{where}, line {wrong[0] + 1}: the pose holds no rotation; correct it.")
    return poses


def read_numbers(path: Path, n_columns: int | None) -> FloatArray:
    """Read a table of numbers with as many columns as expected, any number where None is."""
    text = read_text(path, "the table")
    try:
        rows: FloatArray = np.loadtxt(StringIO(text), ndmin=2)
    except ValueError as error:
        raise InputError(f"{path} holds something that is no number ({error}); correct it.") from error
    if n_columns is not None and rows.shape[1] != n_columns:
        raise InputError(f"{path} has {rows.shape[1]} numbers a line; {n_columns} were expected.")
    return rows


def require_as_many(rows: FloatArray, files: list[Path], where: Path) -> None:
    """Refuse a table that has not one row for each image."""
    if len(rows) != len(files):
        raise InputError(f"{where}: {len(rows)} lines and {len(files)} images; they must be as many.")


def require_all_there(files: list[Path]) -> None:
    """Refuse a list that names an image that does not exist."""
    missing = next((file for file in files if not file.is_file()), None)
    if missing is not None:
        raise InputError(
            f"the list of images names {missing}, which is not there; get the complete recording."
        )
