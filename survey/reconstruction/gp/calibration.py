"""Calibration of the standard deviation by blocked cross-validation."""

from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.spatial import cKDTree
from scipy.special import chdtrc

from survey.core.arrays import BoolArray, FloatArray
from survey.core.streams import stream
from survey.reconstruction.base import CHECK
from survey.reconstruction.checks.predictive import PredictiveCheck, PredictiveScores
from survey.reconstruction.observations import Predict

_SHARE_IN_DISCS, _SHARE_IN_ONE, _SHARE_SINGLE = 0.12, 0.05, 0.04
# Without enough points to say otherwise the scale is 1, give or take 30 %.
_PRIOR_LOG_SD = 0.3
_N_BINS = 3
_N_LEAST = 30
_N_TRIED = 6000


@dataclass(frozen=True)
class SigmaCalibration:
    """Factor on the standard deviation, by the distance to the nearest point.

    Parameters
    ----------
    distance_m : (K,) ndarray
        Distances to the nearest point, ascending [m].
    scale : (K,) ndarray
        Factor at each; constant beyond the ends, linear between.
    held_out : mapping
        What the points that were left out had to say: their number, their share within
        the 95 % interval before and after.
    """

    distance_m: FloatArray
    scale: FloatArray
    held_out: dict[str, Any]

    @classmethod
    def none(cls) -> Self:
        """Return the scale 1."""
        return cls(np.zeros(1), np.ones(1), {})

    def facts(self) -> dict[str, Any]:
        """Return the scale and what it rests on, for the record."""
        held_out = {name: value for name, value in self.held_out.items() if name != CHECK}
        return {"distance_m": self.distance_m, "scale": self.scale, **held_out}

    def at(self, distance_m: FloatArray) -> FloatArray:
        """Return the factor at distances (M,) [m]."""
        return np.interp(distance_m, self.distance_m, self.scale)

    @classmethod
    def cross_validated(
        cls, xy: FloatArray, values: FloatArray, noise_m2: FloatArray, predict: Predict, gaps_m: FloatArray
    ) -> Self:
        r"""Leave out discs of points and single points, predict them, and compare.

        Points of one swath determine one another, so leaving out one at a time shows nothing
        about the ground between swaths: discs as wide as the gaps of the survey do. Within
        each range of distance to the nearest remaining point the scale s maximises

        .. math::  \sum_i w \log N(e_i; 0, s^2 v_i + \sigma_i^2) - \frac{(\log s)^2}{2 \cdot 0.3^2}

        with the prediction error e, its variance v and the point's own variance σ². The
        weight w counts errors that lie closer together than they are far from data as one.

        Parameters
        ----------
        xy, values, noise_m2 : (N, 2), (N,) and (N,) ndarray
            The points, and the variances of their errors.
        predict : callable
            Maps from some of the points.
        gaps_m : (M,) ndarray
            Distances from places on the map to the nearest point [m].

        Notes
        -----
        The scale never falls below 1: points stand where the rover could see, so that they
        can prove a map too bold and not too cautious. The hyperparameters were fitted to
        all points, and the test is not blind to them. Ground unlike any that was measured
        cannot be foreseen.
        """
        out = left_out(xy, gaps_m)
        kept = ~out.points
        if (~kept).sum() < _N_LEAST or kept.sum() < _N_LEAST:
            return cls.none()
        mean, variance = predict(kept, xy[~kept])
        distance = np.asarray(cKDTree(xy[kept]).query(xy[~kept])[0])
        held_out = _HeldOut(xy[~kept], values[~kept] - mean, variance, noise_m2[~kept], distance)
        bins = held_out.bins()
        found = cls(np.array([b.distance_m for b in bins]), np.array([b.scale for b in bins]), {})
        before, after = (held_out.scores(factor) for factor in (np.ones(len(distance)), found.at(distance)))
        columns = list(zip(*bins, strict=True))
        check = PredictiveCheck("discs and single points", out.n_discs, before, after, *columns)
        facts = {
            "n_held_out": before.n,
            "coverage_95_before": before.coverage_95,
            "coverage_95_after": after.coverage_95,
            CHECK: check.facts(),
        }
        return cls(found.distance_m, found.scale, facts)


class _Bin(NamedTuple):
    """Median distance [m] of a range, independent errors in it, chance of errors as large, and scale found."""

    distance_m: float
    n_effective: float
    p_value: float
    scale: float


class _HeldOut(NamedTuple):
    """Places (M, 2), errors (M,), variances of prediction and point (M,), and distances to the nearest point (M,)."""

    xy: FloatArray
    error: FloatArray
    variance: FloatArray
    noise: FloatArray
    distance_m: FloatArray

    def scores(self, factor: FloatArray) -> PredictiveScores:
        """Return the scores with the predicted deviation times a factor (M,)."""
        return PredictiveScores.of(self.error, np.sqrt(factor**2 * self.variance + self.noise))

    def bins(self) -> list[_Bin]:
        """Return what each third of the distances says."""
        edges = np.quantile(self.distance_m, np.linspace(0.0, 1.0, _N_BINS + 1))
        index = np.clip(np.searchsorted(edges, self.distance_m, side="right") - 1, 0, _N_BINS - 1)
        return [self._bin(index == k) for k in range(_N_BINS) if (index == k).any()]

    def _bin(self, here: BoolArray) -> _Bin:
        middle = float(np.median(self.distance_m[here]))
        error, variance, noise = self.error[here], self.variance[here], self.noise[here]
        n = _n_independent(self.xy[here], middle)
        scale = max(1.0, _scale(error, variance, noise, n / here.sum()))
        p_value = float(chdtrc(n, n * float(np.mean(error**2 / (variance + noise)))))
        return _Bin(middle, float(n), p_value, scale)


class PointsLeftOut(NamedTuple):
    """Points to leave out (N,), and the number of discs among them."""

    points: BoolArray
    n_discs: int


def left_out(xy: FloatArray, gaps_m: FloatArray) -> PointsLeftOut:
    """Choose points to leave out: discs as wide as the survey's gaps, and single points; always the same ones."""
    rng = stream(0, "calibration")
    tree = cKDTree(xy)
    out = np.zeros(len(xy), dtype=bool)
    order = rng.permutation(len(xy))
    # As wide as the gaps, unless a disc would then hold much of the survey.
    fullest = tree.query(xy[order[:30]], k=[max(int(_SHARE_IN_ONE * len(xy)), 1)])[0]
    widest = min(float(np.quantile(gaps_m, 0.95)), float(np.median(fullest)))
    radii = widest * np.array([1.0, 0.6, 0.3])
    n_discs = 0
    for centre in order[:_N_TRIED]:
        if out.sum() >= _SHARE_IN_DISCS * len(xy):
            break
        radius = radii[n_discs % len(radii)]
        # Discs stay a radius apart, so that each has its surroundings left.
        if not out[tree.query_ball_point(xy[centre], 2.0 * radius)].any():
            out[tree.query_ball_point(xy[centre], radius)] = True
            n_discs += 1
    free = np.flatnonzero(~out)
    out[rng.choice(free, size=int(_SHARE_SINGLE * len(free)), replace=False)] = True
    return PointsLeftOut(out, n_discs)


def _n_independent(xy: FloatArray, correlation_m: float) -> int:
    cells = np.floor(xy / max(correlation_m, 1e-3)).astype(np.int64)
    return len(np.unique(cells, axis=0))


def _scale(error: FloatArray, variance: FloatArray, noise: FloatArray, weight: float) -> float:
    def negative(log_scale: float) -> float:
        total = np.exp(2.0 * log_scale) * variance + noise
        misfit = 0.5 * float(np.sum(np.log(total) + error**2 / total))
        return weight * misfit + 0.5 * (log_scale / _PRIOR_LOG_SD) ** 2

    return float(np.exp(minimize_scalar(negative, bounds=(-1.5, 1.5), method="bounded").x))
