r"""Calibration of a lattice's standard deviation on points that are left out: cross-validation and conformal bounds.

`calibrated` leaves out blocks of points, and finds the factors on the surface's standard deviation and on the points'
errors that are likeliest there.

Points that are left out at random do not show how wrong a map is behind a hill: there the ground is
hidden because it is low. `bound_factors` places imagined sensors where the map is measured, away from the real ones and
as high above the ground. What they would not see, behind rises and in the blind circle at their feet, is
left out, and the map without it is compared with what was measured there. Single points and small
blocks are left out as well, for ground that was seen or nearly so.
From the errors e of the left-out points and the spread s that was stated for them come two factors
for each class of distance to the nearest measured node, such that

.. math::  z - a_- s \le \text{ground} \le z + a_+ s

held for a share of 1 - α/2 of them on either side, as in split conformal prediction.

`RecentPoints` retains a sample of the latest points, on which a field lattice runs both.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from scipy.optimize import minimize

from survey.core import BoolArray, FloatArray, IntArray, stream
from survey.reconstruction.lattice.config import FieldLatticeConfig
from survey.reconstruction.lattice.field_posterior import FieldPosterior, Part, Stiffness, is_small
from survey.reconstruction.nodes import NodeWindow, away_from, bilinear
from survey.reconstruction.observations import Predict
from survey.reconstruction.terrain_map import SIGMAS_95

# Sides of the blocks that are left out, and of the cells of which one point is predicted.
_BLOCK_IN_STEPS, _CELL_IN_STEPS = 4.0, 2.0
_N_FOLDS, _BLOCK_SHARE = 3, 1.0 / 6.0
# With fewer predictions nothing is calibrated.
_N_LEAST = 40
# Without enough blocks to say otherwise both factors are 1, give or take a factor of 1.6.
_PRIOR_LOG_SD = 0.5
_LOG_BOUNDS = ((0.0, 3.0), (-2.5, 2.5))


class LatticeCalibration(NamedTuple):
    """Factors on the surface's standard deviation and on the points' errors."""

    surface: float = 1.0
    points: float = 1.0
    n_held_out: int = 0
    coverage_95_before: float = float("nan")
    coverage_95_after: float = float("nan")

    def facts(self) -> dict[str, Any]:
        """Return the factors and what they rest on, for the record."""
        return {name: value for name, value in self._asdict().items() if value == value}  # noqa: PLR0124  (NaN)


def calibrated(
    points: FloatArray, noise_m2: FloatArray, step_m: float, predict: Predict
) -> LatticeCalibration:
    r"""Leave out blocks of four steps, a sixth of them at a time, predict their points, and compare.

    The factors a and c on the standard deviations of surface and points maximise

    .. math::  \sum_i \log N(e_i; 0, a^2 v_i + c^2 \sigma_i^2) - \frac{\log^2 a + \log^2 c}{2 \cdot 0.5^2}

    over one point per cell of two steps, so that every place counts alike: with the
    prediction error e, its variance v and the point's own variance σ².

    `points` (N, 4): easting, northing, height [m], and weight. `noise_m2` (N,): variances of the points'
    errors [m²]. `step_m`: distance between the nodes [m].

    The surface's factor never falls below 1: points stand where the sensor could see, so that
    they can prove a map too bold and not too cautious.
    """
    errors = [_fold(points, noise_m2, step_m, predict, k) for k in range(_N_FOLDS)]
    return likeliest_factors(*(np.concatenate(column) for column in zip(*errors, strict=True)))


def likeliest_factors(error: FloatArray, variance: FloatArray, noise: FloatArray) -> LatticeCalibration:
    """Return the factors of `calibrated` by predictions; both are 1 with fewer than 40 of them.

    `error` (N,): prediction errors [m]. `variance`, `noise` (N,): variances of the surface and of the
    measurements [m²].
    """
    if len(error) < _N_LEAST:
        return LatticeCalibration()

    def negative(logs: FloatArray) -> float:
        total = np.exp(2.0 * logs[0]) * variance + np.exp(2.0 * logs[1]) * noise
        misfit = 0.5 * float(np.sum(np.log(total) + error**2 / total))
        return misfit + 0.5 * float(np.sum(logs**2)) / _PRIOR_LOG_SD**2

    a, c = np.exp(minimize(negative, np.zeros(2), method="L-BFGS-B", bounds=_LOG_BOUNDS).x)
    before, after = variance + noise, a**2 * variance + c**2 * noise
    return LatticeCalibration(
        float(a), float(c), len(error), _coverage(error, before), _coverage(error, after)
    )


def _fold(
    points: FloatArray, noise_m2: FloatArray, step_m: float, predict: Predict, k: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return errors, variances of the surface and variances of the points that were left out in one fold."""
    out = left_out_blocks(points[:, :2], _BLOCK_IN_STEPS * step_m, _BLOCK_SHARE, k)
    if out.all() or not out.any():
        nothing = np.zeros(0)
        return nothing, nothing, nothing
    predicted = _one_per_cell(points, out, step_m)
    mean, variance = predict(~out, points[predicted, :2])
    known = np.isfinite(mean)
    error: FloatArray = points[predicted, 2] - mean
    return error[known], variance[known], noise_m2[predicted][known]


def left_out_blocks(xy: FloatArray, side_m: float, share: float, number: int) -> BoolArray:
    """Return which points (N,) lie in blocks that are left out; always the same ones for one number."""
    blocks, index = np.unique(np.floor(xy / side_m).astype(np.int64), axis=0, return_inverse=True)
    chosen = stream(number, "lattice", "blocks left out").random(len(blocks)) < share
    out: BoolArray = chosen[index.ravel()]
    return out


def _coverage(error: FloatArray, variance: FloatArray) -> float:
    return float(np.mean(np.abs(error) <= SIGMAS_95 * np.sqrt(variance)))


# Distances to the nearest measured node that part the classes, in steps; the first class is measured itself.
_CLASSES_IN_STEPS = (0.5, 1.5, 3.0, 6.0)
# From this class on ground is far from points, and a bound is no narrower than that of normal errors.
_FAR_CLASS = 3
# Share of errors beyond a bound.
_MISS = 0.02
_N_SIGHTS, _N_SAMPLED = 6, 2_000
_SINGLE_SHARE = 0.1
_NORMAL = 1.959964
# The end of a ray is the ground itself.
_END_IN_STEPS = 1.5
_BLIND_SHARE = 0.02


class Predicted(NamedTuple):
    """Height (M,) [m], spread of a new measurement (M,) [m], and distance to the nearest measured node (M,) in steps."""

    height: FloatArray
    spread: FloatArray
    away: FloatArray


PredictHidden = Callable[[BoolArray, FloatArray], Predicted]
"""Function of the retained points (N,) and of places (M, 2) that returns the prediction there."""


class BoundFactors(NamedTuple):
    """How many spreads the ground may lie below and above the map, class by class (C,), and what that rests on."""

    below: FloatArray
    above: FloatArray
    n_places: IntArray

    @classmethod
    def normal(cls) -> "BoundFactors":
        """Return those of normal errors."""
        n = len(_CLASSES_IN_STEPS) + 1
        return cls(np.full(n, _NORMAL), np.full(n, _NORMAL), np.zeros(n, dtype=np.int64))

    def at(self, away: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return both factors at distances from the nearest measured node, in steps."""
        k = np.searchsorted(_CLASSES_IN_STEPS, away)
        return self.below[k], self.above[k]

    def facts(self) -> dict[str, Any]:
        """Return the factors and what they rest on, for the record."""
        return {name: value.tolist() for name, value in self._asdict().items()}


class Scenes(NamedTuple):
    """Measured points, and from where.

    `points` (N, 7): easting, northing, height above the datum [m], weight [1/m²], and the sensor's place [m].
    `window`: nodes that cover them. `surface` (H, W): heights of the map of all points [m]. `measured` (H, W)
    bool: on which nodes points hang.
    """

    points: FloatArray
    window: NodeWindow
    surface: FloatArray
    measured: BoolArray


def bound_factors(scenes: Scenes, predict: PredictHidden) -> BoundFactors:
    """Leave points out, one view after the other, and return the factors that would have held for them."""
    errors, classes = [], []
    for out in _left_out(scenes):
        if out.all() or not out.any():
            continue
        predicted = _one_per_cell(scenes.points, out, scenes.window.step_m)
        height, spread, away = predict(~out, scenes.points[predicted, :2])
        known = np.isfinite(height)
        errors.append(((height - scenes.points[predicted, 2]) / spread)[known])
        classes.append(np.searchsorted(_CLASSES_IN_STEPS, away[known]))
    if not errors:
        return BoundFactors.normal()
    return _factors(np.concatenate(errors), np.concatenate(classes))


def _factors(error: FloatArray, number: IntArray) -> BoundFactors:
    """Return the quantiles of the errors in every class; never fewer spreads than nearer by."""
    n = len(_CLASSES_IN_STEPS) + 1
    count = np.bincount(number, minlength=n)
    below, above = np.full(n, _NORMAL), np.full(n, _NORMAL)
    for k in range(n):
        # Far from the points errors are alike over metres, and few views say less than their many places seem to.
        least = _NORMAL if k >= _FAR_CLASS else 1.0
        # Until enough places say otherwise, a class has its neighbour's factor.
        if count[k] >= _N_LEAST:
            below[k], above[k] = (max(least, _quantile(sign * error[number == k])) for sign in (1.0, -1.0))
        elif k:
            below[k], above[k] = max(least, below[k - 1]), max(least, above[k - 1])
    return BoundFactors(below, above, count)


def _quantile(error: FloatArray) -> float:
    """Return what a share of 1 - α/2 of further errors will not exceed."""
    level = min(1.0, (1.0 - _MISS) * (1.0 + 1.0 / len(error)))
    return float(np.quantile(error, level, method="higher"))


def _left_out(scenes: Scenes) -> Iterator[BoolArray]:
    """Yield which points (N,) are left out: hidden from imagined sensors, in blocks, and one by one."""
    for sensor, blind_m in imagined_sensors(scenes):
        yield hidden_from(sensor, blind_m, scenes)
    xy = scenes.points[:, :2]
    yield left_out_blocks(xy, _BLOCK_IN_STEPS * scenes.window.step_m, _BLOCK_SHARE, 0)
    yield stream(0, "lattice", "points left out").random(len(xy)) < _SINGLE_SHARE


def imagined_sensors(scenes: Scenes) -> Iterator[tuple[FloatArray, float]]:
    """Yield places (3,) [m] over measured ground, each as far as can be from the real ones and from those before it.

    With each comes the radius of the circle that a sensor does not see at its feet [m].
    """
    real = scenes.points[:, 4:]
    nodes = scenes.window.xy[scenes.measured.ravel()]
    nodes = nodes[:: -(-len(nodes) // _N_SAMPLED)]
    ground = bilinear(scenes.surface, scenes.window.coordinates(real[:, :2]))
    above = real[:, 2] - ground
    above = above[np.isfinite(above) & (above > 0.0)]
    if not len(above):
        return
    height_m = float(np.median(above))
    range_m = np.hypot(*(scenes.points[:, :2] - real[:, :2]).T)
    blind_m = float(np.quantile(range_m, _BLIND_SHARE))
    centre = real[:: -(-len(real) // 50), :2]
    away = np.min(np.hypot(*(nodes[:, None] - centre[None]).T), axis=0)
    for _ in range(_N_SIGHTS):
        # Not at the very edge, whence most would be hidden by nothing.
        best = int(np.argmin(np.abs(away - 0.7 * away.max())))
        place = nodes[best]
        z = float(bilinear(scenes.surface, scenes.window.coordinates(place[None]))[0])
        yield np.array([*place, z + height_m]), blind_m
        away = np.minimum(away, np.hypot(*(nodes - place).T))


def hidden_from(sensor: FloatArray, blind_m: float, scenes: Scenes) -> BoolArray:
    """Return which points (N,) a sensor at a place (3,) [m] would not see."""
    uv = scenes.window.coordinates(scenes.points[:, :2])
    u, v = scenes.window.coordinates(sensor[None, :2])[0]
    far = np.hypot(*(scenes.points[:, :2] - sensor[:2]).T)
    hidden = _covered(scenes.surface, uv, scenes.points[:, 2], np.array([u, v, sensor[2]]))
    unseen: BoolArray = hidden | (far < blind_m)
    return unseen


@njit(cache=True)
def _covered(surface: FloatArray, uv: FloatArray, z: FloatArray, sensor: FloatArray) -> BoolArray:
    """Walk from every point towards the sensor, half a step at a time, and see whether the surface is in between."""
    rows, columns = surface.shape
    covered = np.zeros(len(uv), dtype=np.bool_)
    for k in range(len(uv)):
        du, dv, dz = sensor[0] - uv[k, 0], sensor[1] - uv[k, 1], sensor[2] - z[k]
        length = np.hypot(du, dv)
        t = _END_IN_STEPS
        while t < length:
            u, v = uv[k, 0] + t / length * du, uv[k, 1] + t / length * dv
            i, j = min(max(int(u), 0), columns - 2), min(max(int(v), 0), rows - 2)
            a, b = u - i, v - j
            south = surface[j, i] * (1 - a) + surface[j, i + 1] * a
            north = surface[j + 1, i] * (1 - a) + surface[j + 1, i + 1] * a
            if south * (1 - b) + north * b > z[k] + t / length * dz:
                covered[k] = True
                break
            t += 0.5
    return covered


def _one_per_cell(points: FloatArray, out: BoolArray, step_m: float) -> IntArray:
    """Return one of the left-out points in every cell of two steps, so that every place counts alike."""
    cells = np.floor(points[out, :2] / (_CELL_IN_STEPS * step_m)).astype(np.int64)
    return np.flatnonzero(out)[np.sort(np.unique(cells, axis=0, return_index=True)[1])]


_N_PER_SCAN, _N_KEPT = 10_000, 20_000
_N_DRAWS, _N_DRAWS_FOR_BOUNDS = 32, 16
# What a map is held to its points on is no wider than this many nodes, about where most points are.
_MOST_NODES = 192


@dataclass(eq=False)
class RecentPoints:
    """Points of the latest scans: easting, northing, height above the datum [m], weight [1/m²].

    Where lines of sight count, the sensor's place follows [m]: (N, 7) in place of (N, 4).
    """

    scans: list[FloatArray] = field(default_factory=list)

    def add(self, scan: FloatArray) -> None:
        """Add a sample of a scan, and drop the oldest points."""
        self.scans.append(scan[:: -(-len(scan) // _N_PER_SCAN) or 1].copy())
        while sum(map(len, self.scans[1:])) >= _N_KEPT:
            self.scans.pop(0)

    @property
    def xyzw(self) -> FloatArray:
        """All points (N, 4); the latest ones when there are too many."""
        return self._all[:, :4]

    @property
    def _all(self) -> FloatArray:
        return np.concatenate(self.scans)[-_N_KEPT:]

    def calibration(self, config: FieldLatticeConfig, stiffness: Stiffness) -> LatticeCalibration:
        """Return the factors on the standard deviations that blocks of left-out points ask for."""
        points = self._amid(config.node_step_m)[:, :4]
        window = _window(points, config.node_step_m)

        def predict(kept: BoolArray, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
            posterior = _without(window, points[kept], config, stiffness, _N_DRAWS)
            places = window.coordinates(xy)
            std = bilinear(posterior.std(window, stiffness), places)
            return bilinear(posterior.heights(), places), std**2

        noise_m2 = stiffness.noise_factor**2 / points[:, 3]
        return calibrated(points, noise_m2, config.node_step_m, predict)

    def bound_factors(self, config: FieldLatticeConfig, stiffness: Stiffness) -> BoundFactors:
        """Return how many spreads the ground may lie below and above the map, as left-out points ask for."""
        points = self._amid(config.node_step_m)
        window = _window(points, config.node_step_m)
        known = _without(window, points[:, :4], config, stiffness, 0)
        measured = known.information.stencil[0] > 0.0
        noise_m2 = self.noise_m2(stiffness)

        def predict(kept: BoolArray, xy: FloatArray) -> Predicted:
            posterior = _without(window, points[kept, :4], config, stiffness, _N_DRAWS_FOR_BOUNDS)
            places = window.coordinates(xy)
            std = bilinear(posterior.std(window, stiffness), places)
            away = bilinear(away_from(posterior.information.stencil[0] > 0.0), places)
            return Predicted(bilinear(posterior.heights(), places), np.sqrt(std**2 + noise_m2), away)

        return bound_factors(Scenes(points, window, known.heights(), measured), predict)

    def noise_m2(self, stiffness: Stiffness) -> float:
        """Return the variance of a single measurement about the surface, as it usually is [m²]."""
        return float(stiffness.noise_factor**2 * np.median(1.0 / self.xyzw[:, 3]))

    def _amid(self, step_m: float) -> FloatArray:
        """Return the points around the centre of all points, to bound the time of a calibration."""
        points = self._all
        away = np.abs(points[:, :2] - np.median(points[:, :2], axis=0)).max(axis=1)
        amid: FloatArray = points[away < 0.5 * _MOST_NODES * step_m]
        return amid


def _window(points: FloatArray, step_m: float) -> NodeWindow:
    (xmin, ymin), (xmax, ymax) = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    return NodeWindow.over((xmin, ymin, xmax, ymax), step_m)


def _without(
    window: NodeWindow, points: FloatArray, config: FieldLatticeConfig, stiffness: Stiffness, n_draws: int
) -> FieldPosterior:
    """Return the map of some points (N, 4) alone."""
    posterior = FieldPosterior.empty(window.shape, 0 if is_small(window.shape) else n_draws)
    posterior.information.add(np.column_stack([window.coordinates(points[:, :2]), points[:, 2:]]))
    whole = Part(slice(0, window.rows), slice(0, window.columns))
    posterior.solve(whole, config.node_step_m, stiffness, config)
    return posterior
