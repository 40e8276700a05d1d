"""Images of a drive with their times, read one at a time, and written while the next is computed."""

from collections import deque
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol, Self

import numpy as np
import numpy.typing as npt

from survey.core import DataObject, FloatArray, InputError, checked, existing_file, write_text
from survey.core.time_units import LONGEST_IMAGE_STEP_S, refuse_other_unit

Image = npt.NDArray[np.uint8]


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
        refuse_other_unit(times, "the times of the frames", LONGEST_IMAGE_STEP_S)
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
        rows = [line.split(",") for line in list_file.read_text(encoding="utf-8-sig").splitlines()]
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

    Returns (H, W) or (H, W, 3): the pixels.
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

    `folder`: created if missing.

    >>> import tempfile
    >>> import numpy as np
    >>> from survey.data.frames import Frames
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

        `time_s`: its time [s]. `image` (H, W) or (H, W, 3): grey, or blue, green, red.
        """
        name = f"{len(self._rows):06d}.png"
        self._rows.append(f"{float(time_s)!r},{name}")
        if len(self._waiting) == _MOST_WAITING:
            self._waiting.popleft().result()
        self._waiting.append(self._thread.submit(self._write, name, time_s, image))

    def _write(self, name: str, time_s: float, image: Image) -> None:
        (self._folder / name).write_bytes(png_of_frame(image, time_s))

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
            write_text(self._folder / "frames.csv", "\n".join(["time_s,file", *self._rows]) + "\n")


def png_of_frame(image: Image, time_s: float) -> bytes:
    """Encode a camera's image as lossless PNG; `time_s` names it where that fails."""
    import cv2

    # The noise of a sensor repeats no strings, so none are searched for: files are an eighth smaller than with level 1,
    # and take 0.4 of its time to write.
    settings = [
        cv2.IMWRITE_PNG_STRATEGY,
        cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY,
        cv2.IMWRITE_PNG_FILTER,
        cv2.IMWRITE_PNG_FILTER_AVG,
    ]
    is_encoded, content = cv2.imencode(".png", image, settings)
    if not is_encoded:
        raise InputError(f"the frame at {time_s} s could not be written as PNG; it must be 8-bit.")
    return content.tobytes()
