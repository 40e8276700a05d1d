r"""Prediction on a fine grid through a spline between exact nodes, checked at other nodes.

Where every node costs a solve, as with few points, with the cells of a prior or with the bound by the nearest points, a
grid far finer than the points repeats nearly the same solve. Every s-th node is predicted exactly, and a bicubic spline gives
the others. The result is compared with the exact prediction at the nodes nearest to the points, where kernels of rough
terrain are least smooth, and at nodes spread over the grid. Where an error is above 5 % of the standard deviation, all nodes
as near to a point as the farthest of these are predicted exactly too; where they are more than a quarter of the grid, s falls
by a third, down to the exact grid.
"""

from functools import lru_cache

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline, RectBivariateSpline
from scipy.ndimage import distance_transform_edt

from survey.core import FloatArray, IntArray
from survey.reconstruction.gp.engines.regression import Process

# Nodes that are predicted exactly without thought, and about those of the first attempt.
_FEW = 2500
# Largest error at a node that is compared, in standard deviations of the ground: it adds 0.1 % to the root mean square of the
# error there, and changes the share within a 95 % interval by about one in a hundred.
TOLERANCE = 0.05
# Nodes that are compared: near points, and spread by the sequence of Roberts (2018), whose steps are these.
_N_COMPARED = 500
# Largest share of the nodes that are predicted exactly because they are near points.
_MOST_NEAR = 0.25
_SPREAD = np.array([0.7548776662466927, 0.5698402909980532])


def predict_on_fine_axes(
    process: Process, x: FloatArray, y: FloatArray, nugget_m: float
) -> tuple[FloatArray, FloatArray]:
    """Return mean and standard deviation (H, W) [m] on the nodes of two axes (W,) and (H,) [m].

    `nugget_m`: standard deviation of relief that the process takes as noise [m], part of that of the ground.
    """
    stride = first_stride(len(y), len(x), len(process.data))
    if stride > 2:
        rows, columns = _compared(process.data.xy, x, y)
        mean, variance = process.predict(np.stack([x[columns], y[rows]], axis=-1))
        std = np.sqrt(variance)
        allowed = TOLERANCE * np.sqrt(variance + nugget_m**2)
    while stride > 2:  # every second node costs a quarter of all, and may fail
        found = _through_spline(process, x, y, stride)
        errors = np.abs(found[0][rows, columns] - mean), np.abs(found[1][rows, columns] - std)
        failed = np.maximum(*errors) > allowed
        if not failed.any():
            return found
        nearest = _nodes_to_points(process.data.xy, x, y)
        near = nearest <= nearest[rows[failed], columns[failed]].max() + 1.0
        if near.mean() <= _MOST_NEAR:
            return _exact_where(near, process, x, y, found)
        stride = 2 * stride // 3
    return process.predict_on_axes(x, y)


def first_stride(n_rows: int, n_columns: int, n_points: int) -> int:
    """Return the stride of the exact nodes of the first attempt, which are no fewer than points; 1 for every node."""
    return max(int(np.sqrt(n_rows * n_columns / max(_FEW, n_points))), 1)


def _through_spline(
    process: Process, x: FloatArray, y: FloatArray, stride: int
) -> tuple[FloatArray, FloatArray]:
    """Return mean and standard deviation (H, W) by splines between every `stride`-th node."""
    rows, columns = _every(len(y), stride), _every(len(x), stride)
    mean, std = (
        RectBivariateSpline(rows, columns, values)(np.arange(len(y)), np.arange(len(x)))
        for values in process.predict_on_axes(x[columns], y[rows])
    )
    return mean, np.maximum(std, 0.0)


@lru_cache(maxsize=256)
def spline_weights(n_nodes: int, n_places: int) -> FloatArray:
    """Return the weights (N, K) of values at even places, at least four, at N even nodes from the first to the last of them."""
    n_places = max(n_places, 4)
    if n_places >= n_nodes:
        return np.eye(n_nodes)
    places = np.linspace(0.0, n_nodes - 1.0, n_places)
    return np.asarray(CubicSpline(places, np.eye(n_places))(np.arange(n_nodes)), dtype=np.float64)


def _nodes_to_points(points: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the distances (H, W) of nodes to the nearest node with a point, in steps of the grid."""
    without = np.ones((len(y), len(x)), dtype=bool)
    without[_nearest(y, points[:, 1]), _nearest(x, points[:, 0])] = False
    return np.asarray(distance_transform_edt(without), dtype=np.float64)


def _exact_where(
    near: npt.NDArray[np.bool_],
    process: Process,
    x: FloatArray,
    y: FloatArray,
    found: tuple[FloatArray, FloatArray],
) -> tuple[FloatArray, FloatArray]:
    """Return mean and standard deviation (H, W) with the exact ones at some nodes (H, W)."""
    mean, std = found
    rows, columns = np.nonzero(near)
    mean[near], variance = process.predict(np.stack([x[columns], y[rows]], axis=-1))
    std[near] = np.sqrt(variance)
    return mean, std


def _every(n: int, stride: int) -> IntArray:
    """Return about every `stride`-th of n numbers, the first and the last among them, and no fewer than four."""
    n_kept = min(max((n - 1) // stride + 2, 4), n)
    return np.linspace(0, n - 1, n_kept).round().astype(np.int64)


def _compared(points: FloatArray, x: FloatArray, y: FloatArray) -> tuple[IntArray, IntArray]:
    """Return rows and columns (M,) of the nodes to compare: those nearest to points, and others."""
    some = points[:: max(len(points) // _N_COMPARED, 1)]
    spread = np.modf(0.5 + np.arange(_N_COMPARED)[:, None] * _SPREAD)[0]
    columns, rows = (
        np.concatenate([_nearest(axis, some[:, i]), (spread[:, i] * len(axis)).astype(np.int64)])
        for i, axis in enumerate((x, y))
    )
    return rows, columns


def _nearest(axis: FloatArray, places: FloatArray) -> IntArray:
    """Return the numbers (M,) of the nodes of an even axis that are nearest to places (M,) [m]."""
    steps = np.rint((places - axis[0]) / (axis[1] - axis[0]))
    return np.asarray(steps.clip(0, len(axis) - 1), dtype=np.int64)
