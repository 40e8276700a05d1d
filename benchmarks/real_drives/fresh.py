"""Other recordings made of the recorded drives: seen in a mirror, backwards, by another camera, with other faults."""

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np

from benchmarks.real_drives.drives import Images
from survey.core.arrays import FloatArray
from survey.core.streams import stream
from survey.data.frames import Frames, Image
from vision_slam.readers.sequence import ImageSequence

_MIRROR = np.diag([1.0, -1.0, 1.0, 1.0])
_PATCH = (0.55, 0.36)  # share of rows and columns that a thing that passes by hides: a fifth of the image


def mirrored(sequence: ImageSequence) -> ImageSequence:
    """Return the drive as seen in a mirror: left turns become right ones."""
    camera = sequence.camera
    matrix = camera.matrix.copy()
    matrix[0, 2] = camera.width - 1 - matrix[0, 2]
    assert sequence.reference is not None
    return replace(
        _redrawn(sequence, lambda image, _: image[:, ::-1]),
        camera=replace(camera, matrix=matrix),
        reference=_MIRROR @ sequence.reference @ _MIRROR,
    )


def reversed_in_time(sequence: ImageSequence) -> ImageSequence:
    """Return the drive from its end to its start: the camera moves backwards."""
    assert sequence.reference is not None
    frames, n = sequence.frames, len(sequence.frames)
    time_s: FloatArray = frames.time_s[0] + frames.time_s[-1] - frames.time_s[::-1]
    images = Images([frames[n - 1 - k] for k in range(n)])
    reference = np.linalg.inv(sequence.reference[-1]) @ sequence.reference[::-1]
    return replace(sequence, frames=Frames(time_s, images), reference=reference, reference_time_s=time_s)


def halved(sequence: ImageSequence) -> ImageSequence:
    """Return the drive by a camera of half the resolution."""
    camera = sequence.camera
    matrix, size = camera.matrix.copy(), (camera.width // 2, camera.height // 2)
    matrix[:2] *= 0.5
    matrix[:2, 2] -= 0.25
    small = _redrawn(
        sequence,
        lambda image, _: cv2.resize(image[: 2 * size[1], : 2 * size[0]], size, interpolation=cv2.INTER_AREA),
    )
    return replace(small, camera=replace(camera, matrix=matrix, width=size[0], height=size[1]))


def with_repeated_images(sequence: ImageSequence) -> ImageSequence:
    """Return the drive with three images repeated in place of the next ones."""
    n = len(sequence.frames)
    order = np.arange(n)
    order[[n // 4, n // 2, 3 * n // 4]] -= 1
    images = Images([sequence.frames[int(k)] for k in order])
    return replace(sequence, frames=Frames(sequence.frames.time_s, images))


def with_passing_patch(sequence: ImageSequence) -> ImageSequence:
    """Return the drive with something that hides a fifth of the image and passes by in the middle half of the drive."""
    camera, n = sequence.camera, len(sequence.frames)
    height, width = int(_PATCH[0] * camera.height), int(_PATCH[1] * camera.width)
    noise = stream(3, "real drives", "patch").standard_normal((height, width)).astype(np.float32)
    grain = np.asarray(cv2.GaussianBlur(noise, (0, 0), 2.0), np.float64)
    patch = np.clip(128.0 + 45.0 * grain / grain.std(), 0.0, 255.0).astype(np.uint8)
    top = camera.height - height

    def hidden(image: Image, k: int) -> Image:
        share = (k - n // 4) / (n // 2)
        if not 0.0 <= share <= 1.0:
            return image
        drawn, left = image.copy(), int(share * (camera.width - width))
        part = drawn[top:, left : left + width]
        part[:] = patch if drawn.ndim == 2 else patch[:, :, None]
        return drawn

    return _redrawn(sequence, hidden)


def _redrawn(sequence: ImageSequence, draw: Callable[[Image, int], object]) -> ImageSequence:
    """Return the drive with each image drawn again from itself and its number."""
    images = [
        np.ascontiguousarray(draw(sequence.frames[k], k), dtype=np.uint8) for k in range(len(sequence.frames))
    ]
    return replace(sequence, frames=Frames(sequence.frames.time_s, Images(images)))
