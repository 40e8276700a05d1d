"""Alignment of two top-down ground views by rotation and shift."""

from dataclasses import dataclass

import numpy as np

from survey.core.arrays import BoolArray, FloatArray
from vision_slam.places.ground_view import GroundView

_RATIO = 0.9
_AGREE_M = 0.10
_BASE_M = 0.6
_N_GUESSES = 1500
_LEAST_MATCHES = 12


@dataclass(frozen=True)
class Overlay:
    """Position and rotation of the second view in the level frame of the first.

    ``shift`` (3,) [m] and ``turn_rad`` counter-clockwise; ``n_agree`` of ``n_matches``
    features that fit, ``spread_m`` how far they reach (least standard deviation of their
    places), ``misfit_m`` the RMS distance left between them on one axis.
    """

    shift: FloatArray
    turn_rad: float
    n_agree: int
    n_matches: int
    spread_m: float
    misfit_m: float


def match_overlay(first: GroundView, second: GroundView) -> Overlay | None:
    """Align two views by rotation and shift; None where too few features match.

    Lengths are known, so that two matches give a guess: of all pairs of matches those as
    far apart in both views are tried, and the guess with the most inliers within 10 cm
    is taken. It is then fitted to them by least squares, the height by their median. How many
    agree is for the caller to judge: on ground that only seems the same up to a dozen do.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> xyz, looks = rng.uniform(-2.0, 2.0, (40, 3)), rng.random((40, 128), np.float32)
    >>> looks /= np.linalg.norm(looks, axis=1, keepdims=True)
    >>> overlay = match_overlay(GroundView(0, xyz, looks), GroundView(9, xyz - [0.5, 0.2, 0.1], looks))
    >>> overlay.shift.round(3).tolist(), overlay.n_agree
    ([0.5, 0.2, 0.1], 40)
    """
    one, other = _matched(first, second)
    if len(one) < _LEAST_MATCHES:
        return None
    agree = _largest_agreement(one[:, :2], other[:, :2])
    turn, shift = 0.0, np.zeros(2)
    for _ in range(5):
        if agree.sum() < _LEAST_MATCHES // 2:
            return None
        turn, shift = _fitted(one[agree, :2], other[agree, :2])
        agree = _distance(one[:, :2], other[:, :2], turn, shift) < _AGREE_M
    if agree.sum() < _LEAST_MATCHES // 2:
        return None
    off = _distance(one[agree, :2], other[agree, :2], turn, shift)
    places = one[agree, :2] - one[agree, :2].mean(axis=0)
    return Overlay(
        np.append(shift, np.median(one[agree, 2] - other[agree, 2])),
        turn,
        int(agree.sum()),
        len(one),
        float(np.sqrt(np.linalg.eigvalsh(places.T @ places / len(places))[0])),
        float(np.sqrt(0.5 * np.mean(off**2))),
    )


def _matched(first: GroundView, second: GroundView) -> tuple[FloatArray, FloatArray]:
    """Return the places (M, 3) in both views of features that look alike, and like no other."""
    if min(len(first.xyz), len(second.xyz)) < _LEAST_MATCHES:
        return np.zeros((0, 3)), np.zeros((0, 3))
    likeness = first.descriptors @ second.descriptors.T  # descriptors are of unit length
    best = likeness.argmax(axis=1)
    rows = np.arange(len(best))
    top = likeness[rows, best]
    likeness[rows, best] = -1.0
    runner_up = likeness.max(axis=1)
    # The ratio of distances, d² = 2 - 2 u·v.
    clear = (1.0 - top) < _RATIO**2 * (1.0 - runner_up)
    # Of several features that look like one, the likeliest.
    order = np.flatnonzero(clear)[np.argsort(-top[clear], kind="stable")]
    _, once = np.unique(best[order], return_index=True)
    chosen = order[np.sort(once)]
    return first.xyz[chosen], second.xyz[best[chosen]]


def _largest_agreement(one: FloatArray, other: FloatArray) -> BoolArray:
    """Return which matches agree with the best guess from a pair of them."""
    i, j = np.triu_indices(len(one), 1)
    here, there = one[j] - one[i], other[j] - other[i]
    length = np.hypot(*here.T)
    fits = (length > _BASE_M) & (np.abs(length - np.hypot(*there.T)) < _AGREE_M)
    tried = np.flatnonzero(fits)
    if len(tried) == 0:
        return np.zeros(len(one), dtype=bool)
    tried = tried[np.linspace(0, len(tried) - 1, min(_N_GUESSES, len(tried))).astype(int)]
    here, there = here[tried], there[tried]
    turn = np.arctan2(here[:, 1], here[:, 0]) - np.arctan2(there[:, 1], there[:, 0])
    # Complex numbers turn and shift all matches by all guesses at once.
    spin = np.exp(1j * turn)
    p, q = one[:, 0] + 1j * one[:, 1], other[:, 0] + 1j * other[:, 1]
    shift = 0.5 * (p[i[tried]] + p[j[tried]]) - spin * 0.5 * (q[i[tried]] + q[j[tried]])
    off = np.abs(p[None] - spin[:, None] * q[None] - shift[:, None])
    agree: BoolArray = off[(off < _AGREE_M).sum(axis=1).argmax()] < _AGREE_M
    return agree


def _fitted(one: FloatArray, other: FloatArray) -> tuple[float, FloatArray]:
    """Turn and shift (2,) that lay `other` on `one` by least squares."""
    p, q = one[:, 0] + 1j * one[:, 1], other[:, 0] + 1j * other[:, 1]
    turn = float(np.angle(((p - p.mean()) * (q - q.mean()).conj()).sum()))
    shift = p.mean() - np.exp(1j * turn) * q.mean()
    return turn, np.array([shift.real, shift.imag])


def _distance(one: FloatArray, other: FloatArray, turn: float, shift: FloatArray) -> FloatArray:
    cosine, sine = np.cos(turn), np.sin(turn)
    off = one - other @ np.array([[cosine, sine], [-sine, cosine]]) - shift
    distance: FloatArray = np.hypot(*off.T)
    return distance
