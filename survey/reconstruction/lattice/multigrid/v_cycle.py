"""The V-cycle and the conjugate gradients, compiled.

Each level has every second node of the one before, and the data that the same points would
have left there. Levels lie one behind the other in flat arrays.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from survey.core.arrays import FloatArray, IntArray
from survey.reconstruction.lattice.multigrid.coarsening import (
    add_prolonged,
    cholesky,
    coarsen_stencil,
    coarsened_factors,
    dense,
    dot,
    restrict,
    solve_triangles,
)
from survey.reconstruction.lattice.multigrid.stencil import Weights, apply, lumped, prior_diagonal

_N_COARSEST = 64
# Largest eigenvalue of a plate or membrane beside its diagonal: 64 / 20, and 4 with factors on the curvatures.
_SPECTRUM, _SPECTRUM_OF_FACTORS = 3.2, 4.0
# The smoother damps the upper part of the spectrum, which coarser grids cannot hold, by Chebyshev's steps.
_SMOOTHED_FROM = 1.0 / 20.0
_STEPS = tuple(
    1.0 / (0.5 * (1.0 + _SMOOTHED_FROM) + 0.5 * (1.0 - _SMOOTHED_FROM) * np.cos(angle))
    for angle in (np.pi / 4.0, 3.0 * np.pi / 4.0)
)
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
def _grid(flat: FloatArray, shapes: IntArray, k: int) -> FloatArray:
    """Return one level of a flat array."""
    start = 0
    for m in range(k):
        start += shapes[m, 0] * shapes[m, 1]
    rows, columns = shapes[k]
    return flat[start : start + rows * columns].reshape((rows, columns))


@njit(cache=True, inline="always")
def _stencil(flat: FloatArray, shapes: IntArray, k: int) -> FloatArray:
    """Return the data stencil of one level but the finest."""
    start = 0
    for m in range(1, k):
        start += 5 * shapes[m, 0] * shapes[m, 1]
    rows, columns = shapes[k]
    return flat[start : start + 5 * rows * columns].reshape((5, rows, columns))


@njit(cache=True, inline="always")
def _factors(flat: FloatArray, shapes: IntArray, k: int) -> FloatArray:
    """Return one level of the factors on the curvatures, or none."""
    if len(flat) == 0:
        return np.zeros((0, 0, 0))
    start = 0
    for m in range(k):
        start += 3 * shapes[m, 0] * shapes[m, 1]
    rows, columns = shapes[k]
    return flat[start : start + 3 * rows * columns].reshape((3, rows, columns))


@njit(cache=True, inline="always")
def _coarser_weights(weights: Weights, k: int) -> Weights:
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
            coarsen_stencil(held, stencil, _stencil(data, shapes, 1))
        elif k > 1:
            finer = _stencil(data, shapes, k - 1)
            coarsen_stencil(finer[0], finer, _stencil(data, shapes, k))
        if soft.shape[0]:
            here = soft if k == 0 else coarsened_factors(here)
            _factors(factors, shapes, k)[:] = here
        own = lumped(stencil) if k == 0 else lumped(_stencil(data, shapes, k))
        shape = (shapes[k, 0], shapes[k, 1])
        bound = own + spectrum * prior_diagonal(_coarser_weights(weights, k), here, shape)
        if k == 0 and rim[0] + rim[1] + rim[2] + rim[3] > 0:
            free = np.ones(shape)
            clear(free, rim)
            held += _HEAVY * bound.max() * (1.0 - free)
            bound = np.where(free > 0.0, bound, np.inf)
        _grid(inverse_bound, shapes, k)[:] = 1.0 / bound
    deepest = stencil if last == 0 else _stencil(data, shapes, last)
    matrix = dense(deepest, _coarser_weights(weights, last), _factors(factors, shapes, last))
    return data, factors, inverse_bound, cholesky(matrix)


@njit(cache=True, inline="always")
def _relax(step: float, inverse: FloatArray, rhs: FloatArray, applied: FloatArray, z: FloatArray) -> None:
    for j in range(z.shape[0]):
        for i in range(z.shape[1]):
            z[j, i] += step * inverse[j, i] * (rhs[j, i] - applied[j, i])


@njit(cache=True)
def _apply_at(k: int, operator: Operator, levels: Hierarchy, z: FloatArray, out: FloatArray) -> None:
    """Apply the operator of one level."""
    if k == 0:
        apply(operator.stencil, operator.weights, operator.soft, z, out)
    else:
        data = _stencil(levels.data, levels.shapes, k)
        soft = _factors(levels.soft, levels.shapes, k)
        apply(data, _coarser_weights(operator.weights, k), soft, z, out)


@njit(cache=True)
def _descend(k: int, operator: Operator, levels: Hierarchy, room: Rooms) -> None:
    """Smooth one level from nothing, and hand its residual to the next coarser one."""
    shapes = levels.shapes
    rhs, z, work = _grid(room[0], shapes, k), _grid(room[1], shapes, k), _grid(room[2], shapes, k)
    inverse = _grid(levels.inverse_bound, shapes, k)
    for j in range(z.shape[0]):
        for i in range(z.shape[1]):
            z[j, i] = _STEPS[0] * inverse[j, i] * rhs[j, i]
    _apply_at(k, operator, levels, z, work)
    _relax(_STEPS[1], inverse, rhs, work, z)
    _apply_at(k, operator, levels, z, work)
    for j in range(z.shape[0]):
        for i in range(z.shape[1]):
            work[j, i] = rhs[j, i] - work[j, i]
    if k == 0:
        clear(work, levels.rim)
    restrict(work, _grid(room[0], shapes, k + 1))


@njit(cache=True)
def _ascend(k: int, operator: Operator, levels: Hierarchy, room: Rooms) -> None:
    """Take in the coarser level's correction, and smooth in reverse order."""
    shapes = levels.shapes
    rhs, z, work = _grid(room[0], shapes, k), _grid(room[1], shapes, k), _grid(room[2], shapes, k)
    inverse = _grid(levels.inverse_bound, shapes, k)
    add_prolonged(_grid(room[1], shapes, k + 1), z)
    if k == 0:
        clear(z, levels.rim)
    _apply_at(k, operator, levels, z, work)
    _relax(_STEPS[1], inverse, rhs, work, z)
    _apply_at(k, operator, levels, z, work)
    _relax(_STEPS[0], inverse, rhs, work, z)


@njit(cache=True)
def cycle(
    operator: Operator, levels: Hierarchy, residual: FloatArray, result: FloatArray, room: Rooms
) -> None:
    """Set `result` to one V-cycle: down to the coarsest level, solved exactly, and up again."""
    shapes = levels.shapes
    last = len(shapes) - 1
    _grid(room[0], shapes, 0)[:] = residual
    for k in range(last):
        _descend(k, operator, levels, room)
    _grid(room[1], shapes, last)[:] = solve_triangles(levels.coarsest, _grid(room[0], shapes, last))
    for k in range(last - 1, -1, -1):
        _ascend(k, operator, levels, room)
    result[:] = _grid(room[1], shapes, 0)
    clear(result, levels.rim)


@njit(cache=True)
def _advance(
    step: float, direction: FloatArray, applied: FloatArray, z: FloatArray, residual: FloatArray
) -> None:
    for j in range(z.shape[0]):
        for i in range(z.shape[1]):
            z[j, i] += step * direction[j, i]
            residual[j, i] -= step * applied[j, i]


@njit(cache=True)
def conjugate_gradients(
    operator: Operator, levels: Hierarchy, rhs: FloatArray, start: FloatArray, until: tuple[float, int]
) -> tuple[FloatArray, int]:
    """Return the solution and the number of iterations; `until` are tolerance and most iterations."""
    tolerance, max_iterations = until
    room = rooms(levels.shapes)
    z, work, correction = start.copy(), np.empty_like(rhs), np.empty_like(rhs)
    apply(operator.stencil, operator.weights, operator.soft, z, work)
    residual = rhs - work
    clear(residual, levels.rim)
    cycle(operator, levels, residual, correction, room)
    direction = correction.copy()
    squared = dot(residual, correction)
    n_iterations = 0
    while squared > tolerance**2 and n_iterations < max_iterations:
        apply(operator.stencil, operator.weights, operator.soft, direction, work)
        clear(work, levels.rim)
        _advance(squared / dot(direction, work), direction, work, z, residual)
        cycle(operator, levels, residual, correction, room)
        before, squared = squared, dot(residual, correction)
        for j in range(direction.shape[0]):
            for i in range(direction.shape[1]):
                direction[j, i] = correction[j, i] + squared / before * direction[j, i]
        n_iterations += 1
    return z, n_iterations
