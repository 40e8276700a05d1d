"""Image measures for snow and ice: contrast, gradients, features, and feature matches."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from survey.core.arrays import FloatArray
from survey.data.camera.frames import Image

Mask = npt.NDArray[np.bool_]

_opencv: Any = cv2  # its stubs do not know what these functions take and give
LOCAL_SIGMA_PX = 12.0
CORNER_STRENGTH = 2e-4
"""Least eigenvalue of a corner, as the visual odometry asks for it: 1.8 grey levels per pixel in the weakest direction."""
_WINDOW_PX = 5
_SPACING_PX = 7


def clahe(image: Image) -> Image:
    """Equalise the histogram tile by tile with a limit on contrast (8 × 8 tiles, clip 4)."""
    return np.asarray(cv2.createCLAHE(4.0, (8, 8)).apply(image), dtype=np.uint8)


def rms_contrast(image: Image, mask: Mask) -> float:
    """Divide the standard deviation of the grey levels by their mean."""
    return float(image[mask].std() / image[mask].mean())


def local_contrast(image: Image, mask: Mask) -> float:
    """Return the median over the image of standard deviation over mean under a Gaussian window of 12 pixels."""
    weight = _smooth(mask.astype(np.float32)) + 1e-6
    level = np.where(mask, image, 0).astype(np.float32)
    mean = _smooth(level) / weight
    variance = np.maximum(_smooth(level * level) / weight - mean * mean, 0.0)
    return float(np.median((np.sqrt(variance) / np.maximum(mean, 1.0))[mask]))


def _smooth(values: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    return np.asarray(cv2.GaussianBlur(values, (0, 0), LOCAL_SIGMA_PX), dtype=np.float32)


def gradients(image: Image, mask: Mask) -> FloatArray:
    """Return the lengths of the gradient [grey levels per pixel] at the masked pixels."""
    derivatives = [cv2.Sobel(image, cv2.CV_32F, *axis, ksize=3) / 8.0 for axis in ((1, 0), (0, 1))]
    return np.asarray(np.hypot(*derivatives)[mask], dtype=np.float64)


def entropy_bits(image: Image, mask: Mask) -> float:
    """Return the entropy of the histogram of grey levels."""
    share = np.bincount(image[mask], minlength=256) / mask.sum()
    return float(-(share[share > 0] * np.log2(share[share > 0])).sum())


def corners(image: Image, mask: Mask) -> FloatArray:
    """Shi and Tomasi's corners above an absolute threshold, at most one in 7 × 7 pixels, (N, 2)."""
    return _peaks(_opencv.cornerMinEigenVal(image, _WINDOW_PX), CORNER_STRENGTH, mask)


def harris_corners(image: Image, mask: Mask) -> FloatArray:
    """Return Harris's corners (k = 0.04) above the same threshold, squared as his measure is."""
    return _peaks(_opencv.cornerHarris(image, _WINDOW_PX, 3, 0.04), CORNER_STRENGTH**2, mask)


def relative_corners(image: Image, mask: Mask) -> FloatArray:
    """Shi and Tomasi's corners as they are often found: above 1 % of the image's best; `mask` is applied afterwards."""
    found = cv2.goodFeaturesToTrack(image, 3000, 0.01, _SPACING_PX, blockSize=_WINDOW_PX)
    places: FloatArray = np.zeros((0, 2)) if found is None else found[:, 0].astype(np.float64)
    u, v = np.rint(places).astype(int).T
    inside: FloatArray = places[mask[v, u]]
    return inside


def _peaks(strength: npt.NDArray[np.float32], threshold: float, mask: Mask) -> FloatArray:
    highest = cv2.dilate(strength, np.ones((_SPACING_PX, _SPACING_PX), np.uint8))
    v, u = np.nonzero((strength >= highest) & (strength > threshold) & mask)
    return np.column_stack([u, v]).astype(np.float64)


@dataclass(frozen=True)
class Pair:
    """Two images, and where the first one's pixels are in the second."""

    first: Image
    second: Image
    flow: FloatArray
    """(H, W, 2) [pixels]."""
    mask: Mask
    """Terrain of the first image that is visible in the second."""

    def equalised(self) -> "Pair":
        """Return the pair after CLAHE."""
        return Pair(clahe(self.first), clahe(self.second), self.flow, self.mask)

    def correct(self, start: FloatArray, end: FloatArray, within_px: float = 2.0) -> int:
        """Count the matches that end where the flow says."""
        if len(start) == 0:
            return 0
        u, v = np.rint(start).astype(int).T
        error = np.linalg.norm(end - start - self.flow[v, u], axis=1)
        return int((error < within_px).sum())


def tracked(pair: Pair, start: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Follow places by Lucas and Kanade's method forwards and back; keep those that return within a pixel."""
    if len(start) == 0:
        return start, start
    points = start.astype(np.float32)[:, None]
    window = {"winSize": (21, 21), "maxLevel": 4}
    end, ahead, _ = _opencv.calcOpticalFlowPyrLK(pair.first, pair.second, points, None, **window)
    back, again, _ = _opencv.calcOpticalFlowPyrLK(pair.second, pair.first, end, None, **window)
    tracked = (ahead.ravel() == 1) & (again.ravel() == 1)
    tracked &= np.linalg.norm((back - points)[:, 0], axis=1) < 1.0
    return start[tracked], end[tracked, 0].astype(np.float64)


def described(
    pair: Pair, detector: "cv2.Feature2D", norm: int, ratio: float
) -> tuple[int, FloatArray, FloatArray]:
    """Detect and match by descriptors: mutual nearest neighbours that beat the second nearest by a ratio."""
    first, words = detector.detectAndCompute(pair.first, pair.mask.astype(np.uint8) * 255)
    second, others = detector.detectAndCompute(pair.second, None)
    if len(first) < 2 or len(second) < 2:
        return len(first), np.zeros((0, 2)), np.zeros((0, 2))
    matcher = cv2.BFMatcher(norm)
    ahead = [
        two[0] for two in matcher.knnMatch(words, others, k=2) if two[0].distance < ratio * two[1].distance
    ]
    back = {match.queryIdx: match.trainIdx for match in matcher.match(others, words)}
    pairs = [(m.queryIdx, m.trainIdx) for m in ahead if back.get(m.trainIdx) == m.queryIdx]
    start = np.array([first[i].pt for i, _ in pairs], dtype=np.float64).reshape(-1, 2)
    end = np.array([second[k].pt for _, k in pairs], dtype=np.float64).reshape(-1, 2)
    return len(first), start, end


@dataclass(frozen=True)
class Yield:
    """Counts of one method on one pair."""

    detected: int
    matched: int
    correct: int


def by_tracking(detect: Callable[[Image, Mask], FloatArray]) -> Callable[[Pair], Yield]:
    """Return the method that detects corners and tracks them."""

    def method(pair: Pair) -> Yield:
        found = detect(pair.first, pair.mask)
        start, end = tracked(pair, found)
        return Yield(len(found), len(start), pair.correct(start, end))

    return method


def by_orb(pair: Pair) -> Yield:
    """Return corners by ORB with its default, absolute threshold of 20 grey levels."""
    found, start, end = described(pair, cv2.ORB.create(3000), cv2.NORM_HAMMING, 0.9)
    return Yield(found, len(start), pair.correct(start, end))


def by_sift(pair: Pair) -> Yield:
    """Return corners by SIFT with its default, absolute threshold on contrast."""
    found, start, end = described(pair, cv2.SIFT.create(), cv2.NORM_L2, 0.8)
    return Yield(found, len(start), pair.correct(start, end))


METHODS: dict[str, Callable[[Pair], Yield]] = {
    "GFTT + KLT": by_tracking(corners),
    "Harris + KLT": by_tracking(harris_corners),
    "ORB": by_orb,
    "SIFT": by_sift,
    "GFTT + KLT, relative threshold": by_tracking(relative_corners),
}


def statistics(image: Image, mask: Mask) -> dict[str, float]:
    """Return the measures by which rendered images are compared with photographs, features per megapixel."""
    megapixels = mask.sum() / 1e6
    slopes = gradients(image, mask)
    grey = np.percentile(image[mask], [5, 50, 95])
    values = {
        "RMS contrast": rms_contrast(image, mask),
        "local contrast": local_contrast(image, mask),
        "gradient, median": float(np.median(slopes)),
        "gradient, 90th percentile": float(np.quantile(slopes, 0.9)),
        "gradient, 90th over 50th": float(np.quantile(slopes, 0.9) / max(np.median(slopes), 0.1)),
        "grey levels, 5th to 95th": float(grey[2] - grey[0]),
        "skew of grey levels": float((grey[2] - 2.0 * grey[1] + grey[0]) / max(grey[2] - grey[0], 1.0)),
        "entropy": entropy_bits(image, mask),
    }
    for suffix, picture in (("", image), (" after CLAHE", clahe(image))):
        values["GFTT" + suffix] = len(corners(picture, mask)) / megapixels
        values["Harris" + suffix] = len(harris_corners(picture, mask)) / megapixels
        byte_mask = mask.astype(np.uint8) * 255
        values["ORB" + suffix] = len(cv2.ORB.create(20000).detect(picture, byte_mask)) / megapixels
        values["SIFT" + suffix] = len(cv2.SIFT.create().detect(picture, byte_mask)) / megapixels
    return values
