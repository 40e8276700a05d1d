"""Meetings of two paths: pairs of poses near one another whose ground looks alike from above."""

from collections.abc import Iterable, Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from survey.core.arrays import FloatArray, IntArray
from vision_slam.places.ground_view import GroundMosaics
from vision_slam.places.overlay import Overlay, match_overlay

KEY_SPACING_M = 1.0
SIGMAS = 3.0
_REACH_M, _WIDEST_M = 1.5, 6.0
_MEETING_M = 4.0
_LEAST_AGREE = 25
_N_VIEWS = 64
# These, and the least number that agree, were chosen on drives over ground that is known.
_SIGMA_M, _SIGMA_PER_FEATURE_M = 0.02, 0.42
_UP_SIGMA_M, _UP_SIGMA_PER_FEATURE_M = 0.02, 0.15


class SeenPath(NamedTuple):
    """Path with the ground around it: mosaics, positions (N, 3) [m] and their horizontal standard deviation (N,) [m]."""

    mosaics: GroundMosaics
    position: FloatArray
    sigma_m: FloatArray


class Meeting(NamedTuple):
    """Two poses that saw the same ground, and how the second view lies on the first."""

    first: int
    second: int
    overlay: Overlay


def spaced_poses(travel_m: FloatArray) -> IntArray:
    """Return poses about a metre of travel apart, from the first that has ground behind it."""
    marks = np.arange(2.0, travel_m[-1], KEY_SPACING_M)
    return np.unique(np.searchsorted(travel_m, marks))


def reach_m(first_sigma_m: FloatArray, second_sigma_m: FloatArray) -> FloatArray:
    """Return the distance within which two poses may see the same ground [m]."""
    return np.minimum(_REACH_M + SIGMAS * np.hypot(first_sigma_m, second_sigma_m), _WIDEST_M)


def recognized(first: SeenPath, second: SeenPath, pairs: Iterable[tuple[int, int]]) -> Iterator[Meeting]:
    """Yield the pairs of poses whose ground looks alike, with a shift that the paths allow."""
    views = [lru_cache(_N_VIEWS)(path.mosaics.around) for path in (first, second)]
    around = views if first is not second else [views[0]] * 2
    for one, other in pairs:
        overlay = match_overlay(around[0](one), around[1](other))
        if overlay is None or overlay.n_agree < _LEAST_AGREE:
            continue
        expected = (second.position[other] - first.position[one])[:2]
        shift_m = (first.mosaics.level(one) @ overlay.shift)[:2]
        sigma_m = np.hypot(first.sigma_m[one], second.sigma_m[other])
        allowed = SIGMAS * sigma_m + 2.0 * overlay_variance(overlay)[0] ** 0.5
        if np.linalg.norm(shift_m - expected) < allowed:
            yield Meeting(one, other, overlay)


def best_of_meetings(
    found: Iterable[Meeting], first_travel_m: FloatArray, second_travel_m: FloatArray
) -> list[Meeting]:
    """Select the overlay with the most inliers of each meeting: its neighbours see the same ground."""
    best: list[Meeting] = []
    for pair in sorted(found, key=lambda pair: -pair.overlay.n_agree):
        apart = [
            max(
                abs(first_travel_m[pair.first] - first_travel_m[other.first]),
                abs(second_travel_m[pair.second] - second_travel_m[other.second]),
            )
            for other in best
        ]
        if not apart or min(apart) > _MEETING_M:
            best.append(pair)
    return best


def overlay_variance(overlay: Overlay) -> FloatArray:
    """Return the variance (3,) [m²] of the shift of an overlay, from the number of features that agree."""
    level = _SIGMA_M**2 + _SIGMA_PER_FEATURE_M**2 / overlay.n_agree
    return np.array([level, level, _UP_SIGMA_M**2 + _UP_SIGMA_PER_FEATURE_M**2 / overlay.n_agree])
