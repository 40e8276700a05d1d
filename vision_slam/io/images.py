"""Image files of 8 or 16 bits, grey or colour, converted to 8 bits when read."""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from survey.core.errors import InputError
from survey.core.files.reading import existing_file
from survey.data.camera.calibration import Camera
from survey.data.camera.frames import Image
from vision_slam.io.photos.exif import read_photo

PICTURES = (".png", ".jpg", ".jpeg", ".pgm", ".tif", ".tiff")
_END_MARKS = {b"\x89PNG": b"IEND", b"\xff\xd8\xff": b"\xff\xd9"}
_START_OF_SCAN = b"\xda"
_DEPTHS = (8, 10, 12, 14, 16)
_N_SAMPLED = 9


@dataclass(frozen=True)
class AnyImages:
    """Image files read when asked for; values of more than 8 bits are divided by 2 to the power `shift`.

    One divisor for all images of the sequence: scaling each image by itself would depend on
    its brightest pixel. JPEG images are turned upright as their EXIF orientation asks.
    """

    files: Sequence[Path]
    shift: int = 0
    orientations: Sequence[int] = ()
    is_deep: bool = False

    def __getitem__(self, index: int) -> Image:
        pixels = eight_bits(_of_depth(self.files[index], self.is_deep), self.shift, str(self.files[index]))
        return upright(pixels, self.orientations[index]) if self.orientations else pixels

    @property
    def notes(self) -> tuple[str, ...]:
        """What was done to the pixels, in words."""
        scaled = (scaling_note(self.shift),) if self.shift else ()
        return (*scaled, "images are turned upright by their EXIF") if self.orientations else scaled


def images_of(files: Sequence[Path]) -> AnyImages:
    """Return the images of a sequence, refused where one is cut off.

    The bit depth is taken from the brightest pixel of nine images spread over the
    sequence: cameras of 10, 12 or 14 bits write them into the lower ones of 16.

    Raises
    ------
    InputError
        An image is missing, cut off, or of another depth than 8 or 16 bits.
    """
    for file in files:
        refuse_cut_off(file)
    sample = np.unique(np.linspace(0, len(files) - 1, _N_SAMPLED).astype(int)).tolist()
    is_deep = bool(read_pixels(files[0]).dtype == np.uint16)
    sampled = [_of_depth(files[index], is_deep) for index in sample]
    deepest = max(bits_used(pixels) for pixels in sampled) if is_deep else 8
    orientations = tuple(read_photo(file).orientation if is_jpeg(file) else 1 for file in files)
    return AnyImages(tuple(files), deepest - 8, orientations if max(orientations) > 1 else (), is_deep)


def _of_depth(file: Path, is_deep: bool) -> npt.NDArray[Any]:
    """Read an image; refuse 16 bits among images of 8, and the other way round."""
    pixels = read_pixels(file)
    if is_deep != (pixels.dtype == np.uint16):
        raise InputError(
            f"{file} has {pixels.dtype} pixels, the first image others; give images of one depth."
        )
    return pixels


def is_jpeg(file: Path) -> bool:
    """Return whether a file is a JPEG image by its suffix.

    Examples
    --------
    >>> is_jpeg(Path("DSC_0001.JPG")), is_jpeg(Path("1.png"))
    (True, False)
    """
    return file.suffix.lower() in {".jpg", ".jpeg"}


def upright(pixels: Image, orientation: int) -> Image:
    """Return an image turned and mirrored as an EXIF orientation (1 to 8) asks.

    Examples
    --------
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

    Examples
    --------
    >>> bits_used(np.array([[0, 4000]], np.uint16))
    12
    """
    return next(bits for bits in _DEPTHS if int(pixels.max()) < 2**bits)


def eight_bits(pixels: npt.NDArray[Any], shift: int, where: str) -> Image:
    """Return (H, W) or (H, W, 3) pixels as 8 bits; what is brighter than the depth holds becomes white.

    Examples
    --------
    >>> eight_bits(np.array([[0, 2048, 5000]], np.uint16), 4, "it").tolist()
    [[0, 128, 255]]
    """
    if pixels.dtype not in (np.uint8, np.uint16):
        raise InputError(f"{where} has {pixels.dtype} pixels; 8- or 16-bit images were expected, convert it.")
    if pixels.dtype == np.uint16:
        pixels = np.minimum(pixels >> shift, 255).astype(np.uint8)
    return np.asarray(pixels[:, :, :3] if pixels.ndim == 3 else pixels, dtype=np.uint8)


def read_pixels(path: Path) -> npt.NDArray[Any]:
    """Read an image file as it is.

    Raises
    ------
    InputError
        Missing, cut off, or no image.
    """
    refuse_cut_off(path)
    return decoded(path.read_bytes(), str(path))


def decoded(content: bytes, where: str) -> npt.NDArray[Any]:
    """Return the pixels of an image file's content, whatever their depth; colours in the order blue, green, red."""
    pixels: Any = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED) if content else None
    if pixels is None:
        raise InputError(f"{where} cannot be decoded as an image; it may be cut off, get it again.")
    return np.asarray(pixels)


def refuse_cut_off(path: Path) -> None:
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

    Examples
    --------
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


def refuse_other_sizes(files: Sequence[Path], camera: Camera) -> None:
    """Refuse images that are not of the calibration's size, by their headers alone where these can be read."""
    for file in files:
        size = _size_of(file)
        if size != (camera.width, camera.height):
            raise InputError(
                f"{file} has {size[0]} × {size[1]} pixels, its calibration {camera.width} × {camera.height}; "
                "calibrate for this size, or give images as they were calibrated."
            )


def _size_of(file: Path) -> tuple[int, int]:
    """Return width and height [pixels] of an image as it is used: JPEG images are turned upright, others are not."""
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
    return photo.upright_size if is_jpeg(file) else (photo.width, photo.height)
