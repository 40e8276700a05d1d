"""Health of images and wheels: image and tracking quality, loss of vision, wheel slip, idle encoders.

`FrameHealth` measures one image; `bridged_errors` and `is_lost` describe stretches that images do not cover.
`WheelSlipDetector` compares the travel by wheels with that by images, whose scale it takes from the height of the camera above
the ground. `wheels_are_idle` finds encoders that count no travel.
"""

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from survey.core import BoolArray, FloatArray
from survey.data.frames import Image
from vision_slam.readers.sequence import VisionRecords

_LOST_M = 20.0  # travel without images after which wheels and gyro alone are no pose any more
_BRIDGED = 0.05  # relative error of the travel by wheels alone, beyond their scale
_GUESSED = 0.5  # relative error of the travel at the speed before a gap, which a vehicle may leave
_TURN_RAD_S, _MOST_TURN_RAD = 0.2, 1.0  # rate of an unmeasured turn, and the most that is assumed of it
_FEW, _MANY = 0.25, 0.5  # of the corners that are wanted


@dataclass(frozen=True)
class FrameHealth:
    """Image and tracking quality of one frame.

    `entropy_bits`: entropy of the grey values [bits]. `saturated`: share of white or black pixels.
    `sharpness`: standard deviation of the Laplacian [grey levels]. `n_followed`: number of tracked corners.
    `n_inliers`: number of corners that agree with one pose. Where the last view before a gap was recognized,
    no corner was tracked, and the inliers are features of that view. `is_visual`: whether the pose comes from
    images; else wheels and gyro bridge it.
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

    `n_wanted`: corners that are looked for.

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

    `steps` (N - 1, 3): steps in any unit. `seconds` (N - 1,): their durations [s].
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


_AHEAD_HEIGHTS, _ASIDE_HEIGHTS = (
    (0.4, 3.5),
    1.4,
)  # patch of ground that is looked at, in heights of the camera
_LEAST_POINTS = 8
_MEMORY_M, _RATIO_MEMORY_M = 10.0, 2.0
_SLIPPING = 0.12
_SETTLED = 10  # keyframes after which the map has a size
_LEAST_ROLLED_M, _LEAST_TRAVEL_M = 0.02, 1e-3
_WHEEL_SIGMA = 0.03
# What rough ground makes of the height over 25 m, measured on drives over ground that is known.
_HEIGHT_SIGMA, _HEIGHT_SIGMA_OVER_M = 0.016, 25.0
_OUTLYING, _MOST_LOG_SCALE = 0.1, 0.06


class WheelSlipDetector:
    r"""Comparison of the travel by wheels with that by images, from keyframe to keyframe.

    One camera sees shapes, not sizes; but the ground just ahead must lie as far below the
    camera as it is mounted, h₀. If the map puts it h below, its lengths are too short by
    c = log(h₀ / h). Rough ground gives this an error of a tenth, 1.6 % over 25 m. A Kalman filter
    estimates from it the scale error s of wheels with a standard deviation of 3 %. Beyond 6 % the height is not accepted.

    Where the wheels spin, or skid in a turn, the map keeps the size that it has for some
    metres: with L the travel by images and R that by wheels, that is while

    .. math:: \log(L / R) − s + \bar c < −0.12

    where c is averaged over 10 m, from when the left side falls by as much below its own
    mean over 2 m: a map shrinks slowly, which the wheels correct. Slip below
    that threshold counts as an error of the wheels' scale. As long as the wheels spin, the travel is L,
    which \bar c corrects gradually, once.
    """

    def __init__(self, height_m: float) -> None:
        self._height_m = height_m
        self._log_scale, self._variance = 0.0, _WHEEL_SIGMA**2
        self._size = self._usual_ratio = 0.0
        self._n_seen, self._slid = 0, 1.0
        self.is_slipping = False

    @property
    def share(self) -> float:
        """Factor of the travel by wheels for prediction; includes the current slip."""
        return self.scale * (self._slid if self.is_slipping else 1.0)

    @property
    def scale(self) -> float:
        """Factor of the travel by wheels without slip."""
        return float(np.exp(np.clip(self._log_scale, -_MOST_LOG_SCALE, _MOST_LOG_SCALE)))

    def travel_m(self, rolled_m: float, seen_m: float | None) -> float:
        """Return the travel of the body between two keyframes [m]: by wheels, or by images while they spin.

        Without a travel by images, spin is not detected.
        """
        wheel_m = self.scale * rolled_m
        if seen_m is None:
            self._n_seen, self.is_slipping = 0, False
        if seen_m is None or rolled_m < _LEAST_ROLLED_M:
            return wheel_m
        self._n_seen += 1
        seen_m = max(seen_m, _LEAST_TRAVEL_M)
        ratio = float(np.log(seen_m / wheel_m)) + self._size
        is_new = self._n_seen > _SETTLED and ratio < self._usual_ratio - _SLIPPING
        self.is_slipping = ratio < -_SLIPPING and (self.is_slipping or is_new)
        if self.is_slipping:
            self._slid = min(seen_m / wheel_m, 1.0)
            return seen_m * float(np.exp(_weight_of_newest(seen_m, _MEMORY_M) * self._size))
        self._usual_ratio += _weight_of_newest(rolled_m, _RATIO_MEMORY_M) * (ratio - self._usual_ratio)
        return wheel_m

    def observe(self, points: FloatArray, travel_m: float) -> None:
        """Take ground points (N, 3) in the body frame, and the travel since the last ones [m]."""
        height = self._height_m
        near = (np.abs(points[:, 1]) < _ASIDE_HEIGHTS * height) & (
            (points[:, 0] > _AHEAD_HEIGHTS[0] * height) & (points[:, 0] < _AHEAD_HEIGHTS[1] * height)
        )
        if near.sum() < _LEAST_POINTS or travel_m < _LEAST_TRAVEL_M:
            return
        seen = height - float(np.median(points[near, 2]))
        if not 0.3 * height < seen < 3.0 * height:
            return
        size = float(np.log(height / seen))
        self._size += _weight_of_newest(travel_m, _MEMORY_M) * (size - self._size)
        if not self.is_slipping and self._n_seen > _SETTLED:
            noise = _HEIGHT_SIGMA**2 * _HEIGHT_SIGMA_OVER_M / travel_m
            gain = self._variance / (self._variance + noise)
            self._log_scale += gain * float(np.clip(size, -_OUTLYING, _OUTLYING))
            self._variance *= 1.0 - gain


def _weight_of_newest(travel_m: float, memory_m: float) -> float:
    """Return by how much the newest of a running mean counts."""
    return 1.0 - float(np.exp(-travel_m / memory_m))


IDLE_WHEELS = (
    "the wheels count no travel while the images move, and were left out, so that lengths are metres with fixes only; "
    "check the encoder or its table"
)
_IDLE_M = 2e-3


class WithoutWheels:
    """Records of a drive without those of its wheels."""

    def __init__(self, records: VisionRecords) -> None:
        self.camera, self.frames = records.camera, records.frames
        self.wheels = None
        self.inertial, self.compass = records.inertial, records.compass


def wheels_are_idle(records: VisionRecords) -> bool:
    """Return whether there are wheels and they count less than 2 mm over the complete drive."""
    wheels = records.wheels
    return wheels is not None and bool(max(np.ptp(wheels.left_m), np.ptp(wheels.right_m)) < _IDLE_M)
