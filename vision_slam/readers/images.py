"""Image files, and the assembly of an image sequence from files.

`AnyImages` reads images of 8 or 16 bits, grey or colour, when they are used, and converts them to 8 bits with one divisor
for the sequence. `assemble_sequence` joins images, times and calibration after all files were checked for completeness
and size. Text is UTF-8 with or without a byte order mark; times in other units than seconds are recognized by their
size.
"""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from survey import Camera, InputError
from survey.core import FloatArray, existing_file
from survey.core.time_units import LONGEST_IMAGE_STEP_S, PER_SECOND, plain_unit
from survey.data.frames import Frames, Image
from survey.data.sensors.records import Inertial
from vision_slam.readers.photos import are_held_both_ways, is_jpeg, natural_key, read_photo
from vision_slam.readers.sequence import ImageSequence

PICTURES = (".png", ".jpg", ".jpeg", ".pgm", ".tif", ".tiff")
_END_MARKS = {b"\x89PNG": b"IEND", b"\xff\xd8\xff": b"\xff\xd9"}
_START_OF_SCAN = b"\xda"
_DEPTHS = (8, 10, 12, 14, 16)
_N_SAMPLED_IMAGES = 9


@dataclass(frozen=True)
class AnyImages:
    """Image files read when asked for; values of more than 8 bits are divided by 2 to the power `shift`.

    One divisor for all images of the sequence: scaling each image by itself would depend on
    its brightest pixel. JPEG images are turned upright as their EXIF orientation asks, but not where the camera was held
    both ways.
    """

    files: Sequence[Path]
    shift: int = 0
    orientations: Sequence[int] = ()
    is_deep: bool = False
    is_held_both_ways: bool = False

    def __getitem__(self, index: int) -> Image:
        pixels = eight_bits(_of_depth(self.files[index], self.is_deep), self.shift, str(self.files[index]))
        return upright(pixels, self.orientations[index]) if self.orientations else pixels

    @property
    def notes(self) -> tuple[str, ...]:
        """What was done to the pixels, in words."""
        scaled = (scaling_note(self.shift),) if self.shift else ()
        if self.is_held_both_ways:
            return (
                *scaled,
                "some images stand upright and others across: all are used as the sensor stores them",
            )
        return (*scaled, "images are turned upright by their EXIF") if self.orientations else scaled


def images_of(files: Sequence[Path]) -> AnyImages:
    """Return the images of a sequence, refused where one is cut off.

    The bit depth is taken from the brightest pixel of nine images spread over the
    sequence: cameras of 10, 12 or 14 bits write them into the lower ones of 16.
    """
    for file in files:
        refuse_cut_off_image(file)
    sample = np.unique(np.linspace(0, len(files) - 1, _N_SAMPLED_IMAGES).astype(int)).tolist()
    is_deep = bool(read_pixels(files[0]).dtype == np.uint16)
    sampled = [_of_depth(files[index], is_deep) for index in sample]
    deepest = max(bits_used(pixels) for pixels in sampled) if is_deep else 8
    photos = [read_photo(file) if is_jpeg(file) else None for file in files]
    if are_held_both_ways(photos):
        return AnyImages(tuple(files), deepest - 8, (), is_deep, is_held_both_ways=True)
    orientations = tuple(1 if photo is None else photo.orientation for photo in photos)
    return AnyImages(tuple(files), deepest - 8, orientations if max(orientations) > 1 else (), is_deep)


def _of_depth(file: Path, is_deep: bool) -> npt.NDArray[Any]:
    """Read an image; refuse 16 bits among images of 8, and the other way round."""
    pixels = read_pixels(file)
    if is_deep != (pixels.dtype == np.uint16):
        raise InputError(
            f"{file} has {pixels.dtype} pixels, the first image others; give images of one depth."
        )
    return pixels


def upright(pixels: Image, orientation: int) -> Image:
    """Return an image turned and mirrored as an EXIF orientation (1 to 8) asks.

    >>> upright(np.array([[1, 2]], np.uint8), 6).tolist(), upright(np.array([[1, 2]], np.uint8), 3).tolist()
    ([[1], [2]], [[2, 1]])
    """
    if orientation >= 5:
        pixels = np.swapaxes(pixels, 0, 1)
    if orientation in (2, 3, 6, 7):
        pixels = pixels[:, ::-1]
    if orientation in (3, 4, 7, 8):
        pixels = pixels[::-1]
    return np.ascontiguousarray(pixels)


def scaling_note(shift: int) -> str:
    """Say how deep pixels became 8-bit."""
    return f"images of {8 + shift} bits were divided by {2**shift}"


def bits_used(pixels: npt.NDArray[Any]) -> int:
    """Return the least common camera depth that holds the brightest pixel.

    >>> bits_used(np.array([[0, 4000]], np.uint16))
    12
    """
    return next(bits for bits in _DEPTHS if int(pixels.max()) < 2**bits)


def eight_bits(pixels: npt.NDArray[Any], shift: int, where: str) -> Image:
    """Return (H, W) or (H, W, 3) pixels as 8 bits; what is brighter than the depth holds becomes white.

    >>> eight_bits(np.array([[0, 2048, 5000]], np.uint16), 4, "it").tolist()
    [[0, 128, 255]]
    """
    if pixels.dtype not in (np.uint8, np.uint16):
        raise InputError(f"{where} has {pixels.dtype} pixels; 8- or 16-bit images were expected, convert it.")
    if pixels.dtype == np.uint16:
        pixels = np.minimum(pixels >> shift, 255).astype(np.uint8)
    return np.asarray(pixels[:, :, :3] if pixels.ndim == 3 else pixels, dtype=np.uint8)


def read_pixels(path: Path) -> npt.NDArray[Any]:
    """Read an image file as it is."""
    refuse_cut_off_image(path)
    return decoded(path.read_bytes(), str(path))


def decoded(content: bytes, where: str) -> npt.NDArray[Any]:
    """Return the pixels of an image file's content, whatever their depth; colours in the order blue, green, red."""
    pixels: Any = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED) if content else None
    if pixels is None:
        raise InputError(f"{where} cannot be decoded as an image; it may be cut off, get it again.")
    return np.asarray(pixels)


def refuse_cut_off_image(path: Path) -> None:
    """Refuse a file that is missing, empty, or a PNG or JPEG without its end: OpenCV fills what lacks with zeros."""
    with existing_file(path, "the image").open("rb") as stream:
        head = stream.read(8)
        stream.seek(-min(32, path.stat().st_size), 2)
        tail = stream.read()
    lacks_end = any(head.startswith(mark) and end not in tail for mark, end in _END_MARKS.items())
    if lacks_end and not (head.startswith(b"\xff\xd8") and has_jpeg_end(path.read_bytes())):
        raise InputError(f"{path} is cut off: the end of the image is missing; get it again.")


def has_jpeg_end(content: bytes) -> bool:
    """Return whether the end of a JPEG image follows its start of scan; phones write more data, such as a video, after it.

    Segments before the scan, such as EXIF, may hold a small image that has an end of its own.

    >>> has_jpeg_end(bytes.fromhex("ffd8 ffda0002 1234 ffd9 534546"))
    True
    >>> has_jpeg_end(bytes.fromhex("ffd8 ffe10004ffd9 ffda0002 1234"))
    False
    """
    at = 2
    while content[at : at + 1] == b"\xff" and content[at + 1 : at + 2] != _START_OF_SCAN:
        is_fill = content[at + 1 : at + 2] == b"\xff"
        at += 1 if is_fill else 2 + int.from_bytes(content[at + 2 : at + 4], "big")
    return content.find(_END_MARKS[b"\xff\xd8\xff"], at) >= 0


def refuse_other_sizes(files: Sequence[Path], camera: Camera, *, as_stored: bool = False) -> None:
    """Refuse images that are not of the calibration's size, by their headers alone where these can be read."""
    for file in files:
        size = _size_of(file, as_stored=as_stored)
        if size != (camera.width, camera.height):
            raise InputError(
                f"{file} has {size[0]} × {size[1]} pixels, its calibration {camera.width} × {camera.height}; "
                "calibrate for this size, or give images as they were calibrated."
            )


def _size_of(file: Path, *, as_stored: bool) -> tuple[int, int]:
    """Return width and height [pixels] of an image as it is used: JPEG images are turned upright unless as stored, others are not."""
    with file.open("rb") as stream:
        head = stream.read(24)
    if head.startswith(b"\x89PNG"):
        width, height = struct.unpack(">II", head[16:24])
        return width, height
    try:
        photo = read_photo(file)
    except InputError:
        height, width = read_pixels(file).shape[:2]
        return width, height
    return photo.upright_size if is_jpeg(file) and not as_stored else (photo.width, photo.height)


def read_text(path: str | Path, what: str) -> str:
    """Return the text of a file without its byte order mark."""
    file = existing_file(path, what)
    try:
        return file.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(
            f"{what} {file} is no UTF-8 text (byte {error.start + 1}); save it as UTF-8 or get it again."
        ) from error


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
    refuse_other_sizes(files, camera, as_stored=images.is_held_both_ways)
    time_s, poses = reference or (None, None)
    frame_s, unit_note = seconds_of(times, "images")
    reference_s, reference_note = (None, ()) if time_s is None else seconds_of(time_s, "reference poses")
    try:
        frames = Frames(frame_s, images)
    except InputError as error:
        raise InputError(f"{files[0].parent}: {error}") from error
    return ImageSequence(
        camera,
        frames,
        inertial=inertial,
        reference_time_s=reference_s,
        reference=poses,
        notes=(*unit_note, *reference_note, *images.notes),
    )


def seconds_of(times: FloatArray, what: str) -> tuple[FloatArray, tuple[str, ...]]:
    """Return times in seconds, and a note where their size or interval shows another unit.

    >>> seconds_of(np.array([5e12, 5.1e12]), "images")[1]
    ('the times of the images were taken as nanoseconds',)
    >>> seconds_of(np.array([0.0, 0.1]), "images")[1]
    ()
    """
    unit = plain_unit(times, LONGEST_IMAGE_STEP_S)
    if unit is None:
        return times, ()
    return times / PER_SECOND[unit], (f"the times of the {what} were taken as {unit}",)


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
