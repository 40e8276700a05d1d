"""Calibrated camera of a rover, and its images."""

from collections import deque
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Protocol, Self

import numpy as np
import numpy.typing as npt
import tomlkit

from survey.core.arrays import FloatArray, checked
from survey.core.config import Section, read_toml, validated
from survey.core.data_object import DataObject
from survey.core.errors import InputError
from survey.core.files.reading import existing_file
from survey.core.files.writing import replacing

Image = npt.NDArray[np.uint8]


class CameraFile(Section):
    """Keys of ``camera.toml``."""

    model: Literal["pinhole", "fisheye"]
    """OpenCV's lens model: rational pinhole (k1, k2, p1, p2, k3) or fisheye (k1, k2, k3, k4)."""
    width: int
    """Columns of the image."""
    height: int
    """Rows of the image."""
    matrix: tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]
    """Focal lengths and principal point [pixels]; pixel centres are whole numbers."""
    distortion: tuple[float, ...]
    """Coefficients of the lens model."""
    T_body_camera: tuple[
        tuple[float, float, float, float],
        tuple[float, float, float, float],
        tuple[float, float, float, float],
        tuple[float, float, float, float],
    ]
    """Takes camera coordinates (x right, y down, z forward) to the body's."""
    row_readout_s: float = 0.0
    """Time between the exposures of neighbouring rows; 0 for a global shutter [s]."""


@dataclass(frozen=True, eq=False, repr=False)
class Camera(DataObject):
    """Lens, sensor and mounting.

    Parameters
    ----------
    model : {"pinhole", "fisheye"}
        OpenCV's lens models.
    width, height : int
        Size of the image [pixels].
    matrix : (3, 3) array_like
        Camera matrix [pixels]; pixel centres are whole numbers.
    distortion : (5,) array_like for pinhole, (4,) for fisheye
        k1, k2, p1, p2, k3, or k1 … k4.
    T_body_camera : (4, 4) array_like
        Takes camera coordinates (x right, y down, z forward) to body coordinates (x
        forward, y left, z up).
    row_readout_s : float
        Rolling shutter: time between neighbouring rows [s].

    Examples
    --------
    >>> camera = Camera("pinhole", 640, 480, [[400, 0, 320], [0, 400, 240], [0, 0, 1]], np.zeros(5), np.eye(4))
    >>> camera.project(np.array([[1.0, 0.5, 2.0]])).tolist()
    [[520.0, 340.0]]
    >>> camera.rays(np.array([[320.0, 240.0]])).tolist()
    [[0.0, 0.0, 1.0]]
    """

    model: Literal["pinhole", "fisheye"]
    width: int
    height: int
    matrix: FloatArray
    distortion: FloatArray
    T_body_camera: FloatArray
    row_readout_s: float = 0.0

    def __post_init__(self) -> None:
        n = {"pinhole": 5, "fisheye": 4}[self.model]
        object.__setattr__(self, "matrix", checked(self.matrix, (3, 3), "the camera matrix"))
        object.__setattr__(self, "distortion", checked(self.distortion, (n,), "the lens coefficients"))
        pose = checked(self.T_body_camera, (4, 4), "the camera's place on the body")
        object.__setattr__(self, "T_body_camera", pose)
        rotation = pose[:3, :3]
        if np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-6 or np.linalg.det(rotation) < 0:
            raise InputError("T_body_camera of the camera holds no rotation; check the order of its rows.")
        if min(self.width, self.height) < 1 or self.matrix[0, 0] <= 0 or self.matrix[1, 1] <= 0:
            raise InputError(
                f"the camera has {self.width} × {self.height} pixels and focal lengths "
                f"{self.matrix[0, 0]:g}, {self.matrix[1, 1]:g}; all must be above 0."
            )

    def project(self, xyz_camera: FloatArray) -> FloatArray:
        """Project points in the camera frame to pixels.

        The fisheye model holds up to 90° off its axis, the pinhole model where the polynomial of
        OpenCV is one to one.

        Parameters
        ----------
        xyz_camera : (N, 3) array_like
            Points [m], camera frame.

        Returns
        -------
        (N, 2) ndarray
            Column and row [pixels]; NaN for points behind the camera.
        """
        import cv2

        points = np.asarray(xyz_camera, dtype=np.float64).reshape(-1, 3)
        pixels = np.full((len(points), 2), np.nan)
        ahead = points[:, 2] > 1e-9
        if ahead.any():
            seen = np.ascontiguousarray(points[ahead, None, :])
            zero = np.zeros(3)
            if self.model == "fisheye":
                found, _ = cv2.fisheye.projectPoints(seen, zero, zero, self.matrix, self.distortion)
            else:
                found, _ = cv2.projectPoints(seen, zero, zero, self.matrix, self.distortion)
            pixels[ahead] = np.asarray(found).reshape(-1, 2)
        return pixels

    def rays(self, uv: FloatArray) -> FloatArray:
        """Return the viewing directions of pixels.

        Parameters
        ----------
        uv : (N, 2) array_like
            Column and row [pixels].

        Returns
        -------
        (N, 3) ndarray
            Unit vectors, camera frame.
        """
        import cv2

        pixels = np.ascontiguousarray(np.asarray(uv, dtype=np.float64).reshape(-1, 1, 2))
        if len(pixels) == 0:
            return np.zeros((0, 3))
        if self.model == "fisheye":
            plane = cv2.fisheye.undistortPoints(pixels, self.matrix, self.distortion)
        else:
            plane = cv2.undistortPoints(pixels, self.matrix, self.distortion)
        rays = np.column_stack([np.asarray(plane).reshape(-1, 2), np.ones(len(pixels))])
        directions: FloatArray = rays / np.linalg.norm(rays, axis=1, keepdims=True)
        return directions

    def scaled(self, factor: float) -> "Camera":
        """Return the same lens with another resolution.

        Parameters
        ----------
        factor : float
            New over old number of pixels per side.

        Returns
        -------
        Camera
            With the matrix of the new resolution.
        """
        matrix = self.matrix.copy()
        matrix[:2] *= factor
        matrix[:2, 2] += 0.5 * (factor - 1.0)  # pixel centres are whole numbers, edges lie at halves
        size = round(self.width * factor), round(self.height * factor)
        return Camera(
            self.model, *size, matrix, self.distortion, self.T_body_camera, self.row_readout_s / factor
        )

    def write(self, path: str | Path) -> None:
        """Write ``camera.toml``.

        Parameters
        ----------
        path : str or pathlib.Path
            The file.
        """
        content = {
            "model": self.model,
            "width": self.width,
            "height": self.height,
            "matrix": self.matrix.tolist(),
            "distortion": self.distortion.tolist(),
            "T_body_camera": self.T_body_camera.tolist(),
            "row_readout_s": self.row_readout_s,
        }
        with replacing(path) as draft:
            draft.write_text(tomlkit.dumps(content), encoding="utf-8")

    @classmethod
    def read(cls, path: str | Path) -> Self:
        """Read ``camera.toml``.

        Parameters
        ----------
        path : str or pathlib.Path
            The file.

        Returns
        -------
        Camera
            The calibration.

        Raises
        ------
        InputError
            Missing, or the numbers describe no camera.
        ConfigError
            A key is missing, unknown or of the wrong kind.
        """
        file = existing_file(path, "the calibration")
        given = validated(CameraFile, read_toml(file), str(file))
        n = {"pinhole": 5, "fisheye": 4}[given.model]
        if len(given.distortion) != n:
            raise InputError(
                f"{file} gives {len(given.distortion)} distortion coefficients; a {given.model} lens has {n}."
            )
        try:
            return cls(
                given.model,
                given.width,
                given.height,
                np.array(given.matrix),
                np.array(given.distortion),
                np.array(given.T_body_camera),
                given.row_readout_s,
            )
        except InputError as error:
            raise InputError(f"{file}: {error}") from error


class ImageSource(Protocol):
    """Sequence of images, read by index."""

    def __getitem__(self, index: int) -> Image: ...


@dataclass(frozen=True, eq=False, repr=False)
class Frames(DataObject):
    """Images in the order of their times; each is read when it is used.

    Parameters
    ----------
    time_s : (N,) array_like
        Times of the middle of the exposure of the first row [s].
    images : ImageSource
        ``images[k]`` is the image at ``time_s[k]``: (H, W) grey or (H, W, 3) blue, green,
        red, uint8.
    """

    time_s: FloatArray
    images: ImageSource

    def __post_init__(self) -> None:
        times = checked(self.time_s, (None,), "the times of the frames")
        if (np.diff(times) <= 0).any():
            first = int(np.flatnonzero(np.diff(times) <= 0)[0])
            raise InputError(
                f"the times of the frames do not increase after frame {first} ({times[first]:.6f} s); sort them."
            )
        object.__setattr__(self, "time_s", times)

    def __len__(self) -> int:
        return len(self.time_s)

    def __getitem__(self, index: int) -> Image:
        return self.images[index]

    @classmethod
    def read(cls, folder: str | Path) -> Self:
        """Read what a `FrameWriter` wrote: ``frames.csv`` (time_s,file) and the images beside it.

        Parameters
        ----------
        folder : str or pathlib.Path
            The folder.

        Returns
        -------
        Frames
            Images that are read when used.

        Raises
        ------
        InputError
            The list is missing or cut off, or a file that it names is not there.
        """
        place = Path(folder)
        list_file = existing_file(place / "frames.csv", "the list of frames")
        rows = [line.split(",") for line in list_file.read_text(encoding="utf-8").splitlines()]
        if not rows or rows[0] != ["time_s", "file"] or len(rows) < 2:
            raise InputError(
                f"{list_file} is no list of frames; a header time_s,file and one row a frame was expected."
            )
        times = []
        for number, row in enumerate(rows[1:], start=2):
            try:
                time, _ = row
                times.append(float(time))
            except ValueError as error:
                raise InputError(
                    f"{list_file}, line {number}: {','.join(row)!r} is no time and file name; correct it."
                ) from error
        files = [place / row[1] for row in rows[1:]]
        missing = next((file for file in files if not file.is_file()), None)
        if missing is not None:
            raise InputError(
                f"{list_file} names {missing.name}, which is not there; get the complete recording."
            )
        return cls(np.array(times), ImageFiles(files))


@dataclass(frozen=True)
class ImageFiles:
    """Image files, read when used."""

    files: Sequence[Path]

    def __getitem__(self, index: int) -> Image:
        return read_image(self.files[index])


def read_image(path: str | Path) -> Image:
    """Read an 8-bit image, grey or blue-green-red.

    Parameters
    ----------
    path : str or pathlib.Path
        PNG, JPEG or another format of OpenCV.

    Returns
    -------
    (H, W) or (H, W, 3) ndarray of uint8
        The pixels.

    Raises
    ------
    InputError
        Missing, truncated, no image, or of another depth than 8 bits.
    """
    import cv2

    file = existing_file(path, "the image")
    content = file.read_bytes()
    # OpenCV fills missing data with zeros; PNG and JPEG have an end mark.
    cut = any(content.startswith(head) and tail not in content[-32:] for head, tail in _END_MARKS.items())
    image: Any = None if cut else cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise InputError(f"{file} cannot be decoded as an image; it may be cut off, get it again.")
    if image.dtype != np.uint8:
        raise InputError(f"{file} has {image.dtype} pixels; 8-bit images were expected, convert it.")
    return np.asarray(image, dtype=np.uint8)


_END_MARKS = {b"\x89PNG": b"IEND", b"\xff\xd8\xff": b"\xff\xd9"}


_MOST_WAITING = 4
"""Images that may wait to be written: what bounds the memory."""


class FrameWriter:
    """Writer of images as lossless PNG, one by one, and of their list at the end.

    A folder without ``frames.csv`` is half-written. A thread compresses while the next image is
    made, so that an image must not be changed once it is added. A failed write raises an error
    a few images later, or at the end.

    Parameters
    ----------
    folder : str or pathlib.Path
        Created if missing.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with FrameWriter(folder) as writer:
    ...         writer.add(0.0, np.zeros((4, 6), np.uint8))
    ...     len(Frames.read(folder))
    1
    """

    def __init__(self, folder: str | Path) -> None:
        self._folder = Path(folder)
        self._folder.mkdir(parents=True, exist_ok=True)
        self._rows: list[str] = []
        self._thread = ThreadPoolExecutor(1)
        self._waiting: deque[Future[None]] = deque()

    def add(self, time_s: float, image: Image) -> None:
        """Queue one more image for writing.

        Parameters
        ----------
        time_s : float
            Its time [s].
        image : (H, W) or (H, W, 3) ndarray of uint8
            Grey, or blue, green, red.
        """
        name = f"{len(self._rows):06d}.png"
        self._rows.append(f"{float(time_s)!r},{name}")
        if len(self._waiting) == _MOST_WAITING:
            self._waiting.popleft().result()
        self._waiting.append(self._thread.submit(self._write, name, time_s, image))

    def _write(self, name: str, time_s: float, image: Image) -> None:
        import cv2

        # Level 1 is half as fast to read and nearly as small: noise does not compress.
        is_encoded, content = cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 1])
        if not is_encoded:
            raise InputError(f"the frame at {time_s} s could not be written as PNG; it must be 8-bit.")
        (self._folder / name).write_bytes(content.tobytes())

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Write the list, unless something went wrong."""
        self._thread.shutdown(cancel_futures=kind is not None)
        if kind is None:
            for written in self._waiting:
                written.result()
            with replacing(self._folder / "frames.csv") as draft:
                draft.write_text("\n".join(["time_s,file", *self._rows]) + "\n", encoding="utf-8")
