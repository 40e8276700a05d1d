r"""Joint map of the measurements so far, by elimination of one segment of the path at a time.

An update of `LiveMap` solves the joint estimate of `survey.reconstruction.joint` again with the covariance of the terrain
as it was last fitted. With samples that share one error its cost is that of the waves and hardly depends on the number of
samples. With landmarks the errors of the path are eliminated segment by segment, so that it grows with the ground that
was seen, not with the number of landmarks.

`path_segments` divides the unknowns of a path between knots. Of a segment let u be the unknowns inside it, b those around
it that it touches, and t the heights of the ground at its nodes. Its points are ``z = C t + U u + V b + ε``; with the
prior information A of u and F between u and b, eliminating u leaves

.. math::  W^T N^{-1} W - Z^T (A + U^T N^{-1} U)^{-1} Z, \qquad W = [V, C, z], \qquad Z = U^T N^{-1} W + [F, 0, 0]

The nodes t are Chebyshev nodes (`local_nodes`). Within a rectangle of half sides a along its axes, interpolation by n of
them of a wave ``cos(ω x)`` errs by at most

.. math::  \frac{(\omega a)^n}{2^{n-1} n!}

so that the error of a random surface follows from its spectrum, and as many nodes are taken as a tolerance needs.
`segment_map` solves the equations that are left and returns the map; it equals that of one solve but for the error of
interpolation.
"""

from dataclasses import dataclass
from math import factorial
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import chebyshev
from scipy import sparse
from scipy.linalg import blas, cho_factor, cho_solve, solve_triangular

from survey import Dem, GaussianProcessConfig, Grid, SurfacePoints
from survey.core.arrays import FloatArray, IntArray
from survey.data.path_error import POSE, PathError
from survey.reconstruction.gp.config import JointConfig
from survey.reconstruction.gp.kernels import Kernel
from survey.reconstruction.joint.joint_map import JointTerrain
from survey.reconstruction.joint.normal_equations import JointEquations, JointPosterior, JointSystem, waves_at


class LocalNodes(NamedTuple):
    """Places (q, 2) [m], and the weights (P, q) by which heights there give those of points."""

    xy: FloatArray
    weights: FloatArray


def local_nodes(xy: FloatArray, omega: FloatArray, strengths: FloatArray, tolerance_m: float) -> LocalNodes:
    """Return nodes from which the heights of points follow within a tolerance; the points themselves if no more are needed.

    `xy` (P, 2): points [m]. `omega` (K, 2): angular frequencies of the surface's waves [rad/m]. `strengths`
    (K,): standard deviations of the waves [m]. `tolerance_m`: largest standard deviation of the error of
    interpolation along either axis [m].

    >>> xy = np.random.default_rng(1).uniform(0.0, 40.0, (500, 2))
    >>> omega = np.array([[0.02, 0.01], [-0.01, 0.03]])
    >>> nodes = local_nodes(xy, omega, np.array([1.0, 1.0]), 1e-3)
    >>> waves = np.cos(nodes.xy @ omega[0]), np.cos(xy @ omega[0])
    >>> len(nodes.xy) < 40, bool(np.abs(nodes.weights @ waves[0] - waves[1]).max() < 2e-3)
    (True, True)
    """
    middle = xy.mean(axis=0)
    axes = np.linalg.eigh((xy - middle).T @ (xy - middle))[1].T
    along = (xy - middle) @ axes.T
    low, high = along.min(axis=0), along.max(axis=0)
    half = np.maximum(0.5 * (high - low), 1e-6)
    numbers = [_n_needed(half[k] * np.abs(omega @ axes[k]), strengths, tolerance_m, len(xy)) for k in (0, 1)]
    if numbers[0] * numbers[1] >= len(xy):
        return LocalNodes(xy, np.eye(len(xy)))
    scaled = (along - 0.5 * (low + high)) / half
    rows = [_interpolation(scaled[:, k], numbers[k]) for k in (0, 1)]
    weights = (rows[0][:, :, None] * rows[1][:, None, :]).reshape(len(xy), -1)
    unit = [chebyshev.chebpts1(n) for n in numbers]
    nodes = np.stack(np.meshgrid(*unit, indexing="ij"), axis=-1).reshape(-1, 2)
    return LocalNodes(middle + (0.5 * (low + high) + nodes * half) @ axes, weights)


def _n_needed(phase: FloatArray, strengths: FloatArray, tolerance_m: float, most: int) -> int:
    """Return how many nodes a line needs, on whose half waves turn by some phases (K,) [rad]."""
    for n in range(1, most):
        bound = phase**n / (2.0 ** (n - 1) * factorial(n))
        if np.linalg.norm(strengths * bound) <= tolerance_m:
            return n
    return most


def _interpolation(t: FloatArray, n: int) -> FloatArray:
    """Return the weights (P, n) of values at n Chebyshev nodes for places (P,) from -1 to 1."""
    scale = np.full(n, 2.0 / n)
    scale[0] = 1.0 / n
    weights: FloatArray = (chebyshev.chebvander(t, n - 1) * scale) @ chebyshev.chebvander(
        chebyshev.chebpts1(n), n - 1
    ).T
    return weights


KEYFRAMES = 24
"""Keyframes of a segment: the fewer, the more unknowns are left for the end; the more, the dearer each segment."""


class PathSegments(NamedTuple):
    """Unknowns and points in the order of segments.

    `interior` (S - R,) int: unknowns that only one segment touches, segment after segment. `bounds` (n + 1,)
    int: where each segment begins in `interior`. `knots` (R,) int: all other unknowns: poses between
    segments, and what the points of several segments share. `points` (N,) int: points, segment after segment.
    `point_bounds` (n + 1,) int: where each segment begins in `points`.
    """

    interior: IntArray
    bounds: IntArray
    knots: IntArray
    points: IntArray
    point_bounds: IntArray


def path_segments(path: PathError, keyframe: FloatArray, rows: Any, n_common: int = 0) -> PathSegments:
    """Divide a path between knots, so that no segment touches the inside of another.

    `keyframe` (N,): places of the points among the keyframes. `rows` (N, S): derivatives of the points by all
    shared unknowns, those of the path first.

    >>> path = PathError(np.arange(60.0), sparse.identity(360, format="csr"))
    >>> keyframe = np.array([3.0, 30.5])
    >>> found = path_segments(path, keyframe, path.rows(keyframe, np.ones((2, 6))))
    >>> len(found.interior), len(found.knots), found.point_bounds
    (336, 24, array([0, 1, 2, 2]))
    """
    knots = _knots(path)
    segment = np.searchsorted(knots, np.minimum(keyframe.astype(np.int64), len(path) - 2), side="right") - 1
    place = _segment_of_unknowns(path, knots, segment, sparse.coo_array(rows))
    place[path.n_unknowns : path.n_unknowns + n_common] = -1
    order = np.argsort(place, kind="stable")
    n_kept = int((place < 0).sum())
    edges = np.arange(len(knots))
    interior, points = order[n_kept:], np.argsort(segment, kind="stable")
    return PathSegments(
        interior,
        np.searchsorted(place[interior], edges),
        order[:n_kept],
        points,
        np.searchsorted(segment[points], edges),
    )


def _knots(path: PathError) -> IntArray:
    """Return the keyframes between segments: the first, the last, every few, and those of links across."""
    n_keyframes, n_states = len(path), path.n_states
    links = sparse.coo_array(path.information)
    one, other = links.row // n_states, links.col // n_states
    is_far = (np.maximum(one, other) < n_keyframes) & (np.abs(one - other) > 1) & (links.data != 0.0)
    regular = np.arange(0, n_keyframes - 1, KEYFRAMES)
    knots: IntArray = np.unique(np.r_[regular, n_keyframes - 1, one[is_far], other[is_far]])
    return knots


def _segment_of_unknowns(path: PathError, knots: IntArray, segment: IntArray, rows: Any) -> IntArray:
    """Return the segment (S,) that each unknown lies in; -1 for those at knots and those of several segments."""
    place = np.full(rows.shape[1], -1)
    n_of_keyframes = len(path) * path.n_states
    of_keyframe = np.searchsorted(knots, np.arange(len(path)), side="right") - 1
    of_keyframe[knots] = -1
    place[:n_of_keyframes] = np.repeat(of_keyframe, path.n_states)
    is_other = rows.col >= path.n_unknowns
    column, here = rows.col[is_other], segment[rows.row[is_other]]
    lowest = np.full(rows.shape[1], len(knots))
    highest = np.full(rows.shape[1], -1)
    np.minimum.at(lowest, column, here)
    np.maximum.at(highest, column, here)
    return np.where(lowest == highest, lowest, place)


INTERPOLATION_M = 1e-4
"""Standard deviation of the error by which nodes stand for points [m]."""
# Share of a node's variance before the data below which information about it is left out.
_LEAST_INFORMATION = 1e-4


class Reduced(NamedTuple):
    """Information of a segment on knots (by `columns` among them), on its nodes, and on the heights' values."""

    columns: IntArray
    nodes: FloatArray
    information: FloatArray


@dataclass(frozen=True)
class SegmentElimination:
    """Equations of a system in the order of segments."""

    system: JointSystem
    order: PathSegments
    rows: Any
    information: Any

    @classmethod
    def of(cls, system: JointSystem, path: PathError, keyframe: FloatArray) -> "SegmentElimination":
        """Order the equations of a system by segments of the path that its points (N,) were seen from."""
        order = path_segments(path, keyframe, system.rows, system.trend.n_columns)
        unknowns = np.r_[order.interior, order.knots]
        weighted = system.rows[order.points].multiply((1.0 / np.sqrt(system.total_m2[order.points]))[:, None])
        return cls(
            system, order, weighted.tocsr()[:, unknowns], system.information.tocsr()[unknowns][:, unknowns]
        )

    def equations(self) -> JointEquations:
        """Return the normal equations of the waves and the unknowns at knots; all others are eliminated."""
        n_modes, first = self.system.basis.n_modes, len(self.order.interior)
        shared = self.information[first:, first:].toarray()
        coupling, right_shared = np.zeros((len(shared), n_modes)), np.zeros(len(shared))
        right_weights, informative = np.zeros(n_modes), [np.zeros((0, n_modes))]
        for index in range(len(self.order.bounds) - 1):
            columns, nodes, information = self._reduced(index)
            waves, n = waves_at(nodes, self.system.basis, self.system.strengths), len(columns)
            shared[np.ix_(columns, columns)] += information[:n, :n]
            right_shared[columns] += information[:n, -1]
            coupling[columns] += information[:n, n:-1] @ waves
            right_weights += information[n:-1, -1] @ waves
            informative.append(_root(information[n:-1, n:-1], self.system.strengths) @ waves)
        weights = _identity_plus_square(np.concatenate(informative))
        return JointEquations(weights, coupling, shared, right_weights, right_shared)

    def _reduced(self, index: int) -> Reduced:
        """Eliminate what only one segment touches."""
        inside, here = (
            slice(*bounds[index : index + 2]) for bounds in (self.order.bounds, self.order.point_bounds)
        )
        columns = self._touched(inside, here)
        rows, prior = self.rows[here], self.information[inside]
        u, a = rows[:, inside], prior[:, inside]
        nodes, weight = self._nodes(here)
        values = self.system.data.values[self.order.points[here]]
        w = np.column_stack([_dense(rows, columns), weight[:, None] * nodes.weights, weight * values])
        z = u.T @ w
        z[:, : len(columns)] += _dense(prior, columns)
        information = w.T @ w
        if z.size:
            factor = np.linalg.cholesky((a + u.T @ u).toarray())
            through = solve_triangular(factor, z, lower=True, check_finite=False)
            information -= through.T @ through
        return Reduced(columns - len(self.order.interior), nodes.xy, information)

    def _touched(self, inside: slice, here: slice) -> IntArray:
        """Return which columns beyond the interior a segment touches."""
        columns = np.unique(np.r_[self.rows[here].indices, self.information[inside].indices])
        touched: IntArray = columns[columns >= len(self.order.interior)].astype(np.int64)
        return touched

    def _nodes(self, here: slice) -> tuple[LocalNodes, FloatArray]:
        """Return the nodes of a segment, and the inverse standard deviations (P,) of its points [1/m]."""
        points, basis = self.order.points[here], self.system.basis
        weight = 1.0 / np.sqrt(self.system.total_m2[points])
        if len(points) == 0:
            return LocalNodes(np.zeros((0, 2)), np.zeros((0, 0))), weight
        xy = self.system.data.xy[points]
        return local_nodes(xy, basis.omega, self.system.strengths, INTERPOLATION_M), weight


def _dense(block: Any, columns: IntArray) -> FloatArray:
    """Return some columns (n, k), in increasing order, of a few sparse rows (n, S) as a dense matrix."""
    entries = block.tocoo()
    place = np.minimum(np.searchsorted(columns, entries.col), max(len(columns) - 1, 0))
    chosen = columns[place] == entries.col if len(columns) else np.zeros(len(place), dtype=bool)
    dense = np.zeros((block.shape[0], len(columns)))
    dense[entries.row[chosen], place[chosen]] = entries.data[chosen]
    return dense


def _root(information: FloatArray, strengths: FloatArray) -> FloatArray:
    """Return a matrix whose square is an information on nodes, without the directions that nothing is known of."""
    values, vectors = np.linalg.eigh(information)
    kept = values * float(strengths @ strengths) > _LEAST_INFORMATION
    root: FloatArray = np.sqrt(values[kept])[:, None] * vectors[:, kept].T
    return root


def _identity_plus_square(rows: FloatArray) -> FloatArray:
    """Return ``I + RᵀR`` (m, m) of rows (r, m), its lower triangle, in column order."""
    matrix = np.zeros((rows.shape[1], rows.shape[1]), order="F")
    np.fill_diagonal(matrix, 1.0)
    square: FloatArray = blas.dsyrk(1.0, rows.T, 1.0, matrix, lower=1, overwrite_c=1)
    return square


@dataclass(frozen=True)
class _DenseFactor:
    """Cholesky factor of a matrix, to solve with."""

    factor: tuple[FloatArray, bool]

    def solve(self, sides: FloatArray) -> FloatArray:
        """Return the solutions of one or several right-hand sides."""
        solved: FloatArray = cho_solve(self.factor, sides, check_finite=False)
        return solved


def segment_map(
    system: JointSystem, path: PathError, points: SurfacePoints, grid: Grid, nugget_m: float
) -> tuple[FloatArray, FloatArray]:
    """Return height and standard deviation (H, W) [m] on a grid, as one solve of the joint estimate gives them.

    `nugget_m`: standard deviation of relief too fine to be mapped [m].
    """
    assert points.keyframe is not None
    elimination = SegmentElimination.of(system, path, points.keyframe)
    equations = elimination.equations()
    factor = _DenseFactor(cho_factor(equations.shared, lower=True, check_finite=False))
    posterior = JointPosterior.solved(system.basis, system.strengths, equations, factor)
    first = int(np.searchsorted(elimination.order.knots, system.shared.rows.shape[1]))
    finer_m2 = system.tail_m2 + nugget_m**2
    return posterior.terrain(system.trend, first, system.datum_m, finer_m2).fields(grid)


MEMORY_MB = 50.0
"""Memory of the covariance of an update [MB], that of a final map: 2,500 waves."""
_LEAST_SHARED_M = 1e-3


@dataclass(frozen=True)
class LiveMap:
    """Map from a covariance of the terrain that stays as it is between updates.

    `kernel`: covariance of the terrain, as last fitted. `nugget_m`: standard deviation of relief too fine to
    be mapped [m]. `grid`: nodes of the map. `memory_mb`: memory of the covariance [MB]. `prior`: coarse elevations whose
    cells a map from samples takes as measurements.
    """

    kernel: Kernel
    nugget_m: float
    grid: Grid
    memory_mb: float = MEMORY_MB
    prior: Dem | None = None

    def of_landmarks(self, points: SurfacePoints, path: PathError) -> tuple[FloatArray, FloatArray]:
        """Return height and standard deviation (H, W) [m] from landmarks and the error of their path."""
        terrain = self._terrain(path, JointConfig())
        start = terrain.from_points(points, self.grid.bounds)
        found, memory_mb = start.candidates[0], self.memory_mb
        system = terrain.builder.build(points, self.grid.bounds, found, start.slope, memory_mb=memory_mb)
        return segment_map(system, path, points, self.grid, self.nugget_m)

    def of_samples(
        self, xyz: FloatArray, sigma_m: FloatArray, shared_m: float = 0.0
    ) -> tuple[FloatArray, FloatArray]:
        """Return height and standard deviation (H, W) [m] from samples that share one error of height.

        `xyz` (N, 3): easting, northing, height [m]. `sigma_m` (N,): standard deviation of each height [m].
        `shared_m`: standard deviation of the error that all heights share [m].
        """
        own = np.zeros((len(xyz), 3, 3))
        own[:, 2, 2] = sigma_m**2
        shared = np.zeros((3, 3))
        shared[2, 2] = shared_m**2
        points = SurfacePoints(
            xyz,
            own + shared,
            crs=self.grid.crs,
            own_covariance=own,
            keyframe=np.zeros(len(xyz)),
            heading_rad=np.zeros(len(xyz)),
            body=xyz,
        )
        joint = JointConfig(
            memory_mb=self.memory_mb, slope_passes=1, far_bias_sigma_m=0.0, landmark_shared_sigma_m=0.0
        )
        terrain = self._terrain(_one_offset(max(shared_m, _LEAST_SHARED_M)), joint)
        return terrain.solve(points, self.grid.bounds).terrain.fields(self.grid)

    def _terrain(self, path: PathError, joint: JointConfig) -> JointTerrain:
        config = GaussianProcessConfig(fit=False, kernel=self.kernel, nugget_m=self.nugget_m, mean="plane")
        return JointTerrain(path, self.prior, config, joint)


def _one_offset(sigma_m: float) -> PathError:
    """Return the error of a path that is an offset of height [m], the same at its two keyframes."""
    exact = 1.0 / _LEAST_SHARED_M**2
    diagonal = np.tile([exact, exact, 1.0 / sigma_m**2, 1.0, 1.0, 1.0], 2)
    assert len(diagonal) == 2 * POSE
    return PathError(np.array([0.0, 1.0]), sparse.csr_array(sparse.diags_array(diagonal)))
