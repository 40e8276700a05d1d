r"""Error of hidden ground, estimated from ground that another sensor would not have seen.

Points that are left out at random do not show how wrong a map is behind a hill: there the ground is
hidden because it is low. So sensors are imagined where the map is known, away from the real ones and as
high above the ground; what they would not see, behind rises and in the blind circle at their feet, is
left out, and the map without it is compared with what was measured there. Single points and small
blocks are left out as well, for ground that was seen or nearly so.

From the errors e of the left-out points and the spread s that was stated for them come two factors
for each class of distance to the nearest measured node, such that

.. math::  z - a_- s \le \text{ground} \le z + a_+ s

held for a share of 1 - α/2 of them on either side, as in split conformal prediction.
"""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from survey.core.arrays import BoolArray, FloatArray, IntArray
from survey.core.streams import stream
from survey.reconstruction.lattice.calibration import left_out_blocks
from survey.reconstruction.nodes import NodeWindow, bilinear

# Distances to the nearest measured node that part the classes, in steps; the first class is measured itself.
_CLASSES_IN_STEPS = (0.5, 1.5, 3.0, 6.0)
_FAR_CLASS = 3
_MISS = 0.02
_N_SIGHTS, _N_ASKED = 6, 2_000
_SINGLE_SHARE, _BLOCK_SHARE, _BLOCK_IN_STEPS = 0.1, 1.0 / 6.0, 4.0
_THIN_IN_STEPS = 2.0
# Until so many places say otherwise a class has its neighbour's factor.
_N_LEAST = 40
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

    Parameters
    ----------
    points : (N, 7) ndarray
        Easting, northing, height above the datum [m], weight [1/m²], and the sensor's place [m].
    window : NodeWindow
        Nodes that cover them.
    surface : (H, W) ndarray
        Heights of the map of all points [m].
    measured : (H, W) ndarray of bool
        On which nodes points hang.
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
        asked = _one_per_cell(scenes.points, out, scenes.window.step_m)
        height, spread, away = predict(~out, scenes.points[asked, :2])
        known = np.isfinite(height)
        errors.append(((height - scenes.points[asked, 2]) / spread)[known])
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
    nodes = nodes[:: -(-len(nodes) // _N_ASKED)]
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
    cells = np.floor(points[out, :2] / (_THIN_IN_STEPS * step_m)).astype(np.int64)
    return np.flatnonzero(out)[np.sort(np.unique(cells, axis=0, return_index=True)[1])]
