"""CLAHE contrast enhancement and exposure compensation."""

from typing import Any

import cv2
import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.camera.frames import Image

_SHARES = np.linspace(0.05, 0.95, 19)
_CLIPPED = (4, 250)  # levels beyond are black or white, whatever the exposure
_STEP = np.log(1.15)
_USUAL = np.log(1.05)
_MOST = np.log(4.0)


class ContrastEnhancer:
    """Contrast-limited adaptive histogram equalization (CLAHE, section I.A of the glacier paper).

    Each tile's grey values are spread over the full range, but no value gets more than
    `clip` times its share, so that noise in blank tiles is not raised without bound. Noise
    is raised all the same: what is found in an image must still be confirmed by motion.

    Examples
    --------
    >>> ramp = np.tile(np.arange(118, 138, dtype=np.uint8), (64, 4))
    >>> bool(np.ptp(ContrastEnhancer(4.0, 2)(ramp)) > 3 * np.ptp(ramp))
    True
    """

    def __init__(self, clip: float, n_tiles: int) -> None:
        self._clahe: Any = cv2.createCLAHE(clip, (n_tiles, n_tiles)) if clip > 0.0 else None
        self._exposure = ExposureCompensation()

    def __call__(self, grey: Image) -> Image:
        """Return the enhanced image of the same shape."""
        level = self._exposure.compensated(grey)
        return level if self._clahe is None else np.asarray(self._clahe.apply(level), dtype=np.uint8)


class ExposureCompensation:
    """Compensation of exposure steps in a sequence of images.

    Corners are followed by their grey values, which must stay what they were. From image to
    image the quantiles of the grey values that are neither black nor white grow by some
    factor; where its median is beyond 15 % the camera has changed its exposure, and from then
    on images are multiplied by what undoes that, up to 4. What was white stays white.

    Examples
    --------
    >>> ramp = np.tile(np.arange(80, 120, dtype=np.uint8), (64, 4))
    >>> exposure = ExposureCompensation()
    >>> exposure.compensated(ramp) is ramp
    True
    >>> int(np.abs(exposure.compensated(2 * ramp).astype(int) - ramp).max())
    0
    """

    def __init__(self) -> None:
        self._levels: FloatArray | None = None
        self._log_gain = 0.0

    def compensated(self, grey: Image) -> Image:
        """Return the next image as it would be with the exposure of the first."""
        levels = np.quantile(grey[::4, ::4], _SHARES)
        if self._levels is not None:
            self._step(levels, self._levels)
        self._levels = levels
        gain = float(np.exp(np.clip(self._log_gain, -_MOST, _MOST)))
        return grey if gain == 1.0 else np.asarray(cv2.convertScaleAbs(grey, alpha=gain), dtype=np.uint8)

    def _step(self, now: FloatArray, before: FloatArray) -> None:
        lowest, highest = np.minimum(now, before), np.maximum(now, before)
        unclipped = (lowest > _CLIPPED[0]) & (highest < _CLIPPED[1])
        growth = float(np.median(np.log(now[unclipped] / before[unclipped]))) if unclipped.any() else 0.0
        if abs(growth) > _STEP:
            self._log_gain -= growth
            self._log_gain = 0.0 if abs(self._log_gain) < _USUAL else self._log_gain


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
