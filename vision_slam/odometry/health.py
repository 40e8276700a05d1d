"""Frame health: image quality, tracking quality and loss of vision."""

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from survey.core.arrays import BoolArray, FloatArray
from survey.data.camera.frames import Image

_LOST_M = 20.0  # travel without images after which wheels and gyro alone are no pose any more
_BRIDGED = 0.05  # relative error of the travel by wheels alone, beyond their scale
_GUESSED = 0.5  # relative error of the travel at the speed before a gap, which a vehicle may leave
_TURN_RAD_S, _MOST_TURN_RAD = 0.2, 1.0  # rate of an unmeasured turn, and the most that is assumed of it
_FEW, _MANY = 0.25, 0.5  # of the corners that are wanted


@dataclass(frozen=True)
class FrameHealth:
    """Image and tracking quality of one frame.

    Parameters
    ----------
    entropy_bits : float
        Entropy of the grey values [bits].
    saturated : float
        Share of white or black pixels.
    sharpness : float
        Standard deviation of the Laplacian [grey levels].
    n_followed : int
        Number of tracked corners.
    n_inliers : int
        Number of corners that agree with one pose. Where the last view before a gap was recognized, no corner was
        tracked, and the inliers are features of that view.
    is_visual : bool
        Whether the pose comes from images; else wheels and gyro bridge it.
    """

    entropy_bits: float
    saturated: float
    sharpness: float
    n_followed: int = 0
    n_inliers: int = 0
    is_visual: bool = False

    @property
    def is_recognized(self) -> bool:
        """Whether the pose is from a view that was recognized after a hole."""
        return self.is_visual and self.n_followed == 0

    @property
    def inlier_ratio(self) -> float:
        """Share of the followed corners that agree with one pose."""
        return min(self.n_inliers / max(self.n_followed, 1), 1.0)


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


class VisionHysteresis:
    """Hysteresis for distrusting images that contradict the wheels with few corners.

    Images that show wheel spin are right if many corners agree. With few corners, as on snow
    without enhancement, the map shrinks slowly instead. Images are distrusted from the first time
    that fewer than a quarter of the wanted corners contradict the wheels, until half of the wanted
    corners agree again.

    Parameters
    ----------
    n_wanted : int
        Corners that are looked for.

    Examples
    --------
    >>> hysteresis = VisionHysteresis(200)
    >>> [hysteresis.update(n, slips) for n, slips in ((40, False), (90, True), (40, True), (90, False), (120, False))]
    [False, False, True, True, False]
    """

    def __init__(self, n_wanted: int) -> None:
        self._n_wanted = n_wanted
        self.is_distrusted = False

    def update(self, n_inliers: int, is_slipping: bool) -> bool:
        """Update by the number of inliers and the current slip state; return whether images are distrusted."""
        if is_slipping and n_inliers < _FEW * self._n_wanted:
            self.is_distrusted = True
        elif n_inliers >= _MANY * self._n_wanted:
            self.is_distrusted = False
        return self.is_distrusted


class BridgedErrors(NamedTuple):
    """Errors of steps (N - 1,) [m] and of their turns (N - 1,) [rad], where images measured neither."""

    step_m: FloatArray
    turn_rad: FloatArray


def bridged_errors(
    steps: FloatArray,
    seconds: FloatArray,
    health: tuple[FrameHealth, ...],
    *,
    has_wheels: bool,
    has_gyro: bool,
) -> BridgedErrors:
    """Return the errors of steps that images did not measure, fully correlated over each gap.

    Wheels and gyro bridge a gap. Without wheels its length is that of the speed before it, which may change; without
    wheels and gyro its turn is unknown.

    Parameters
    ----------
    steps : (N - 1, 3) ndarray
        Steps in any unit.
    seconds : (N - 1,) ndarray
        Their durations [s].
    health : tuple of FrameHealth
        Of the N images.
    has_wheels, has_gyro : bool
        What measured the motion beside the images.
    """
    length = np.linalg.norm(steps, axis=1)
    is_blind = np.array([not frame.is_visual for frame in health[1:]], dtype=bool)
    edges = np.flatnonzero(np.diff(np.r_[False, is_blind, False]))
    share = _BRIDGED if has_wheels else _GUESSED
    found = BridgedErrors(np.zeros(len(length)), np.zeros(len(length)))
    for first, end in edges.reshape(-1, 2).tolist():
        n_steps = (end - first) ** 0.5
        found.step_m[first:end] = share * length[first:end] * n_steps
        if not (has_wheels or has_gyro):
            turn = min(_TURN_RAD_S * float(seconds[first:end].sum()), _MOST_TURN_RAD)
            found.turn_rad[first:end] = turn / n_steps
    return found


def is_lost(poses: FloatArray, health: tuple[FrameHealth, ...], has_wheels: bool) -> BoolArray:
    """Return which poses (N, 4, 4) have rested on wheels and gyro for more than 20 m, or without wheels on nothing."""
    travel = np.r_[0.0, np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)]
    blind_m, lost = 0.0, []
    for index, (length, frame) in enumerate(zip(travel.tolist(), health, strict=True)):
        blind_m = 0.0 if frame.is_visual or index == 0 else blind_m + length
        lost.append(blind_m > (_LOST_M if has_wheels else 0.0))
    return np.array(lost)
