r"""Agreement of heights from images with the returns of a scanner where both see the same ground.

`ScanStrip.between` pairs heights with the returns about them. On one half of the strip, in blocks, `HeightErrors.learned` fits the error of
heights,

.. math:: \sigma^2 = (k \sigma_{own})^2 + a^2 + (b r)^2 + \sigma_{scan}^2

with the range r, by the likelihood of Student's t with four degrees of freedom, so that single wrong matches do not widen it. Its
coverage is measured on the other half.

`contradictions` are places where the two differ by more than four standard deviations, with a reason that the images themselves show.
"""

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import minimize
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.stats import t as student

from survey.core import BoolArray, FloatArray, IntArray
from survey.data import SurfacePoints
from survey.reconstruction.line_of_sight.scan_points import RegisteredReturns

_NEAR_M, _LEAST_RETURNS = 0.75, 6
_BLOCK_M = 5.0
_DEGREES = 4.0
_LEAST_PAIRS = 20
_ASSUMED = (
    2.5,
    0.05,
    0.003,
)  # factor, floor [m] and part of the range, where the strip is too small to learn from
_FREE = np.array([0.5, 1.0, 1.0])  # standard deviations of their logarithms about these
_MOST_SIGMAS, _ALSO_SIGMAS = 4.0, 2.0  # of a contradiction, and of heights beside it that belong to it
_SAME_PLACE_M = 2.5
_LEAST_OF_CHANGE, _LEAST_VIEWS_OF_CHANGE, _CHANGE_SIGMAS = 4, 2, 2.5
_POSE_SIGMAS, _LEAST_OF_POSE = 2.5, 6
_DARK, _RIVAL = 0.75, 0.85

MOVED = "ground moved between images and scans"
POSE = "pose error of the image"
SHADOW = "shadow"
REPEATED = "match on repeated texture"
UNCONFIRMED = "match that other images do not confirm"


@dataclass(frozen=True)
class ScanStrip:
    """Heights from images where scans see the ground too.

    `which` (N,): numbers of the heights. `difference_m` (N,): height of the image minus height of the returns about it. `scan_sigma_m` (N,): standard
    deviation of the latter. `time_s` (N,): mean time of the returns.
    """

    which: IntArray
    difference_m: FloatArray
    scan_sigma_m: FloatArray
    time_s: FloatArray

    @classmethod
    def between(cls, heights: SurfacePoints, returns: RegisteredReturns) -> "ScanStrip":
        """Pair heights with the plane through the returns within 0.75 m."""
        neighbours: Any = cKDTree(returns.xyz[:, :2]).query_ball_point(heights.xyz[:, :2], _NEAR_M)
        found: list[tuple[int, float, float, float]] = []
        for index, near in enumerate(neighbours):
            if len(near) < _LEAST_RETURNS:
                continue
            height, sigma = _plane_at(returns.xyz[near] - heights.xyz[index])
            found.append((index, -height, sigma, float(returns.time_s[near].mean())))
        table = np.array(found).reshape(-1, 4)
        return cls(table[:, 0].astype(np.int64), table[:, 1], table[:, 2], table[:, 3])

    def __len__(self) -> int:
        return len(self.which)


def _plane_at(offset: FloatArray) -> tuple[float, float]:
    """Return the height at the origin of the plane through returns (N, 3), without odd ones, and its standard deviation [m]."""
    is_used = np.ones(len(offset), dtype=np.bool_)
    for _ in range(3):
        near = offset[is_used]
        # A weak prior on the slopes holds planes through returns on one line.
        design = np.vstack([np.column_stack([np.ones(len(near)), near[:, :2]]), 0.3 * np.eye(3)[1:]])
        found = np.linalg.lstsq(design, np.r_[near[:, 2], 0.0, 0.0], rcond=None)[0]
        residual = offset[:, 2] - found[0] - offset[:, :2] @ found[1:]
        spread = 1.4826 * float(np.median(np.abs(residual))) + 0.01
        is_used = np.abs(residual) <= 3.0 * spread
    return float(found[0]), spread / np.sqrt(max(int(is_used.sum()), 1)) + 0.01


@dataclass(frozen=True)
class HeightErrors:
    """Error of heights from images.

    `factor`: on the standard deviation by the correlation. `floor_m`: part that does not depend on the range [m]. `per_metre`: part that grows with it. `n_learned`, `n_tested`: heights of the two halves of
    the strip. `coverage`: share of the tested ones within their 95 % interval; NaN without any.
    """

    factor: float
    floor_m: float
    per_metre: float
    n_learned: int
    n_tested: int
    coverage: float

    @classmethod
    def learned(cls, heights: SurfacePoints, strip: ScanStrip) -> "HeightErrors":
        """Learn the errors on one half of the strip and test them on the other; assumed ones where it holds fewer than 20 heights."""
        seen = _at(heights, strip.which) if len(strip) else None
        if seen is None or len(strip) < 2 * _LEAST_PAIRS:
            return cls(*_ASSUMED, 0, 0, float("nan"))
        block = np.floor(seen.xyz[:, :2] / _BLOCK_M).sum(axis=1) % 2 == 0
        found = _fitted(seen, strip, block)
        if min(block.sum(), (~block).sum()) < _LEAST_PAIRS:
            return cls(
                *_fitted(seen, strip, np.ones(len(strip), dtype=np.bool_)), len(strip), 0, float("nan")
            )
        sigma = np.hypot(_height_sigma(seen, *found), strip.scan_sigma_m)
        inside = np.abs(strip.difference_m) <= 1.96 * sigma
        return cls(*found, int(block.sum()), int((~block).sum()), float(inside[~block].mean()))

    def of(self, heights: SurfacePoints) -> FloatArray:
        """Return the standard deviations (N,) of heights [m]."""
        return _height_sigma(heights, self.factor, self.floor_m, self.per_metre)

    def added_to(self, heights: SurfacePoints) -> SurfacePoints:
        """Return heights whose own covariance holds these errors."""
        extra = np.zeros((len(heights), 3, 3))
        extra[:, 2, 2] = np.maximum(self.of(heights) ** 2 - _own_sigma(heights) ** 2, 0.0)
        assert heights.covariance is not None
        own = None if heights.own_covariance is None else heights.own_covariance + extra
        return replace(heights, covariance=heights.covariance + extra, own_covariance=own)


def _at(heights: SurfacePoints, numbers: IntArray) -> SurfacePoints:
    """Return the heights of ascending numbers."""
    return heights.select(np.isin(np.arange(len(heights)), numbers))


def _range_of(heights: SurfacePoints) -> FloatArray:
    assert heights.range_m is not None
    return heights.range_m


def _own_sigma(heights: SurfacePoints) -> FloatArray:
    own = heights.covariance if heights.own_covariance is None else heights.own_covariance
    assert own is not None
    return np.sqrt(own[:, 2, 2])


def _height_sigma(heights: SurfacePoints, factor: float, floor_m: float, per_metre: float) -> FloatArray:
    """Return the standard deviations (N,) of heights [m]."""
    square = (factor * _own_sigma(heights)) ** 2 + floor_m**2 + (per_metre * _range_of(heights)) ** 2
    return np.asarray(np.sqrt(square), dtype=np.float64)


def _fitted(seen: SurfacePoints, strip: ScanStrip, which: BoolArray) -> tuple[float, float, float]:
    """Return factor, floor and growth of the errors with the greatest likelihood, under priors about usual ones."""
    usual, differences = np.log(_ASSUMED), strip.difference_m[which]

    def loss(log: FloatArray) -> float:
        sigma = np.hypot(_height_sigma(seen, *np.exp(log)), strip.scan_sigma_m)[which]
        scale = sigma * np.sqrt((_DEGREES - 2.0) / _DEGREES)
        likelihood = float((student.logpdf(differences / scale, _DEGREES) - np.log(scale)).sum())
        return 0.5 * float((((log - usual) / _FREE) ** 2).sum()) - likelihood

    factor, floor_m, per_metre = np.exp(minimize(loss, usual, method="Nelder-Mead").x).tolist()
    return factor, floor_m, per_metre


class Contradiction(NamedTuple):
    """Place where images contradict scans.

    `xy` (2,): its middle [m]. `difference_m`: median height of the images minus that of the scans. `sigmas`: the same in standard deviations. `n_heights`,
    `n_images`: heights that contradict, and images that they are from. `images_s`, `scans_s`: times of both. `reason`: in words.
    """

    xy: tuple[float, float]
    difference_m: float
    sigmas: float
    n_heights: int
    n_images: int
    images_s: tuple[float, float]
    scans_s: float
    reason: str


def contradictions(
    heights: SurfacePoints, strip: ScanStrip, errors: HeightErrors
) -> tuple[list[Contradiction], BoolArray]:
    """Return the places where heights contradict the scans, and which heights (N,) do.

    The reason is that all heights of an image deviate to one side (its pose), that several images agree on another surface (the ground
    moved), that the patch is dark (a shadow, which moves with the sun), or that another distance correlates nearly as well (texture that repeats).
    """
    is_wrong = np.zeros(len(heights), dtype=np.bool_)
    if not len(strip):
        return [], is_wrong
    seen = _at(heights, strip.which)
    ratio = strip.difference_m / np.hypot(errors.of(seen), strip.scan_sigma_m)
    image = seen.values["image"]
    bad_poses = _bad_poses(image, ratio)
    found = []
    for here in _places(seen.xyz[:, :2], ratio):
        is_wrong[strip.which[here]] = True
        taken = seen.values["time_s"][here]
        found.append(
            Contradiction(
                tuple(np.median(seen.xyz[here, :2], axis=0).tolist()),
                float(np.median(strip.difference_m[here])),
                float(np.median(ratio[here])),
                len(here),
                int(np.unique(image[here]).size),
                (float(taken.min()), float(taken.max())),
                float(np.median(strip.time_s[here])),
                _reason(_at(seen, here), ratio[here], bad_poses),
            )
        )
    return sorted(found, key=lambda one: -abs(one.sigmas) * np.sqrt(one.n_heights)), is_wrong


def _bad_poses(image: FloatArray, ratio: FloatArray) -> set[float]:
    """Return the images most of whose heights deviate to one side."""
    numbers, counts = np.unique(image, return_counts=True)
    enough = numbers[counts >= _LEAST_OF_POSE]
    return {float(one) for one in enough if abs(np.median(ratio[image == one])) > _POSE_SIGMAS}


def _places(xy: FloatArray, ratio: FloatArray) -> list[IntArray]:
    """Return the numbers of the heights of each place: one of more than four standard deviations, and neighbours to the same side."""
    odd = np.flatnonzero(np.abs(ratio) > _ALSO_SIGMAS)
    if not len(odd):
        return []
    pairs = cKDTree(xy[odd]).query_pairs(_SAME_PLACE_M, output_type="ndarray")
    pairs = pairs[np.sign(ratio[odd[pairs[:, 0]]]) == np.sign(ratio[odd[pairs[:, 1]]])]
    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(odd), len(odd)))
    group = connected_components(links, directed=False)[1]
    places = [odd[group == number] for number in range(int(group.max()) + 1)]
    return [place for place in places if np.abs(ratio[place]).max() > _MOST_SIGMAS]


def _reason(here: SurfacePoints, ratio: FloatArray, bad_poses: set[float]) -> str:
    """Return why the heights of one place contradict the scans."""
    images = here.values["image"]
    if np.mean([float(one) in bad_poses for one in images]) > 0.5:
        return POSE
    if np.median(here.values["brightness"]) < _DARK:
        return SHADOW
    is_clear = abs(float(np.median(ratio))) >= _CHANGE_SIGMAS
    if is_clear and len(here) >= _LEAST_OF_CHANGE and len(np.unique(images)) >= _LEAST_VIEWS_OF_CHANGE:
        return MOVED
    return REPEATED if np.median(here.values["rival"]) > _RIVAL else UNCONFIRMED
