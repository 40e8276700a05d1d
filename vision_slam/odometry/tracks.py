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

from survey.core import BoolArray, FloatArray, InputError, IntArray
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
        levels = _quantiles(grey[::4, ::4])
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


def _quantiles(grey: Image) -> FloatArray:
    """Return the quantiles (19,) of grey values, linear between two values in their order, by counts of the 256 values."""
    place = _QUANTILES * (grey.size - 1)
    rank = place.astype(np.int64)
    up_to = np.cumsum(np.bincount(grey.ravel(), minlength=256))
    low, high = np.searchsorted(up_to, [rank, rank + 1], side="right")
    quantiles: FloatArray = low + (place - rank) * (high - low)
    return quantiles


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
_MARGIN_PX = 4  # about a part of an image, within which corner responses depend on what lies outside
_SEARCHED_EVERY = 5
_NO_PEAKS = np.zeros((0, 2), np.float32), np.zeros(0, np.float32)


class CornerDetector:
    """Detection of new corners, spread over the image, in the cells of a grid that have too few.

    Cells in which nothing was found, as in the sky, are searched again at every fifth image only.
    """

    def __init__(self, config: VisualOdometryConfig) -> None:
        self._config = config
        self._is_empty = np.zeros(_GRID, dtype=bool)
        self._n_images = 0

    def __call__(self, image: Image, taken: Pixels, n_wanted: int) -> Pixels:
        """Find up to `n_wanted` new corners (K, 2) away from those `taken` (M, 2)."""
        searched = ~self._is_empty | (self._n_images % _SEARCHED_EVERY == 0)
        self._n_images += 1
        found = detect(image, taken, n_wanted, self._config, searched)
        count = _counts(np.concatenate([taken, found]), (image.shape[1], image.shape[0]))
        self._is_empty = np.where(searched, count == 0, self._is_empty)
        return found


def detect(
    image: Image,
    taken: Pixels,
    n_wanted: int,
    config: VisualOdometryConfig,
    searched: BoolArray | None = None,
) -> Pixels:
    """Find up to `n_wanted` new corners (K, 2), spread over the image and away from those `taken` (M, 2).

    Responses are compared with an absolute threshold, and each cell of a grid takes its
    share: the usual threshold relative to the best corner would leave snow without any
    corner whenever a mountain stands on the horizon. `searched` (8, 6): cells that are searched, all by default.
    """
    size = image.shape[1], image.shape[0]
    room = _share(config.n_features) - _counts(taken, size)
    lacks = room > 0 if searched is None else (room > 0) & searched
    is_free = np.full(image.shape, 255, np.uint8)
    for column, row in taken.tolist():
        cv2.circle(is_free, (int(column), int(row)), config.corner_spacing_px, 0, -1)
    is_free[:_BORDER_PX] = is_free[-_BORDER_PX:] = 0
    is_free[:, :_BORDER_PX] = is_free[:, -_BORDER_PX:] = 0
    # Detectors of keypoints find none near the border of a part.
    boxes = _boxes(lacks, size) if config.detector in ("gftt", "harris") else [(0, size[0], 0, size[1])]
    parts = [_peaks(image, is_free, box, config) for box in boxes]
    peaks, response = (np.concatenate(part) for part in zip(_NO_PEAKS, *parts, strict=True))
    pixels = _spread(peaks[np.argsort(-response, kind="stable")], room, size)[:n_wanted]
    if len(pixels):
        ends = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 10, 0.03)
        cv2.cornerSubPix(image, pixels.reshape(-1, 1, 2), (3, 3), (-1, -1), ends)
    return pixels


def _share(n_all: int) -> int:
    """Return the most corners of a cell."""
    return int(np.ceil(1.25 * n_all / (_GRID[0] * _GRID[1])))


def _cells(pixels: Pixels, size: tuple[int, int]) -> tuple[IntArray, IntArray]:
    """Return the column and the row of the cell (N,) of each pixel (N, 2)."""
    across, down = (pixels * (np.array(_GRID) / np.array(size))).astype(np.int64).T
    return across, down


def _counts(pixels: Pixels, size: tuple[int, int]) -> IntArray:
    """Return the number of pixels (N, 2) in each cell of the grid."""
    across, down = _cells(pixels, size)
    return np.bincount(_GRID[1] * across + down, minlength=_GRID[0] * _GRID[1]).reshape(_GRID)


def _boxes(lacks: BoolArray, size: tuple[int, int]) -> list[tuple[int, int, int, int]]:
    """Return the boxes (left, right, top, bottom) of cells that lack corners, neighbours in a row as one [pixels]."""
    boxes = []
    bordered = np.zeros((_GRID[0] + 2, _GRID[1]), dtype=bool)
    bordered[1:-1] = lacks
    changes = bordered[1:] != bordered[:-1]
    for down in range(_GRID[1]):
        top, bottom = (-(-row * size[1] // _GRID[1]) for row in (down, down + 1))
        edges = np.flatnonzero(changes[:, down]).tolist()
        for first, last in zip(edges[::2], edges[1::2], strict=True):
            left, right = (-(-column * size[0] // _GRID[0]) for column in (first, last))
            boxes.append((left, right, top, bottom))
    return boxes


def _peaks(
    image: Image, is_free: Image, box: tuple[int, int, int, int], config: VisualOdometryConfig
) -> tuple[Pixels, Pixels]:
    """Return the pixels (N, 2) in a box whose response is the largest about them, and their response (N,)."""
    left, right, top, bottom = box
    reach = config.corner_spacing_px // 2 + _MARGIN_PX
    x, y = max(left - reach, 0), max(top - reach, 0)
    part = slice(y, bottom + reach), slice(x, right + reach)
    response = cv2.copyTo(_response(np.ascontiguousarray(image[part]), config), is_free[part])
    side = config.corner_spacing_px + 1
    highest = cv2.dilate(response, np.ones((side, side), np.uint8))
    inside = slice(top - y, bottom - y), slice(left - x, right - x)
    is_peak = (response[inside] >= highest[inside]) & (response[inside] > config.corner_threshold)
    if not is_peak.any():
        return _NO_PEAKS
    peaks = cv2.findNonZero(is_peak.view(np.uint8)).reshape(-1, 2)
    found: Pixels = response[inside][peaks[:, 1], peaks[:, 0]]
    return (peaks + [left, top]).astype(np.float32), found


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


def _spread(peaks: Pixels, room: IntArray, size: tuple[int, int]) -> Pixels:
    """Keep of peaks (K, 2), strongest first, no more in any cell of the grid than it has room for."""
    across, down = _cells(peaks, size)
    cell = _GRID[1] * across + down
    order = np.argsort(cell, kind="stable")  # strongest first within a cell
    rank = np.empty(len(peaks), dtype=int)
    rank[order] = np.arange(len(peaks)) - np.searchsorted(cell[order], cell[order])
    kept: Pixels = peaks[rank < room.ravel()[cell]]
    return kept


_LEAST_RAYS = 5


@dataclass
class Track:
    """One corner: where the keyframes saw it, and the point that it is.

    ``rays[i]`` is the unit direction in the camera frame of keyframe ``keyframes[i]``. ``homogeneous`` (4,) is its place
    in the window's frame times its inverse distance from the newest keyframe, and that inverse distance [1/m], 0 for a direction;
    None while unknown. ``nearness_sigma`` is the standard deviation of the inverse distance [1/m]; ``is_near`` where it
    is significantly above 0, ``is_far`` where it is significantly below that of 200 m, so that the direction alone counts.
    ``rest_pixel`` is where it was in the last image that moved.
    """

    pixel: FloatArray
    keyframes: list[int] = field(default_factory=list)
    rays: list[FloatArray] = field(default_factory=list)
    homogeneous: FloatArray | None = None
    nearness_sigma: float = np.inf
    is_near: bool = False
    is_far: bool = False
    rest_pixel: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        self.rest_pixel = self.pixel

    @property
    def point(self) -> FloatArray | None:
        """Place (3,) in the window's frame; None where its distance is not known to be finite."""
        return (
            self.homogeneous[:3] / self.homogeneous[3]
            if self.is_near and self.homogeneous is not None
            else None
        )

    def add_observation(self, keyframe: int, ray: FloatArray) -> None:
        """Add an observation from a keyframe."""
        self.keyframes.append(keyframe)
        self.rays.append(ray)


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
