"""Observations of one quantity at points, their variances, and their outliers.

`Observations` are places, values and variances. `variance_through_slope` propagates horizontal errors to the height, to
first order. Outliers of a fit are found by leave-one-out z-scores, and get larger variances by Huber's weights. Blunders
are found among the points before any fit: heights that differ from those of all neighbours, feet among metres, and places
far away. Heights that contradict one another at one place are named, and count with their scatter.
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Self

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import chdtrc, ndtri

from survey.core import BoolArray, FloatArray, InputError, IntArray
from survey.core.lengths import FOOT_M
from survey.data import SurfacePoints
from survey.reconstruction.terrain_map import ELEVATION

Predict = Callable[[BoolArray, FloatArray], tuple[FloatArray, FloatArray]]
"""From the points used (N,) and places (M, 2) [m] to mean (M,) [m] and variance (M,) [m²] of the surface."""


@dataclass(frozen=True)
class Observations:
    """Places (N, 2) [m], what was measured there (N,), and its variance (N,)."""

    xy: FloatArray
    z: FloatArray
    variance: FloatArray

    @classmethod
    def of(cls, points: SurfacePoints, quantity: str = ELEVATION) -> Self:
        """Return the points' elevation, or another quantity that they carry."""
        if quantity == ELEVATION:
            return cls(points.xy, points.z, points.sigma_z**2)
        if quantity not in points.values:
            known = ", ".join(sorted(points.values)) or "none"
            raise InputError(f"the points carry no value {quantity!r}; they carry: {known}.")
        if quantity not in points.value_sigmas:
            raise InputError(
                f"the points state no standard deviation of {quantity}; state one above 0 for each point."
            )
        sigma = points.value_sigmas[quantity]
        if (sigma <= 0).any():
            raise InputError(
                f"{int((sigma <= 0).sum())} standard deviations of {quantity} are 0 or less; state their standard deviations."
            )
        return cls(points.xy, points.values[quantity], sigma**2)

    def __len__(self) -> int:
        return len(self.z)

    def merged(self) -> Self:
        """Average measurements of one and the same place by their weights 1/σ²; for a surface nothing is lost."""
        places, index = np.unique(self.xy, axis=0, return_inverse=True)
        if len(places) == len(self.xy):
            return self
        index = index.ravel()
        weight = np.bincount(index, 1.0 / self.variance)
        return type(self)(places, np.bincount(index, self.z / self.variance) / weight, 1.0 / weight)

    def on_one_line(self) -> bool:
        """Return whether all places lie on one line, or on one spot, to a millionth of their extent."""
        centred = self.xy - self.xy.mean(axis=0)
        extents = np.linalg.svd(centred, compute_uv=False)
        return len(self.xy) < 3 or bool(extents[1] <= 1e-6 * max(float(extents[0]), 1e-9))


def variance_through_slope(covariance: FloatArray, slope: FloatArray) -> FloatArray:
    r"""Return the variance of the height that full 3 × 3 covariances amount to on a slope.

    .. math::  \sigma_i^2 = a_i^T \Sigma_i a_i, \qquad
               a_i = (-\partial f / \partial x, -\partial f / \partial y, 1)

    A point measured off its place by (dx, dy, dz) lies dz − f_x dx − f_y dy above the
    surface, to first order (McHutchon and Rasmussen 2011, with the covariances between
    height and place retained, which Eq. 7 of the glacier paper drops).

    `covariance` (N, 3, 3): of easting, northing and elevation [m²]. `slope` (N, 2): derivatives of the
    surface to the east and to the north at the points [m/m]. Returns (N,): variance [m²]; never less than a
    millionth of the trace, since a covariance may be singular along a.

    First order: where the slope changes within the horizontal error, the variance is
    too small. Errors that neighbouring points share are not seen.

    >>> variance_through_slope(np.diag([0.25, 0.25, 0.01])[None], np.array([[0.2, 0.0]]))
    array([0.02])
    """
    a = np.column_stack([-slope, np.ones(len(slope))])
    through = np.einsum("ni,nij,nj->n", a, covariance, a)
    result: FloatArray = np.maximum(through, 1e-6 * np.trace(covariance, axis1=1, axis2=2))
    return result


# Smaller errors are named in no survey, however few points it has.
_SUSPECT_Z = 4.0
# Chance that a survey without a single outlier names one.
_FALSE_ALARM = 0.05
# Beyond it the variance of a point grows with its error, so that its pull on the surface does not.
_TRUSTED_Z = 2.5
# Rows in the record.
_N_NAMED = 20


@dataclass(frozen=True)
class Outliers:
    """Points whose leave-one-out z-score exceeds that of normal errors (`suspicious_z`), the worst first.

    `index` (K,) int: rows of the points as they were given. `z` (K,): error of the others' prediction in its
    standard deviations, with its sign. `treatment`: what was done about them.
    """

    index: IntArray
    z: FloatArray
    treatment: str = "retained"

    @classmethod
    def among(cls, z_scores: FloatArray, rows: IntArray, treatment: str = "retained") -> Self:
        """Return the suspicious points by the z-scores (N,) of the points in these rows."""
        worst = np.argsort(-np.abs(z_scores), kind="stable")
        worst = worst[np.abs(z_scores[worst]) > suspicious_z(len(z_scores))]
        return cls(rows[worst], z_scores[worst], treatment)

    def facts(self) -> dict[str, Any]:
        """Return their number and the worst twenty, for the record."""
        return {
            "n": len(self.index),
            "rows": self.index[:_N_NAMED],
            "z_scores": np.round(self.z[:_N_NAMED], 2),
            "treatment": self.treatment,
        }


def suspicious_z(n: int) -> float:
    """Return how many standard deviations make a point suspicious: 4, or more where n normal errors reach 4 by chance.

    >>> [suspicious_z(100), round(suspicious_z(1_000_000), 2)]
    [4.0, 5.45]
    """
    return max(_SUSPECT_Z, -float(ndtri(0.5 * _FALSE_ALARM / n)))


def distrusted(variance: FloatArray, z_scores: FloatArray) -> FloatArray:
    """Return noise variances (N,) that grow with what lies beyond 2.5 standard deviations (Huber's weights).

    >>> distrusted(np.ones(3), np.array([0.0, -2.5, 25.0]))
    array([ 1.,  1., 10.])
    """
    return variance * np.maximum(1.0, np.abs(z_scores) / _TRUSTED_Z)


# Fewer points do not show what is usual among them.
LEAST_TESTED = 30
# Clouds of more points are not tested: the neighbours of a million take 5 s and 0.8 GB.
MOST_TESTED = 300_000
_N_NEIGHBOURS, _N_WIDER = 12, 24
# A blunder differs from its neighbours by so many times what is usual, there and in the whole survey, and by so much of the
# relief of all points.
_TIMES_USUAL, _USUAL_SHARE, _SHARE_OF_RELIEF = 5.0, 0.75, 0.5
# What is lower could be a boulder [m].
_LEAST_M = 5.0
# More of them are no blunders.
_MOST_SHARE = 0.02
# A place is far where it lies so many extents of all others away.
_FAR_EXTENTS = 50.0
_FEET_TOLERANCE = 0.02


class Blunders(NamedTuple):
    """Points whose height is a blunder: rows (K,), places (K, 2) [m], and heights above their neighbours (K,) [m]."""

    rows: IntArray
    xy: FloatArray
    above_m: FloatArray

    @classmethod
    def among(cls, xyz: FloatArray, sigma_z: FloatArray | float, least_m: float | None = None) -> Self:
        """Return the blunders among points, the largest first.

        Each stands alone: the points around it agree with one another, and it differs from all of them but one by more
        than half of the relief of the survey, or than `least_m`. At a cliff, a tree or a building several points have the
        same height.
        """
        xy, z = xyz[:, :2], xyz[:, 2]
        wider = _neighbours(xy)
        around = wider[:, :_N_NEIGHBOURS]
        above_m = z - np.median(z[around], axis=1)
        size = np.abs(above_m)
        alike_m = np.sort(np.abs(z[:, None] - z[wider]), axis=1)[:, 1]
        of_relief_m = least_blunder_m(z) if least_m is None else least_m
        rows = np.flatnonzero(np.minimum(size, alike_m) > _least_m(around, size, sigma_z, of_relief_m))
        if len(rows) > _n_most(len(z)):
            rows = rows[:0]
        rows = rows[np.argsort(-size[rows], kind="stable")]
        return cls(rows, xy[rows], above_m[rows])

    def facts(self) -> dict[str, Any]:
        """Return their number, and rows, places and sizes of the largest twenty, for the record."""
        return {
            "n": len(self.rows),
            "rows": self.rows[:_N_NAMED],
            "x_m": self.xy[:_N_NAMED, 0],
            "y_m": self.xy[:_N_NAMED, 1],
            "above_neighbours_m": np.round(self.above_m[:_N_NAMED], 2),
        }

    def sentence(self, *, by_row: bool = True) -> str:
        """State how many there are, and which is the largest, by its row where it has one."""
        side = "above" if self.above_m[0] > 0.0 else "below"
        which = f"{len(self.rows)} points stand alone in height and count as blunders: the largest is"
        if len(self.rows) == 1:
            which = "1 point stands alone in height and counts as a blunder: it is"
        point = f" point {self.rows[0] + 1}," if by_row else ""
        return (
            f"{which}{point} at {self.xy[0, 0]:.2f}, {self.xy[0, 1]:.2f}, {abs(self.above_m[0]):.2f} m {side} its "
            "neighbours; correct or remove what is wrong in the file"
        )


NO_BLUNDERS = Blunders(np.zeros(0, dtype=np.int64), np.zeros((0, 2)), np.zeros(0))


def without_blunders(points: SurfacePoints) -> tuple[SurfacePoints, Blunders]:
    """Return points without those whose height is a blunder, and the blunders.

    >>> x, y = np.meshgrid(np.arange(10.0), np.arange(10.0))
    >>> z = 0.1 * x
    >>> z[4, 6] += 50.0
    >>> points = SurfacePoints(np.stack([x, y, z], axis=-1).reshape(-1, 3), sigma_m=0.1, crs="EPSG:32608")
    >>> kept, blunders = without_blunders(points)
    >>> len(kept), blunders.rows, blunders.above_m.round()
    (99, array([46]), array([50.]))
    """
    if not LEAST_TESTED <= len(points) <= MOST_TESTED:
        return points, NO_BLUNDERS
    found = Blunders.among(points.xyz, points.sigma_z)
    if not len(found.rows):
        return points, found
    kept = np.ones(len(points), dtype=bool)
    kept[found.rows] = False
    return points.select(kept), found


def _neighbours(xy: FloatArray) -> IntArray:
    """Return the nearest other points (N, 24) of each."""
    index = np.asarray(cKDTree(xy).query(xy, k=_N_WIDER + 1)[1])
    return index[:, 1:].astype(np.int64)


def least_blunder_m(z: FloatArray) -> float:
    """Return the least size of a blunder by the relief of all points: half of it, and at least 5 m."""
    n_most = _n_most(len(z))
    low, high = np.sort(z)[[n_most, -1 - n_most]]
    return max(_SHARE_OF_RELIEF * float(high - low), _LEAST_M)


def _least_m(
    around: IntArray, size_m: FloatArray, sigma_z: FloatArray | float, of_relief_m: float
) -> FloatArray:
    """Return the least size of a blunder at each point (N,), from the differences (N,) of all and the points around (N, 12)."""
    there = np.quantile(size_m[around], _USUAL_SHARE, axis=1)
    usual_m = np.maximum(there, np.quantile(size_m, 1.0 - 2.0 * _MOST_SHARE))
    least: FloatArray = np.maximum(_TIMES_USUAL * np.maximum(usual_m, sigma_z), of_relief_m)
    return least


def _n_most(n: int) -> int:
    """Return how many of n points may be blunders."""
    return max(int(_MOST_SHARE * n), 1)


# Places are one where their coordinates agree to this [m]; coordinates in whole centimetres may hide so much of a slope.
_ONE_PLACE_M, _ROUNDED_M = 1e-4, 1e-2
# Chance that heights that agree within their errors are named.
_FALSE_CONTRADICTION = 0.01


class Contradictions(NamedTuple):
    """Places that hold heights which differ by more than their errors, in the order of the points.

    `group` (N,): number of the place of each point, -1 for all others. `xy` (K, 2) [m], `n` (K,), `low`, `high` (K,) [m]:
    places, and number and range of their heights. `scatter_m` (K,): standard deviation of these. `sigma_m`: that the first
    place states.
    """

    group: IntArray
    xy: FloatArray
    n: IntArray
    low: FloatArray
    high: FloatArray
    scatter_m: FloatArray
    sigma_m: float

    @classmethod
    def among(cls, xy: FloatArray, z: FloatArray, variance: FloatArray) -> Self | None:
        """Return the contradictions among heights (N,) with variances (N,) at places (N, 2), None where there are none.

        A place counts where the sum of its squared normalised differences is too large by itself, or where the sum over all
        places is too large and its own is larger than expected.
        """
        keys = np.round(xy / _ONE_PLACE_M)
        _, group, n = np.unique(keys[:, 0] + 1j * keys[:, 1], return_inverse=True, return_counts=True)
        group = group.ravel()
        if (n < 2).all():
            return None
        # Whole metres are a lattice rather than rounded.
        rounded = bool(np.allclose(xy, np.round(xy, 2), rtol=0.0, atol=_ONE_PLACE_M))
        weight = 1.0 / (variance + (_ROUNDED_M**2 if rounded and not (xy == np.round(xy)).all() else 0.0))
        mean = np.bincount(group, weight * z) / np.bincount(group, weight)
        excess = np.bincount(group, weight * (z - mean[group]) ** 2)
        repeated = n > 1
        alone = chdtrc(np.maximum(n - 1, 1), excess) < _FALSE_CONTRADICTION / repeated.sum()
        together = chdtrc((n - 1).sum(), excess[repeated].sum()) < _FALSE_CONTRADICTION
        found = repeated & (alone | (together & (excess > n - 1)))
        return cls._of(found, group, xy, z, variance) if found.any() else None

    @classmethod
    def _of(
        cls, found: BoolArray, group: IntArray, xy: FloatArray, z: FloatArray, variance: FloatArray
    ) -> Self:
        """Return the facts of the places (K,) that were found among the groups, by the first point of each."""
        first = np.full(len(found), len(z))
        np.minimum.at(first, group, np.arange(len(z)))
        chosen = np.flatnonzero(found)
        chosen = chosen[np.argsort(first[chosen], kind="stable")]
        number = np.full(len(found), -1)
        number[chosen] = np.arange(len(chosen))
        at = number[group]
        heights = _split(z, at, len(chosen))
        low, high, scatter = (np.array([f(h) for h in heights]) for f in (np.min, np.max, _scatter))
        n = np.array([len(h) for h in heights])
        return cls(at, xy[first[chosen]], n, low, high, scatter, float(np.sqrt(variance[first[chosen[0]]])))

    def raised(self, variance: FloatArray) -> FloatArray:
        """Return variances (N,) with which the mean of the heights of a place has at least their scatter."""
        is_in = self.group >= 0
        place = self.group[is_in]
        result = variance.copy()
        result[is_in] = np.maximum(result[is_in], self.n[place] * self.scatter_m[place] ** 2)
        return result

    def floor(self, xy: FloatArray, reach_m: float) -> FloatArray:
        """Return the scatter of the nearest place within reach of each node (M,); 0 beyond."""
        away, nearest = cKDTree(self.xy).query(xy, distance_upper_bound=reach_m)
        near = np.isfinite(away)
        return np.where(near, self.scatter_m[np.where(near, nearest, 0)], 0.0)

    def facts(self) -> dict[str, Any]:
        """Return their number, the first twenty, and the sentence, for the record."""
        shown = slice(_N_NAMED)
        return {
            "n": len(self.n), "x_m": self.xy[shown, 0], "y_m": self.xy[shown, 1],
            "scatter_m": np.round(self.scatter_m[shown], 3), "sentence": self.sentence(),
        }  # fmt: skip

    def sentence(self) -> str:
        """State how many places there are, and the first with its heights and their scatter."""
        stated = f", and errors of {self.sigma_m:.3g} m (1 σ) are stated" if self.sigma_m > 0.0 else ""
        places = (
            "1 place holds heights that contradict"
            if len(self.n) == 1
            else f"{len(self.n)} places hold heights that contradict"
        )
        return (
            f"{places} one another: the first, at {self.xy[0, 0]:.2f}, {self.xy[0, 1]:.2f}, holds {self.n[0]} between {self.low[0]:.2f} and "
            f"{self.high[0]:.2f} m, a scatter of {self.scatter_m[0]:.2f} m{stated}; the map's standard deviation there is not below the "
            "scatter, remove the wrong ones from the file"
        )


def _scatter(z: FloatArray) -> float:
    return float(np.std(z, ddof=1))


def _split(z: FloatArray, at: IntArray, n: int) -> list[FloatArray]:
    """Return the heights of each of n places; those of none, numbered -1, come first and are left out."""
    order = np.argsort(at, kind="stable")
    return np.split(z[order], np.searchsorted(at[order], np.arange(n)))[1:]


def with_scatter(
    points: SurfacePoints, quantity: str = ELEVATION
) -> tuple[SurfacePoints, Contradictions | None]:
    """Return points whose errors at places of contradicting heights allow for their scatter, and these places; the log names them.

    >>> points = SurfacePoints([[0, 0, 5.0], [0, 0, 7.0], [9, 0, 5.0]], sigma_m=0.1, crs="EPSG:32608")
    >>> raised, found = with_scatter(points)
    >>> found.scatter_m.round(3), raised.sigma_z.round(3)
    (array([1.414]), array([2. , 2. , 0.1]))
    """
    if quantity != ELEVATION:
        return points, None
    variance = points.sigma_z**2
    found = Contradictions.among(points.xy, points.z, variance)
    if found is None:
        return points, None
    logging.getLogger(__name__).warning("%s.", found.sentence())
    added = found.raised(variance) - variance
    if points.covariance is None:
        return replace(points, sigma_m=np.sqrt(variance + added)), found
    extra = np.zeros((len(points), 3, 3))
    extra[:, 2, 2] = added
    own = None if points.own_covariance is None else points.own_covariance + extra
    return replace(points, covariance=points.covariance + extra, own_covariance=own), found


class SoundPoints(NamedTuple):
    """Points without blunders, and the record of those that were left out."""

    points: SurfacePoints
    blunders: tuple[dict[str, Any], ...] = ()


def sound_points(
    points: SurfacePoints, quantity: str = ELEVATION, *, has_area: bool = False, file: str | None = None
) -> SoundPoints:
    """Leave gross blunders of the heights out; refuse feet among metres, and far places where no area is given."""
    try:
        if not has_area:
            refuse_far_places(points)
        if quantity != ELEVATION:
            return SoundPoints(points)
        refuse_feet_among_metres(points)
    except InputError as error:
        raise error if file is None else InputError(f"{file}: {error}") from error
    kept, found = without_blunders(points)
    named = {} if file is None else {"file": file}
    record = {**named, "sentence": found.sentence(), **found.facts()} if len(found.rows) else None
    return SoundPoints(kept, () if record is None else (record,))


def refuse_feet_among_metres(points: SurfacePoints) -> None:
    """Refuse heights of two groups of which one is 3.28 times as high as the other."""
    height = np.sort(points.z)
    if len(height) < LEAST_TESTED or height[0] <= 0.0:
        return
    last = int(np.argmax(np.diff(height)))
    low, high = height[: last + 1], height[last + 1 :]
    is_apart = high[0] - low[-1] > max(np.ptp(low), np.ptp(high))
    ratio = float(np.median(high) / np.median(low)) * FOOT_M
    if is_apart and abs(ratio - 1.0) < _FEET_TOLERANCE:
        first = int(np.flatnonzero(points.z >= high[0])[0])
        raise InputError(
            f"{len(high)} of {len(height)} heights lie between {high[0]:g} and {high[-1]:g} and all others between {low[0]:g} and "
            f"{low[-1]:g} m, 3.28 times lower: those are in feet, the first at point {first + 1}; convert them to metres."
        )


def refuse_far_places(points: SurfacePoints) -> None:
    """Refuse few places that lie far from all others, as one with exchanged or missing coordinates does."""
    if len(points) < LEAST_TESTED:
        return
    low, middle, high = np.quantile(points.xy, [_MOST_SHARE, 0.5, 1.0 - _MOST_SHARE], axis=0)
    away = np.abs(points.xy - middle).max(axis=1)
    is_far = away > _FAR_EXTENTS * max(float((high - low).max()), 1.0)
    if not is_far.any() or is_far.sum() > _MOST_SHARE * len(points):
        return
    worst = int(np.argmax(away))
    (west, south), (east, north) = points.xy[~is_far].min(axis=0), points.xy[~is_far].max(axis=0)
    raise InputError(
        f"{int(is_far.sum())} of {len(points)} points {'lies' if is_far.sum() == 1 else 'lie'} far from all others: point {worst + 1} at "
        f"{points.xy[worst, 0]:.2f}, {points.xy[worst, 1]:.2f}, while the others reach from {west:.2f}, {south:.2f} to {east:.2f}, "
        f"{north:.2f}; correct or remove it, or name the ground with --area."
    )
