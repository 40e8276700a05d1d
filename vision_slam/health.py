"""Whether an image, and what was followed into it, can be believed."""

from dataclasses import dataclass

import cv2
import numpy as np

from survey.camera import Image


@dataclass(frozen=True)
class FrameHealth:
    """What is known about one frame.

    ``entropy_bits`` of the grey values, ``saturated`` share of white or black pixels,
    ``sharpness`` standard deviation of the Laplacian [grey levels], ``n_followed``
    corners, ``n_inliers`` of them that agree with one pose, and whether the pose
    ``is_visual`` or was bridged by wheels and gyro.
    """

    entropy_bits: float
    saturated: float
    sharpness: float
    n_followed: int = 0
    n_inliers: int = 0
    is_visual: bool = False

    @property
    def inlier_ratio(self) -> float:
        """Share of the followed corners that agree with one pose."""
        return self.n_inliers / max(self.n_followed, 1)


def image_health(grey: Image) -> FrameHealth:
    r"""Measure an image as it came from the camera, on every other pixel.

    The entropy is H = −Σ p log₂ p over the 256 grey values: 0 for a blank image, about
    2.4 for a blank one with noise of 1.3 grey levels, above 4 where there is anything to see.

    Examples
    --------
    >>> image_health(np.full((40, 60), 200, np.uint8)).entropy_bits
    0.0
    """
    small = grey[::2, ::2]
    share = np.bincount(small.ravel(), minlength=256) / small.size
    seen = share[share > 0.0]
    return FrameHealth(
        entropy_bits=float(-(seen * np.log2(seen)).sum() + 0.0),
        saturated=float(share[0] + share[255]),
        sharpness=float(cv2.Laplacian(small, cv2.CV_32F).std()),
    )
