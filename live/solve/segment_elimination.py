r"""Elimination of what only one segment of a path touches, from the points that were seen along it.

Of a segment let u be the unknowns inside it, b those around it that it touches, and t the heights of the ground at its
nodes. Its points are ``z = C t + U u + V b + ε``; with the prior information A of u and F between u and b the rest of
the equations knows of it

.. math::  W^T N^{-1} W - Z^T (A + U^T N^{-1} U)^{-1} Z, \qquad W = [V, C, z], \qquad Z = U^T N^{-1} W + [F, 0, 0]
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import blas, solve_triangular

from live.solve.local_nodes import LocalNodes, local_nodes
from live.solve.path_segments import PathSegments, path_segments
from survey.core.arrays import FloatArray, IntArray
from survey.data.path_error import PathError
from survey.reconstruction.joint.normal_equations import JointEquations, JointSystem, waves_at

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
