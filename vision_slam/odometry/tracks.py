"""Feature tracking: contrast enhancement, corner detection, pyramidal Lucas-Kanade.

`ContrastEnhancer` applies CLAHE, and `ExposureCompensation` undoes steps of the exposure between images. `detect` finds
corners with an absolute threshold and an even spread over the image. `track_corners` follows them from image to image, forward
and backward; `epipolar_motion` rejects outliers by the essential matrix. A `Track` holds the observations of one corner.
"""

from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from survey.core import BoolArray, FloatArray, InputError
from survey.data.frames import Image
from vision_slam.config import VisualOdometryConfig

_QUANTILES = np.linspace(0.05, 0.95, 19)
_UNCLIPPED_LEVELS = (4, 250)  # levels beyond are black or white, whatever the exposure
# Steps of exposure that are compensated; smaller changes of brightness are those of the scene. A sum of steps that is no
# gain within the tolerance is reset, so that rounding does not add up.
_LEAST_LOG_STEP = np.log(1.15)
_LOG_TOLERANCE = np.log(1.05)
_MOST_LOG_GAIN = np.log(4.0)


class ContrastEnhancer:
    """Contrast-limited adaptive histogram equalization (CLAHE, section I.A of the glacier paper).

    Each tile's grey values are spread over the full range, but no value gets more than
    `clip` times its share, so that noise in blank tiles is not raised without bound. Noise
    is raised all the same: what is found in an image must still be confirmed by motion.

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
        levels = np.quantile(grey[::4, ::4], _QUANTILES)
        if self._levels is not None:
            self._step(levels, self._levels)
        self._levels = levels
        gain = float(np.exp(np.clip(self._log_gain, -_MOST_LOG_GAIN, _MOST_LOG_GAIN)))
        return grey if gain == 1.0 else np.asarray(cv2.convertScaleAbs(grey, alpha=gain), dtype=np.uint8)

    def _step(self, now: FloatArray, before: FloatArray) -> None:
        lowest, highest = np.minimum(now, before), np.maximum(now, before)
        unclipped = (lowest > _UNCLIPPED_LEVELS[0]) & (highest < _UNCLIPPED_LEVELS[1])
        growth = float(np.median(np.log(now[unclipped] / before[unclipped]))) if unclipped.any() else 0.0
        if abs(growth) > _LEAST_LOG_STEP:
            self._log_gain -= growth
            self._log_gain = 0.0 if abs(self._log_gain) < _LOG_TOLERANCE else self._log_gain


def grey_of(image: Image, width: int, height: int) -> Image:
    """Return a (H, W) or (H, W, 3) blue-green-red image as grey."""
    if image.shape[:2] != (height, width):
        raise InputError(
            f"an image has {image.shape[1]} × {image.shape[0]} pixels, its calibration {width} × {height}; "
            "calibrate for this size, or give images as they were calibrated."
        )
    if image.ndim == 2:
        return np.ascontiguousarray(image)
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)


Pixels = npt.NDArray[np.float32]

_GRID = (8, 6)
_BORDER_PX = 6


def detect(image: Image, taken: Pixels, n_wanted: int, config: VisualOdometryConfig) -> Pixels:
    """Find up to `n_wanted` new corners (K, 2), spread over the image and away from those `taken` (M, 2).

    Responses are compared with an absolute threshold, and each cell of a grid takes its
    share: the usual threshold relative to the best corner would leave snow without any
    corner whenever a mountain stands on the horizon.
    """
    response = _response(image, config)
    _blank(response, taken, config.corner_spacing_px)
    side = config.corner_spacing_px + 1
    is_peak = (response >= cv2.dilate(response, np.ones((side, side), np.uint8))) & (
        response > config.corner_threshold
    )
    rows, columns = np.nonzero(is_peak)
    peaks = np.column_stack([columns, rows]).astype(np.float32)[
        np.argsort(-response[rows, columns], kind="stable")
    ]
    pixels = _spread(peaks, taken, (image.shape[1], image.shape[0]), config.n_features)[:n_wanted]
    if len(pixels):
        ends = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 10, 0.03)
        cv2.cornerSubPix(image, pixels.reshape(-1, 1, 2), (3, 3), (-1, -1), ends)
    return pixels


def _response(image: Image, config: VisualOdometryConfig) -> Any:
    """Return the strength of the corner at each pixel; keypoint detectors fill in the places that they name."""
    if config.detector == "gftt":
        return cv2.cornerMinEigenVal(image, 5)
    if config.detector == "harris":
        return np.sqrt(np.maximum(cv2.cornerHarris(image, 5, 3, 0.04), 0.0))
    finder: Any = (
        cv2.ORB.create(4 * config.n_features)
        if config.detector == "orb"
        else cv2.SIFT.create(4 * config.n_features)
    )
    response = np.zeros(image.shape, np.float32)
    for key in finder.detect(image, None):
        column, row = (round(value) for value in key.pt)
        response[row, column] = max(config.corner_threshold * (1.0 + key.response), response[row, column])
    return response


def _blank(response: Any, taken: Pixels, radius_px: int) -> None:
    for column, row in taken.tolist():
        cv2.circle(response, (int(column), int(row)), radius_px, 0.0, -1)
    response[:_BORDER_PX] = response[-_BORDER_PX:] = 0.0
    response[:, :_BORDER_PX] = response[:, -_BORDER_PX:] = 0.0


def _spread(peaks: Pixels, taken: Pixels, size: tuple[int, int], n_all: int) -> Pixels:
    """Keep of peaks (K, 2), strongest first, no more in any cell of the grid than its share."""
    cells = np.array(_GRID) / np.array(size)
    count = np.zeros(_GRID, dtype=int)
    np.add.at(count, tuple((taken * cells).astype(int).T), 1)
    share = int(np.ceil(1.25 * n_all / count.size))
    is_used = np.zeros(len(peaks), dtype=bool)
    for index, (across, down) in enumerate((peaks * cells).astype(int).tolist()):
        if count[across, down] < share:
            count[across, down] += 1
            is_used[index] = True
    return peaks[is_used]


_LEAST_RAYS = 5


@dataclass
class Track:
    """One corner: where the keyframes saw it, and the point that it is.

    ``rays[i]`` is the unit direction in the camera frame of keyframe ``keyframes[i]``;
    ``point`` (3,) its place in the window's frame, None while unknown; ``is_far`` when no
    motion so far has moved it, so that only its direction counts; ``has_moved`` when its
    direction changed by more than its error explains, so that it is not far. ``rest_pixel``
    is where it was in the last image that moved; ``planes[i]`` (2,) is where ``rays[i]`` meets z = 1.
    """

    pixel: FloatArray
    keyframes: list[int] = field(default_factory=list)
    rays: list[FloatArray] = field(default_factory=list)
    point: FloatArray | None = None
    is_far: bool = False
    has_moved: bool = False
    rest_pixel: FloatArray = field(init=False)
    planes: list[FloatArray] = field(init=False)

    def __post_init__(self) -> None:
        self.rest_pixel = self.pixel
        self.planes = [ray[:2] / ray[2] for ray in self.rays]

    def add_observation(self, keyframe: int, ray: FloatArray) -> None:
        """Add an observation from a keyframe."""
        self.keyframes.append(keyframe)
        self.rays.append(ray)
        self.planes.append(ray[:2] / ray[2])


def track_corners(
    before: Image, now: Image, pixels: Pixels, guess: Pixels, config: VisualOdometryConfig
) -> tuple[Pixels, BoolArray]:
    """Track corners (N, 2) by pyramidal Lucas-Kanade from a guess, with a forward-backward check.

    Returns their new pixels and which passed the check inside the image.
    """
    if len(pixels) == 0:
        return pixels, np.zeros(0, dtype=bool)
    ends = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 20, 0.01)
    start = np.ascontiguousarray(guess, dtype=np.float32)
    forth, found, _ = cv2.calcOpticalFlowPyrLK(
        before, now, pixels, start, winSize=(17, 17), maxLevel=3, flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        criteria=ends, minEigThreshold=1e-5,
    )  # fmt: skip
    back, found_back, _ = cv2.calcOpticalFlowPyrLK(
        now, before, forth, pixels.copy(), winSize=(17, 17), maxLevel=1, flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        criteria=ends, minEigThreshold=1e-5,
    )  # fmt: skip
    height, width = now.shape
    margin = 5.0
    landed: Pixels = np.asarray(forth, dtype=np.float32)
    inside = ((landed > margin) & (landed < np.array([width, height]) - 1 - margin)).all(axis=1)
    came_back = np.linalg.norm(back - pixels, axis=1) < config.round_trip_px
    return landed, (found.ravel() > 0) & (found_back.ravel() > 0) & came_back & inside


def epipolar_motion(before: FloatArray, now: FloatArray, angle: float) -> tuple[FloatArray, BoolArray]:
    """Return the motion (4, 4) of the camera by one unit that unit rays (N, 3) fit within an angle [rad], and which do (RANSAC).

    The motion takes coordinates of the camera after it to those before it; the identity where there is none.
    """
    first, second = (np.ascontiguousarray(rays[:, :2] / rays[:, 2:]) for rays in (before, now))
    cv2.setRNGSeed(0)  # RANSAC draws; the same images shall give the same bytes
    found: Any = cv2.findEssentialMat(first, second, np.eye(3), cv2.RANSAC, 0.999, angle)
    mask = found[1]
    motion = np.eye(4)
    if mask is None:
        return motion, np.zeros(len(before), dtype=bool)
    agree: BoolArray = mask.ravel() > 0
    _, turn, shift, _ = cv2.recoverPose(found[0][:3], first, second, np.eye(3), mask=mask.copy())
    motion[:3, :3], motion[:3, 3] = turn.T, -turn.T @ shift.ravel()
    return motion, agree


def rotation_between(before: FloatArray, now: FloatArray, angle: float) -> tuple[FloatArray, BoolArray]:
    """Return the rotation R (3, 3) with before ≈ R now of unit rays (N, 3), and which fit it within an angle [rad].

    Least squares by singular value decomposition, repeated over the inliers of a gate that narrows.
    """
    rotation, agree = np.eye(3), np.ones(len(before), dtype=np.bool_)
    for width in (16.0, 8.0, 4.0, 2.0, 1.0, 1.0):
        if agree.sum() >= _LEAST_RAYS:
            left, _, right = np.linalg.svd(before[agree].T @ now[agree])
            rotation = left @ np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))]) @ right
        agree = np.linalg.norm(before - now @ rotation.T, axis=1) < width * angle
    return rotation, agree


def quadrant_shift_px(before: Pixels, now: Pixels, size: tuple[int, int]) -> float:
    """Return the largest median shift of corners (N, 2) in a quadrant of an image of a size (width, height) [pixels]."""
    right, below = (before >= 0.5 * np.array(size)).T
    shifts = [0.0]
    for index in range(4):
        inside = 2 * right + below == index
        if inside.sum() >= _LEAST_RAYS:
            shifts.append(float(np.linalg.norm(np.median((now - before)[inside], axis=0))))
    return max(shifts)
