"""Features of photographs that overlap, matched over all of them.

`tracks_of` detects scale-invariant features (SIFT, Lowe 2004) on images whose contrast is equalized (CLAHE), matches them in
pairs, keeps the matches that one epipolar geometry explains, and joins them to tracks.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import cv2
import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from survey.core import FloatArray, IntArray, Progress
from survey.data.frames import Frames, Image
from vision_slam.odometry.global_adjustment import TrackPixels

_LONG_SIDE_PX = 1600  # of the image that features are detected on
_N_FEATURES = 3000  # the strongest of an image
_CONTRAST = 0.01  # of a feature of SIFT, at equalized contrast
_CLIP_LIMIT, _TILES = 2.0, (8, 8)
_RATIO = 0.8  # distance of the best match over that of the second
_EPIPOLAR_PX = 2.0  # of the image that features are detected on
_LEAST_MATCHES = 25  # of two photographs; fewer arise by chance
_CONFIDENCE, _N_TRIALS = 0.9999, 10_000
_ALL_PAIRS = 60  # photographs of which all pairs are matched
_N_NEAREST, _N_NEXT = 15, 6  # photographs that each is matched with otherwise, by place and by time


class ImageFeatures(NamedTuple):
    """Features of an image: pixels (N, 2), and descriptors (N, 128) of unit length."""

    pixel: FloatArray
    descriptor: "np.ndarray[tuple[int, ...], np.dtype[np.float32]]"


class MatchedPair(NamedTuple):
    """Two photographs and the features (M, 2) of the first and the second that match."""

    first: int
    second: int
    features: IntArray


class Matches(NamedTuple):
    """Matched pairs, pixels (N, 2) of all features by photograph, and the tracks over all photographs."""

    pairs: tuple[MatchedPair, ...]
    pixels: tuple[FloatArray, ...]
    tracks: TrackPixels


def detect_features(image: Image) -> ImageFeatures:
    """Detect features; their descriptors are square roots of those of SIFT (Arandjelović and Zisserman 2012).

    `image` (H, W) or (H, W, 3): grey, or blue, green, red.
    """
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    factor = min(1.0, _LONG_SIDE_PX / max(grey.shape))
    if factor < 1.0:
        grey = cv2.resize(grey, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    even = cv2.createCLAHE(_CLIP_LIMIT, _TILES).apply(np.ascontiguousarray(grey, dtype=np.uint8))
    sift = cv2.SIFT.create(_N_FEATURES, contrastThreshold=_CONTRAST)
    found, descriptor = sift.detectAndCompute(even, None)
    if len(found) == 0:
        return ImageFeatures(np.zeros((0, 2)), np.zeros((0, 128), dtype=np.float32))
    pixel, once = np.unique(np.array([one.pt for one in found]), axis=0, return_index=True)
    share = descriptor[once] / np.maximum(np.abs(descriptor[once]).sum(axis=1, keepdims=True), 1e-9)
    return ImageFeatures((pixel + 0.5) / factor - 0.5, np.sqrt(share).astype(np.float32))


def epipolar_error_px(image: Image) -> float:
    """Return the error of a feature in an image [pixels], which is one of the image that features are detected on."""
    return _EPIPOLAR_PX * max(1.0, float(max(image.shape[:2])) / _LONG_SIDE_PX)


def tracks_of(frames: Frames, place: FloatArray | None = None, progress: Progress | None = None) -> Matches:
    """Match the features of photographs.

    `place` (N, 2): where each was taken, about [m]; without it, many photographs are matched by their order alone.
    """
    features = []
    for index in range(len(frames)):
        features.append(detect_features(frames[index]))
        if progress is not None:
            progress("features", index + 1, len(frames))
    epipolar_px = epipolar_error_px(frames[0])
    candidates = list(_candidates(len(features), place))
    pairs = []
    for n, (first, second) in enumerate(candidates):
        found = match_features(features[first], features[second], epipolar_px)
        if len(found) >= _LEAST_MATCHES:
            pairs.append(MatchedPair(first, second, found))
        if progress is not None:
            progress("matches", n + 1, len(candidates))
    pixels = tuple(one.pixel for one in features)
    return Matches(tuple(pairs), pixels, _joined(pairs, pixels))


def _candidates(n: int, place: FloatArray | None) -> Iterator[tuple[int, int]]:
    """Yield the pairs of n photographs that are matched: all of few, else the nearest and the next."""
    if n <= _ALL_PAIRS:
        yield from ((first, second) for first in range(n) for second in range(first + 1, n))
        return
    chosen = {(first, first + k) for k in range(1, _N_NEXT + 1) for first in range(n - k)}
    if place is not None:
        nearest = np.asarray(cKDTree(place).query(place, _N_NEAREST + 1)[1])
        chosen |= {(min(a, b), max(a, b)) for a in range(n) for b in nearest[a].tolist() if a != b}
    yield from sorted(chosen)


def match_features(first: ImageFeatures, second: ImageFeatures, epipolar_px: float) -> IntArray:
    """Match the features of two photographs.

    `epipolar_px`: largest distance from an epipolar line [pixels]. Returns (M, 2): features of the first and the second that
    are each other's best match, clearly, and that one epipolar geometry explains; none where they are fewer than 25.
    """
    none = np.zeros((0, 2), dtype=np.int64)
    if min(len(first.pixel), len(second.pixel)) < _LEAST_MATCHES:
        return none
    alike = first.descriptor @ second.descriptor.T
    row, best, back = np.arange(len(alike)), alike.argmax(axis=1), alike.argmax(axis=0)
    top = alike[row, best]
    alike[row, best] = -1.0
    apart, next_apart = (np.sqrt(np.maximum(2.0 - 2.0 * cosine, 0.0)) for cosine in (top, alike.max(axis=1)))
    found = np.flatnonzero((back[best] == row) & (apart < _RATIO * next_apart))
    if len(found) < _LEAST_MATCHES:
        return none
    _, fits = cv2.findFundamentalMat(
        first.pixel[found], second.pixel[best[found]], cv2.USAC_MAGSAC, epipolar_px, _CONFIDENCE, _N_TRIALS
    )
    if fits is None:
        return none
    found = found[fits.ravel() > 0]
    return np.column_stack([found, best[found]])


def _joined(pairs: Sequence[MatchedPair], pixels: Sequence[FloatArray]) -> TrackPixels:
    """Return the tracks of matched features; a photograph that a track meets twice is left out of it."""
    offset = np.r_[0, np.cumsum([len(pixel) for pixel in pixels])]
    n = int(offset[-1])
    ends = [one.features + offset[[one.first, one.second]] for one in pairs]
    links = np.concatenate([np.zeros((0, 2), dtype=np.int64), *ends])
    graph = coo_array((np.ones(len(links)), links.T), shape=(n, n))
    track = connected_components(graph, directed=False)[1].astype(np.int64)
    image = np.repeat(np.arange(len(pixels)), np.diff(offset))
    place = track * len(pixels) + image
    _, where, times = np.unique(place, return_inverse=True, return_counts=True)
    once = np.flatnonzero(times[where] == 1)
    counts = np.bincount(track[once], minlength=int(track.max(initial=0)) + 1)
    kept = once[counts[track[once]] > 1]
    kept = kept[np.lexsort((image[kept], track[kept]))]
    return sorted_tracks(track[kept], image[kept], np.concatenate([np.zeros((0, 2)), *pixels])[kept])


def sorted_tracks(track: IntArray, image: IntArray, pixel: FloatArray) -> TrackPixels:
    """Return tracks of observations (N,) that are sorted by track and photograph."""
    first = np.flatnonzero(np.r_[True, np.diff(track) != 0]) if len(track) else np.zeros(0, dtype=np.int64)
    return TrackPixels(np.asarray(image, dtype=np.int64), pixel, np.r_[first, len(track)].astype(np.int64))
