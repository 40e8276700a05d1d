"""Levels of the multigrid solver: operator, hierarchy, and the arrays of all levels."""

from typing import NamedTuple

import numpy as np
from numba import njit

from survey.core.arrays import FloatArray, IntArray
from survey.reconstruction.lattice.multigrid.coarsening import (
    cholesky,
    coarsen_stencil,
    coarsened_factors,
    copy,
    dense,
)
from survey.reconstruction.lattice.multigrid.plate_prior import Weights
from survey.reconstruction.lattice.multigrid.stencil import apply, lumped, prior_diagonal

_N_COARSEST = 64


# Largest eigenvalue of a plate or membrane beside its diagonal: 64 / 20, and 4 with factors on the curvatures.
_SPECTRUM, _SPECTRUM_OF_FACTORS = 3.2, 4.0


_HEAVY = 1e3


RimCounts = tuple[int, int, int, int]


class Operator(NamedTuple):
    """The matrix A of a lattice's energy.

    Parameters
    ----------
    stencil : (5, H, W) or (1, H, W) ndarray
        What the data hold [1/m²]: couplings of nine neighbours, or of single nodes.
    weights : tuple of float
        Of thin plate, springs between neighbours, and height itself [1/m²].
    soft : (3, H, W) ndarray
        Factors on the curvatures east, north and twist; empty when all are 1.
    """

    stencil: FloatArray
    weights: Weights
    soft: FloatArray = np.zeros((0, 0, 0))

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the lattice."""
        _, rows, columns = self.stencil.shape
        return rows, columns

    def apply(self, z: FloatArray) -> FloatArray:
        """Return A z."""
        result = np.empty_like(z)
        apply(self.stencil, self.weights, self.soft, z, result)
        return result

    def dense(self) -> FloatArray:
        """Return A as a dense matrix (H W, H W)."""
        return dense(self.stencil, self.weights, self.soft)


class Hierarchy(NamedTuple):
    """All levels: their shapes, data, factors and smoothers, the coarsest one's Cholesky factor, and the rim."""

    shapes: IntArray
    data: FloatArray
    soft: FloatArray
    inverse_bound: FloatArray
    coarsest: FloatArray
    rim: RimCounts


Rooms = tuple[FloatArray, FloatArray, FloatArray]
"""Right-hand sides, heights and residuals of all levels: where a V-cycle writes."""


def level_shapes(rows: int, columns: int) -> IntArray:
    """Return rows and columns of every level (L, 2), the finest first."""
    shapes = [(rows, columns)]
    while rows * columns > _N_COARSEST:
        rows, columns = rows // 2 + 1, columns // 2 + 1
        shapes.append((rows, columns))
    return np.array(shapes, dtype=np.int64)


def hierarchy(operator: Operator, rim: RimCounts) -> Hierarchy:
    """Return all levels of an operator."""
    shapes = level_shapes(*operator.shape)
    return Hierarchy(shapes, *_built(operator, shapes, rim), rim)


@njit(cache=True)
def rooms(shapes: IntArray) -> Rooms:
    """Return room for one V-cycle."""
    n = 0
    for k in range(len(shapes)):
        n += shapes[k, 0] * shapes[k, 1]
    return np.empty(n), np.empty(n), np.empty(n)


@njit(cache=True, inline="always")
def level_grid(flat: FloatArray, shapes: IntArray, k: int) -> FloatArray:
    """Return one level of a flat array."""
    start = 0
    for m in range(k):
        start += shapes[m, 0] * shapes[m, 1]
    rows, columns = shapes[k]
    return flat[start : start + rows * columns].reshape((rows, columns))


@njit(cache=True, inline="always")
def level_stencil(flat: FloatArray, shapes: IntArray, k: int) -> FloatArray:
    """Return the data stencil of one level but the finest."""
    start = 0
    for m in range(1, k):
        start += 5 * shapes[m, 0] * shapes[m, 1]
    rows, columns = shapes[k]
    return flat[start : start + 5 * rows * columns].reshape((5, rows, columns))


@njit(cache=True, inline="always")
def level_factors(flat: FloatArray, shapes: IntArray, k: int) -> FloatArray:
    """Return one level of the factors on the curvatures, or none."""
    if len(flat) == 0:
        return np.zeros((0, 0, 0))
    start = 0
    for m in range(k):
        start += 3 * shapes[m, 0] * shapes[m, 1]
    rows, columns = shapes[k]
    return flat[start : start + 3 * rows * columns].reshape((3, rows, columns))


@njit(cache=True, inline="always")
def coarser_weights(weights: Weights, k: int) -> Weights:
    """Return the weights on a lattice with 2ᵏ times the step."""
    quarter = 0.25**k
    return weights[0] * quarter, weights[1], weights[2] / quarter


@njit(cache=True)
def clear(array: FloatArray, rim: RimCounts) -> None:
    """Set the rim of an array (H, W) to 0."""
    rows, columns = array.shape
    array[: rim[0]] = 0.0
    array[rows - rim[1] :] = 0.0
    array[:, : rim[2]] = 0.0
    array[:, columns - rim[3] :] = 0.0


@njit(cache=True)
def _hold_rim(rim: RimCounts, held: FloatArray, bound: FloatArray) -> None:
    """Give the nodes of a rim a great weight, and no step of the smoother."""
    free, weight = np.ones(bound.shape), _HEAVY * bound.max()
    clear(free, rim)
    for j in range(bound.shape[0]):
        for i in range(bound.shape[1]):
            held[j, i] += weight * (1.0 - free[j, i])
            if free[j, i] <= 0.0:
                bound[j, i] = np.inf


@njit(cache=True)
def _built(
    operator: Operator, shapes: IntArray, rim: RimCounts
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return data, factors, smoother and coarsest factor of all levels; a rim that is held gets a great weight."""
    stencil, weights, soft = operator
    n, last = 0, len(shapes) - 1
    for k in range(len(shapes)):
        n += shapes[k, 0] * shapes[k, 1]
    inverse_bound = np.empty(n)
    data = np.empty(5 * (n - shapes[0, 0] * shapes[0, 1]))
    factors = np.empty(3 * n if soft.shape[0] else 0)
    spectrum = _SPECTRUM_OF_FACTORS if soft.shape[0] else _SPECTRUM
    here, held = soft, stencil[0].copy()
    for k in range(len(shapes)):
        if k == 1:
            coarsen_stencil(held, stencil, level_stencil(data, shapes, 1))
        elif k > 1:
            finer = level_stencil(data, shapes, k - 1)
            coarsen_stencil(finer[0], finer, level_stencil(data, shapes, k))
        if soft.shape[0]:
            here = soft if k == 0 else coarsened_factors(here)
            for layer in range(3):
                copy(here[layer], level_factors(factors, shapes, k)[layer])
        own = lumped(stencil) if k == 0 else lumped(level_stencil(data, shapes, k))
        shape = (shapes[k, 0], shapes[k, 1])
        prior = prior_diagonal(coarser_weights(weights, k), here, shape)
        inverse = level_grid(inverse_bound, shapes, k)
        for j in range(shape[0]):
            for i in range(shape[1]):
                own[j, i] += spectrum * prior[j, i]
        if k == 0 and rim[0] + rim[1] + rim[2] + rim[3] > 0:
            _hold_rim(rim, held, own)
        for j in range(shape[0]):
            for i in range(shape[1]):
                inverse[j, i] = np.divide(1.0, own[j, i])
    deepest = stencil if last == 0 else level_stencil(data, shapes, last)
    matrix = dense(deepest, coarser_weights(weights, last), level_factors(factors, shapes, last))
    return data, factors, inverse_bound, cholesky(matrix)
