r"""Solvers for the linear systems of a lattice: conjugate gradients, one-sided constraints, and band Cholesky.

The energy of heights z on a lattice is quadratic,

.. math::  E(z) = \tfrac12 z^T A z - b^T z, \qquad A = S + \alpha P + \beta L + \epsilon I

with the data stencil S, the thin plate P, the membrane (lattice Laplacian) L and a mass. `solve` finds its minimum by
conjugate gradients with a multigrid preconditioner, in a number of steps that hardly grows with the lattice.

`solve_below` keeps the surface below a ceiling c, by a one-sided spring at every node over which rays passed:

.. math::  \min_z \; \tfrac12 z^T A z - b^T z + \rho \sum_i h(z_i - c_i), \qquad
           h(v) = \begin{cases} 0 & v \le 0 \\ v^2 / 2 & v \le v_0 \\ v_0 v - v_0^2 / 2 & v > v_0 \end{cases}

Every step of a semi-smooth Newton method (Hintermüller, Ito and Kunisch 2002) takes the nodes above the ceiling as
active, and solves for all, until the active set repeats. Springs that are stretched beyond v₀ pull no harder (Huber's
loss, by reweighting): where points contradict a ceiling, the points win.

Small lattices are solved exactly: `band_of` writes the operator as a band matrix, whose Cholesky factor gives the
determinant and the diagonal of the inverse.
"""

from functools import cache
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.linalg import cholesky_banded
from threadpoolctl import ThreadpoolController

from survey.core import FloatArray, InputError
from survey.reconstruction.lattice.multigrid import Operator, conjugate_gradients, cycle, hierarchy, workspace


class Rim(NamedTuple):
    """Nodes with fixed heights: numbers of rows in the south and north, and of columns in the west and east."""

    south: int = 0
    north: int = 0
    west: int = 0
    east: int = 0


FREE = Rim()
"""No node is fixed."""


class VCyclePreconditioner:
    """One V-cycle as an approximate inverse, symmetric and positive definite.

    `operator`: the finest level. `rim`: nodes with fixed heights.
    """

    def __init__(self, operator: Operator, rim: Rim = FREE) -> None:
        self.operator = operator
        self.levels = hierarchy(operator, (rim.south, rim.north, rim.west, rim.east))

    def __call__(self, residual: FloatArray) -> FloatArray:
        """Return roughly A⁻¹ times a residual."""
        z = np.zeros_like(residual)
        cycle(self.operator, self.levels, residual, z, workspace(self.levels.shapes))
        return z


class Solution(NamedTuple):
    """Heights (H, W), and the number of iterations they took."""

    z: FloatArray
    n_iterations: int


def solve(
    operator: Operator,
    rhs: FloatArray,
    start: FloatArray,
    *,
    tolerance: float = 1e-2,
    preconditioner: VCyclePreconditioner | None = None,
    max_iterations: int = 300,
) -> Solution:
    r"""Solve ``A z = rhs`` by preconditioned conjugate gradients.

    `rhs`, `start` (H, W): right-hand side, and where to begin.

    >>> data = np.zeros((1, 5, 5))
    >>> data[0, 2, 2] = 1.0
    >>> springs = Operator(data, (0.0, 1.0, 0.0))
    >>> float(solve(springs, 3.0 * data[0], np.zeros((5, 5)), tolerance=1e-9).z[0, 0].round(6))
    3.0
    """
    if not operator.shape == rhs.shape == start.shape:
        raise ValueError(f"shapes differ: operator {operator.shape}, rhs {rhs.shape}, start {start.shape}")
    by = preconditioner or VCyclePreconditioner(operator)
    until = (tolerance, max_iterations)
    return Solution(*conjugate_gradients(operator, by.levels, rhs, start, until))


_MAX_NEWTON_STEPS = 40
# Until the same nodes touch again, a solution need not be as good.
_EARLY_TOLERANCE_FACTOR = 5.0


class Ceiling(NamedTuple):
    """What a surface is not to rise above.

    `height` (H, W): c; infinite where there is none [m]. `spring`: ρ: how hard it is, its inverse variance in
    units of A [1/m²]. `yield_m`: v₀: the stretch beyond which a spring pulls no harder [m].
    """

    height: FloatArray
    spring: float
    yield_m: float = np.inf

    def pull(self, z: FloatArray) -> FloatArray:
        """Return the weight (H, W) of every node's spring, 0 where the surface is below the ceiling [1/m²]."""
        stretch = z - self.height
        touching = stretch > 0.0
        return np.where(
            touching, self.spring * np.minimum(1.0, self.yield_m / np.where(touching, stretch, 1.0)), 0.0
        )


def solve_below(
    operator: Operator,
    rhs: FloatArray,
    start: FloatArray,
    ceiling: Ceiling,
    *,
    tolerance: float = 1e-2,
    rim: Rim = FREE,
) -> Solution:
    """Return the surface of least energy that springs hold below a ceiling.

    `rhs`, `start` (H, W): right-hand side b, and where to begin: best the solution without ceiling.

    A sheet held at 1 m by its western edge, below a ceiling at 0.5 m in the east:

    >>> data = np.zeros((1, 4, 4))
    >>> data[0, :, 0] = 100.0
    >>> sheet = Operator(data, (0.0, 1.0, 0.0))
    >>> low = np.full((4, 4), np.inf)
    >>> low[:, 3] = 0.5
    >>> solve_below(sheet, data[0], np.ones((4, 4)), Ceiling(low, 1e4), tolerance=1e-9).z[0].round(2)
    array([1.  , 0.83, 0.67, 0.5 ])
    """
    level = np.where(np.isfinite(ceiling.height), ceiling.height, 0.0)
    z, n_iterations = start, 0
    # At first all springs pull as they like: a soft surface far above its ceiling is no contradiction.
    pull = foreseen = ceiling._replace(yield_m=np.inf).pull(z)
    by = VCyclePreconditioner(_with_springs(operator, foreseen), rim)
    allowed = _EARLY_TOLERANCE_FACTOR * tolerance
    for _ in range(_MAX_NEWTON_STEPS):
        z, n = solve(
            _with_springs(operator, pull), rhs + pull * level, z, tolerance=allowed, preconditioner=by
        )
        n_iterations += n
        before, pull = pull, ceiling.pull(z)
        if (np.abs(pull - before) <= tolerance * np.minimum(pull, before)).all():
            if allowed == tolerance:
                break
            allowed = tolerance
        # A preconditioner made for stronger springs still serves; for weaker ones it could fail.
        if (pull > foreseen).any():
            foreseen = np.maximum(pull, foreseen)
            by = VCyclePreconditioner(_with_springs(operator, foreseen), rim)
    return Solution(z, n_iterations)


def _with_springs(operator: Operator, pull: FloatArray) -> Operator:
    stencil = operator.stencil.copy()
    stencil[0] += pull
    return Operator(stencil, operator.weights, operator.soft)


# Couplings reach two nodes in every direction.
_REACH = 2


def band_of(operator: Operator) -> FloatArray:
    """Return the lower band (bandwidth + 1, n) of the operator, row by row of the lattice.

    The operator is applied to grids of ones five nodes apart, which do not meet.
    """
    rows, columns = operator.shape
    n, spacing = rows * columns, 2 * _REACH + 1
    band = np.zeros((_REACH * columns + 1, n))
    node = np.arange(n).reshape(rows, columns)
    for a in range(spacing):
        for b in range(spacing):
            ones = np.zeros((rows, columns))
            ones[a::spacing, b::spacing] = 1.0
            image = operator.apply(ones)
            for up in range(_REACH + 1):
                for right in range(-_REACH if up else 0, _REACH + 1):
                    if abs(up) + abs(right) > _REACH:
                        continue
                    j, i = np.arange(a, rows - up, spacing), np.arange(b, columns, spacing)
                    i = i[(i + right >= 0) & (i + right < columns)]
                    there = image[np.ix_(j + up, i + right)]
                    band[up * columns + right, node[np.ix_(j, i)]] = there
    return band


@cache
def _blas() -> ThreadpoolController:
    """Return the BLAS of SciPy, found once: the search takes longer than a factor of 1,024 nodes."""
    return ThreadpoolController()


def band_cholesky(band: FloatArray) -> FloatArray:
    """Return the Cholesky factor in the same lower band form; the same bytes whatever the number of threads."""
    with _blas().limit(limits=1, user_api="blas"):
        try:
            factor: FloatArray = cholesky_banded(band, lower=True, check_finite=False)
        except np.linalg.LinAlgError as error:
            raise InputError(
                f"the surface is not determined by its points ({error}); add points or a finite range."
            ) from error
    return factor


def log_determinant(factor: FloatArray) -> float:
    """Return log det A from its band Cholesky factor."""
    return 2.0 * float(np.log(factor[0]).sum())


@njit(cache=True, fastmath=True)
def inverse_diagonal(factor: FloatArray) -> FloatArray:
    """Return the diagonal of A⁻¹ from the band Cholesky factor of A, by Takahashi's recursion.

    `known` holds A⁻¹ between the latest `width` nodes, each in the place of its number modulo `width`.
    """
    width, n = factor.shape[0] - 1, factor.shape[1]
    known = np.zeros((width, width))
    below, column = np.zeros(width), np.zeros(width)
    diagonal = np.zeros(n)
    for j in range(n - 1, -1, -1):
        for d in range(1, width + 1):
            below[(j + d) % width] = factor[d, j] / factor[0, j] if j + d < n else 0.0
        own = 1.0 / factor[0, j] ** 2
        for a in range(width):
            total = 0.0
            for b in range(width):
                total += known[a, b] * below[b]
            column[a] = -total
        for a in range(width):
            own -= below[a] * column[a]
        here = j % width
        column[here] = own
        for a in range(width):
            known[a, here] = column[a]
            known[here, a] = column[a]
        diagonal[j] = own
    return diagonal


def exact_variance(operator: Operator) -> FloatArray:
    """Return the diagonal of A⁻¹ on the nodes (H, W)."""
    return inverse_diagonal(band_cholesky(band_of(operator))).reshape(operator.shape)
