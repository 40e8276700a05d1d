"""Contrast that snow does not have of itself."""

from typing import Any

import cv2
import numpy as np

from survey.camera import Image
from survey.errors import InputError


class Enhancer:
    """Contrast-limited adaptive histogram equalization (CLAHE, section I.A of the glacier paper).

    Each tile's grey values are spread over the whole range, but no value gets more than
    `clip` times its share, so that noise in blank tiles is not raised without bound. Noise
    is raised all the same: what is found in an image must still be confirmed by motion.

    Examples
    --------
    >>> ramp = np.tile(np.arange(118, 138, dtype=np.uint8), (64, 4))
    >>> bool(np.ptp(Enhancer(4.0, 2)(ramp)) > 3 * np.ptp(ramp))
    True
    """

    def __init__(self, clip: float, n_tiles: int) -> None:
        self._clahe: Any = cv2.createCLAHE(clip, (n_tiles, n_tiles)) if clip > 0.0 else None

    def __call__(self, grey: Image) -> Image:
        """Return the enhanced image of the same shape."""
        return grey if self._clahe is None else np.asarray(self._clahe.apply(grey), dtype=np.uint8)


def grey_of(image: Image, width: int, height: int) -> Image:
    """Return a (H, W) or (H, W, 3) blue-green-red image as grey.

    Raises
    ------
    InputError
        The image has another size than the calibration was made for.
    """
    if image.shape[:2] != (height, width):
        raise InputError(
            f"an image has {image.shape[1]} × {image.shape[0]} pixels, its calibration {width} × {height}; "
            "calibrate for this size, or give images as they were calibrated."
        )
    if image.ndim == 2:
        return np.ascontiguousarray(image)
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
