"""Landmarks of a drive: errors that they share beyond those of the path, and their thinning.

Landmarks that are seen from one stretch of the path share an error of height, and far ones share a bias. `most_informative`
thins surface points by lazy greedy selection: gains are submodular, so they only decrease while points are taken.
"""

import heapq
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag

from survey.core import FloatArray, InputError, IntArray
from survey.data.surface_points import SurfacePoints

STRETCH_M = 5.0
"""Travel over which landmarks share an error of height [m]."""
SHARED_SIGMA_M = 0.017
"""Standard deviation of that error for landmarks from images [m]: means of ten seconds scatter by 1.3 cm, 2.3 to 2.5
times what independent errors make of them."""
_FAR_FROM_M, _FAR_TO_M = 10.0, 15.0


def far_share(range_m: FloatArray) -> FloatArray:
    """Return the share (N,) of the height bias of far landmarks at ranges (N,): 0 to 10 m, 1 from 15 m on.

    At grazing angles a camera sees crests and not the troughs between them, so what it sees lies above the mean
    ground.

    `range_m` (N,): distance at first sight [m]. Returns (N,): between 0 and 1.

    >>> far_share(np.array([5.0, 12.5, 30.0]))
    array([0. , 0.5, 1. ])
    """
    return np.clip((range_m - _FAR_FROM_M) / (_FAR_TO_M - _FAR_FROM_M), 0.0, 1.0)


def stretches(points: SurfacePoints, drive: IntArray | None = None) -> IntArray | None:
    """Return the number of the stretch of `STRETCH_M` of travel that each point was seen from.

    `drive` (N,) int: number of the drive of each landmark; drives share no stretch. Returns (N,) int: numbers
    from 0 on, of those stretches that points were seen from; None for points that name no keyframe.
    """
    if points.keyframe is None or points.body is None:
        return None
    _, first, pose = np.unique(points.keyframe, return_index=True, return_inverse=True)
    steps = np.linalg.norm(np.diff(points.body[first], axis=0), axis=1)
    travel_m = np.r_[0.0, np.cumsum(steps)]
    stretch = np.floor(travel_m / STRETCH_M)
    if drive is not None:
        stretch = stretch + drive[first] * (stretch[-1] + 1.0)
    _, numbers = np.unique(stretch[pose], return_inverse=True)
    return numbers


_NODES_PER_LENGTH_SCALE = 2.0
_MOST_NODES = 2500
_BLOCK = 1000


def most_informative(
    points: SurfacePoints,
    n: int,
    bounds: tuple[float, float, float, float],
    *,
    variance_m2: float = 10.0,
    length_scale_m: float = 17.75,
    shared_sigma_m: float = SHARED_SIGMA_M,
) -> IntArray:
    r"""Return the indices of the `n` points that lower a map's variance the most, the best first.

    The terrain about its prior is a Gaussian process of squared-exponential covariance,
    represented on nodes half a length scale apart and linear between them; P is the covariance of
    the nodes given the points that are taken already. A point whose height is w·z of the
    nodes' heights z, with the variance r (its own, and that of the terrain between nodes),
    lowers the variance summed over the nodes inside the bounds by

    .. math:: Δ = Σ_u (P w)_u² / (r + w^T P w), \quad P ← P − P w w^T P / (r + w^T P w)

    (Krause et al. 2008, section 8.2, have the criterion as A-optimality; the update is the
    Kalman filter's.) The point of the largest Δ is taken next. Information about unseen ground
    counts, so points at the rim of the seen ground are selected early, and few of those that
    crowd beside the track. The gains are submodular, so the selection is lazy.

    Of `covariance` the own part of each point counts where it is given: the error that
    neighbours share by the path is not reduced by the selection. The error that points seen from one stretch of
    the path share is an unknown beside the nodes. Sites of more than 2500 nodes
    are represented on coarser ones.

    `bounds` (west, south, east, north): bounds of the wanted map [m], in the CRS of the points.
    `variance_m2`, `length_scale_m`: variance [m²] and length scale [m] of the terrain about its prior.
    `shared_sigma_m`: error of height that points share which were seen from one stretch of the path [m]; not
    of points that name no keyframe. Returns (min(n, N),) int: indices into `points`, the most informative
    first.

    Of two good points side by side and a bad one far away, the bad one is more informative
    than the second good one:

    >>> place = np.array([[10.0, 10.0, 5.0], [10.1, 10.0, 5.0], [80.0, 10.0, 6.0]])
    >>> points = SurfacePoints(place, sigma_m=np.array([0.1, 0.2, 0.9]), crs="EPSG:32608")
    >>> sorted(most_informative(points, 2, (0.0, 0.0, 100.0, 20.0)).tolist())
    [0, 2]
    """
    if n < 1 or variance_m2 <= 0.0 or length_scale_m <= 0.0:
        raise InputError(
            f"thinning to {n} points on a terrain of {variance_m2:g} m² over {length_scale_m:g} m; all must be above 0."
        )
    model = _on_nodes(points, bounds, variance_m2, length_scale_m)
    return _chosen(_with_stretches(model, points, shared_sigma_m), n)


class _NodeModel(NamedTuple):
    """The terrain on M nodes, and its observation by N points."""

    covariance: FloatArray
    """P (M, M) [m²], updated as points are selected."""
    wanted: FloatArray
    """(M,) 1 where the map is wanted, else 0."""
    node: IntArray
    """(N, 4 or 5) nodes about each point, and the unknown of its stretch."""
    weight: FloatArray
    """(N, 4 or 5) w, of those."""
    variance: FloatArray
    """r (N,) [m²]."""


def _chosen(model: _NodeModel, n: int) -> IntArray:
    """Select the point of the largest gain `n` times; a gain is recomputed only at the top of the heap, since it never grows."""
    gains = np.concatenate([_gains(model, block) for block in _blocks(len(model.node))])
    heap = [(-gain, index) for index, gain in enumerate(gains.tolist())]
    heapq.heapify(heap)
    chosen: list[int] = []
    while heap and len(chosen) < n:
        _, index = heapq.heappop(heap)
        now = float(_gains(model, np.array([index]))[0])
        if heap and now < -heap[0][0]:  # points selected since have lowered its gain
            heapq.heappush(heap, (-now, index))
            continue
        chosen.append(index)
        _take(model, index)
    return np.array(chosen, dtype=np.int64)


def _on_nodes(
    points: SurfacePoints,
    bounds: tuple[float, float, float, float],
    variance_m2: float,
    length_scale_m: float,
) -> _NodeModel:
    """Build the model on nodes over points and bounds, with the four nodes around each point."""
    west, south, east, north = bounds
    low = np.minimum(points.xy.min(axis=0), [west, south])
    span = np.maximum(points.xy.max(axis=0), [east, north]) - low
    step = max(length_scale_m / _NODES_PER_LENGTH_SCALE, float(np.sqrt(span.prod() / _MOST_NODES)))
    columns, rows = (np.ceil(span / step).astype(int) + 1).tolist()
    columns, rows = max(columns, 2), max(rows, 2)
    x, y = np.meshgrid(low[0] + step * np.arange(columns), low[1] + step * np.arange(rows))
    nodes = np.column_stack([x.ravel(), y.ravel()])
    place = (points.xy - low) / step
    corner = np.floor(place).astype(np.int64).clip(0, [columns - 2, rows - 2])
    u, v = (place - corner).T
    node = (corner[:, 1] * columns + corner[:, 0])[:, None] + np.array([0, 1, columns, columns + 1])
    weight = np.column_stack([(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v])

    def covariance(first: FloatArray, second: FloatArray) -> FloatArray:
        squared = ((first - second) ** 2).sum(axis=-1)
        values: FloatArray = variance_m2 * np.exp(-0.5 * squared / length_scale_m**2)
        return values

    at_nodes = covariance(nodes[:, None], nodes[None])
    to_corners = covariance(points.xy[:, None], nodes[node])
    between = variance_m2 - 2.0 * (weight * to_corners).sum(axis=1)
    between += np.einsum("ni,nij,nj->n", weight, at_nodes[node[:, :, None], node[:, None, :]], weight)
    inside = ((nodes >= [west, south]) & (nodes <= [east, north])).all(axis=1)
    wanted: FloatArray = np.asarray(inside, dtype=np.float64) if inside.any() else np.ones(len(nodes))
    variance: FloatArray = _own_variance(points) + np.maximum(between, 0.0)
    return _NodeModel(at_nodes, wanted, node, weight, variance)


def _with_stretches(model: _NodeModel, points: SurfacePoints, shared_sigma_m: float) -> _NodeModel:
    """Append the errors of stretches of the path to the nodes; nothing is wanted of them."""
    numbers = stretches(points)
    if numbers is None or shared_sigma_m == 0.0:
        return model
    n = int(numbers.max()) + 1
    return _NodeModel(
        block_diag(model.covariance, shared_sigma_m**2 * np.eye(n)),
        np.r_[model.wanted, np.zeros(n)],
        np.column_stack([model.node, len(model.wanted) + numbers]),
        np.column_stack([model.weight, np.ones(len(numbers))]),
        model.variance,
    )


def _own_variance(points: SurfacePoints) -> FloatArray:
    """Return the variance of each elevation that no other point shares [m²]."""
    if points.own_covariance is not None:
        return points.own_covariance[:, 2, 2]
    variance: FloatArray = points.sigma_z**2
    return variance


def _blocks(n: int) -> list[IntArray]:
    """Return the indices below `n` in portions that fit into the memory."""
    return np.split(np.arange(n), np.arange(_BLOCK, n, _BLOCK))


def _reach(model: _NodeModel, index: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return P w of some points (M, K), and r + wᵀ P w (K,)."""
    node, weight = model.node[index], model.weight[index]
    reach = np.einsum("mki,ki->mk", model.covariance[:, node], weight)
    own = np.einsum("kij,ki,kj->k", model.covariance[node[:, :, None], node[:, None, :]], weight, weight)
    return reach, model.variance[index] + own


def _gains(model: _NodeModel, index: IntArray) -> FloatArray:
    """Return Δ of some points [m²]."""
    reach, total = _reach(model, index)
    gains: FloatArray = model.wanted @ reach**2 / total
    return gains


def _take(model: _NodeModel, index: int) -> None:
    """Update P by the observation of a point."""
    reach, total = _reach(model, np.array([index]))
    model.covariance[...] -= reach @ reach.T / total
