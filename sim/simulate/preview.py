"""Preview of a drive: video, animated image, and contact sheet."""

from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
from PIL import Image as Picture

from survey.core.errors import InputError
from survey.core.files.writing import replacing
from survey.data.camera.frames import Frames, Image

_WIDEST_PX = 480
_FASTER = 4.0
_MOST_FRAMES = 150


def write_preview(frames: Frames, path: Path) -> None:
    """Write a video (MPEG-4, .mp4) of frames at half size, four times as fast as they were taken.

    Of a long drive every so many frames are shown, 150 in all.

    Raises
    ------
    InputError
        The video cannot be written.
    """
    first = _small(frames[0], _WIDEST_PX)
    height, width = first.shape[:2]
    rate_hz = _FASTER / float(np.median(np.diff(frames.time_s))) if len(frames) > 1 else 1.0
    with replacing(path) as draft:
        code = cv2.VideoWriter.fourcc(*"mp4v")
        writer = cv2.VideoWriter(str(draft), code, min(rate_hz, 60.0), (width, height))
        if not writer.isOpened():
            raise InputError(f"{path} cannot be written as a video; look at the contact sheet instead.")
        for k in np.unique(
            np.linspace(0, len(frames) - 1, min(len(frames), _MOST_FRAMES)).round().astype(int)
        ):
            writer.write(_coloured(_small(frames[int(k)], _WIDEST_PX)))
        writer.release()


def animated(frames: Frames, n_shown: int = 60) -> bytes:
    """Return frames at equal steps of the drive as an animated WebP, six a second, for a page that plays no videos."""
    chosen = np.unique(np.linspace(0, len(frames) - 1, n_shown).round().astype(int))
    pictures = [Picture.fromarray(_coloured(_small(frames[int(k)], 400))[:, :, ::-1]) for k in chosen]
    with BytesIO() as content:
        pictures[0].save(
            content, "WEBP", save_all=True, append_images=pictures[1:], duration=167, loop=0, quality=50
        )
        return content.getvalue()


def write_contact_sheet(frames: Frames, path: Path, n_columns: int = 4, n_rows: int = 4) -> None:
    """Write a picture of frames at equal steps of the drive, each with its time."""
    chosen = np.unique(np.linspace(0, len(frames) - 1, n_columns * n_rows).round().astype(int))
    tiles = []
    for k in chosen:
        tile = _coloured(_small(frames[int(k)], 320))
        cv2.putText(
            tile, f"{frames.time_s[k]:.2f} s", (6, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (20, 20, 20), 1
        )
        tiles.append(tile)
    blank = np.full_like(tiles[0], 255)
    tiles += [blank] * (-len(tiles) % n_columns)
    rows = [np.hstack(tiles[k : k + n_columns]) for k in range(0, len(tiles), n_columns)]
    is_encoded, content = cv2.imencode(".png", np.vstack(rows))
    if not is_encoded:
        raise InputError(f"{path} cannot be written as PNG.")
    with replacing(path) as draft:
        draft.write_bytes(content.tobytes())


def _small(image: Image, widest: int) -> Image:
    """Return an image of at most that many columns, an even number a side as videos want it."""
    height, width = image.shape[:2]
    factor = min(widest / width, 1.0)
    size = (max(int(width * factor) // 2 * 2, 2), max(int(height * factor) // 2 * 2, 2))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _coloured(image: Image) -> Image:
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 else image, dtype=np.uint8)
