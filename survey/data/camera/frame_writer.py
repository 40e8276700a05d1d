"""Writing of images beside the computation that makes them."""

from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from types import TracebackType
from typing import Self

from survey.core.errors import InputError
from survey.core.files.writing import replacing
from survey.data.camera.frames import Image

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
    >>> import numpy as np
    >>> from survey.data.camera.frames import Frames
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
            with replacing(self._folder / "frames.csv") as draft:
                draft.write_text("\n".join(["time_s,file", *self._rows]) + "\n", encoding="utf-8")


def png_of_frame(image: Image, time_s: float) -> bytes:
    """Encode a camera's image as lossless PNG; `time_s` names it where that fails.

    Raises
    ------
    InputError
        The image is not of 8 bits.
    """
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
