r"""Conjugate gradients with a multigrid preconditioner, for every surface made of springs and plates.

The energy of heights z on a lattice is quadratic,

.. math::  E(z) = \tfrac12 z^T A z - b^T z, \qquad A = S + \alpha P + \beta L + \epsilon I

with the data stencil S, the thin plate P, the membrane (lattice Laplacian) L and a mass. Its
minimum is found in a number of steps that hardly grows with the lattice.
"""

from dataclasses import dataclass, field
from typing import NamedTuple, Self

import numpy as np

from survey.arrays import FloatArray
from survey.reconstruction import lattice_stencil as kernel

_N_COARSEST = 64
# The smoother damps the upper share of the spectrum, which coarser grids cannot hold.
_SMOOTHED_FROM = 1.0 / 14.0
_N_SMOOTHING = 2
# Largest eigenvalue of a plate or membrane beside its diagonal: 64 / 20, and 4 with factors on the curvatures.
_SPECTRUM, _SPECTRUM_OF_FACTORS = 3.2, 4.0
_NO_FACTORS = np.zeros((0, 0, 0))


@dataclass(frozen=True)
class Operator:
    """The matrix A of a lattice's energy.

    Parameters
    ----------
    stencil : (5, H, W) or (1, H, W) ndarray
        What the data hold [1/m²]: couplings of nine neighbours, or of single nodes.
    plate, membrane, mass : float
        Weights of thin plate, springs between neighbours, and height itself [1/m²].
    soft : (3, H, W) ndarray
        Factors on the curvatures east, north and twist; empty when all are 1.
    """

    stencil: FloatArray
    plate: float
    membrane: float
    mass: float
    soft: FloatArray = field(default_factory=lambda: _NO_FACTORS)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the lattice."""
        _, rows, columns = self.stencil.shape
        return rows, columns

    def apply(self, z: FloatArray, out: FloatArray | None = None) -> FloatArray:
        """Return A z."""
        result = np.empty_like(z) if out is None else out
        kernel.apply(self.stencil, self.plate, self.membrane, self.mass, self.soft, z, result)
        return result

    def bound(self) -> FloatArray:
        """Return a diagonal M with A ≤ M: what the smoother divides by."""
        prior = kernel.prior_diagonal(self.plate, self.membrane, self.mass, self.soft, self.shape)
        spectrum = _SPECTRUM_OF_FACTORS if self.soft.size else _SPECTRUM
        total: FloatArray = spectrum * prior + kernel.lumped(self.stencil)
        return total

    def coarser(self) -> Self:
        """Return the operator of the lattice with every second node."""
        stencil = kernel.restricted(kernel.lumped(self.stencil))[None]
        soft = kernel.coarsened_factors(self.soft) if self.soft.size else self.soft
        return type(self)(stencil, self.plate / 4.0, self.membrane, 4.0 * self.mass, soft)

    def dense(self) -> FloatArray:
        """Return A as a dense matrix (H W, H W)."""
        return kernel.dense(self.stencil, self.plate, self.membrane, self.mass, self.soft)


class Multigrid:
    """One V-cycle as an approximate inverse, symmetric and positive definite.

    Parameters
    ----------
    operator : Operator
        The finest level.
    rim : (4,) tuple of int
        Rows in the south and north, columns in the west and east that are held fixed.
    """

    def __init__(self, operator: Operator, rim: "Rim") -> None:
        self._levels = [operator if not any(rim) else _held(operator, rim)]
        while np.prod(self._levels[-1].shape) > _N_COARSEST:
            self._levels.append(self._levels[-1].coarser())
        self._inverse_bounds = [1.0 / level.bound() for level in self._levels[:-1]]
        self._coarsest = kernel.cholesky(self._levels[-1].dense())

    def __call__(self, residual: FloatArray) -> FloatArray:
        """Return roughly A⁻¹ times a residual."""
        return self._cycle(residual, 0)

    def _cycle(self, rhs: FloatArray, k: int) -> FloatArray:
        if k == len(self._levels) - 1:
            return kernel.solve_triangles(self._coarsest, rhs)
        level, inverse_bound = self._levels[k], self._inverse_bounds[k]
        z = _OMEGA[0] * inverse_bound * rhs
        work = np.empty_like(rhs)
        for omega in _OMEGA[1:]:
            kernel.relax(omega, inverse_bound, rhs, level.apply(z, work), z)
        np.subtract(rhs, level.apply(z, work), out=work)
        kernel.add_prolonged(self._cycle(kernel.restricted(work), k + 1), z)
        for omega in reversed(_OMEGA):
            kernel.relax(omega, inverse_bound, rhs, level.apply(z, work), z)
        return z


class Rim(NamedTuple):
    """How many rows in the south and north, and columns in the west and east, are held fixed."""

    south: int = 0
    north: int = 0
    west: int = 0
    east: int = 0

    def clear(self, array: FloatArray) -> FloatArray:
        """Set the rim of an array (H, W) to 0, in place, and return it."""
        rows, columns = array.shape
        array[: self.south] = 0.0
        array[rows - self.north :] = 0.0
        array[:, : self.west] = 0.0
        array[:, columns - self.east :] = 0.0
        return array


class Solution(NamedTuple):
    """Heights (H, W), and the number of iterations they took."""

    z: FloatArray
    n_iterations: int


def solve(
    operator: Operator,
    rhs: FloatArray,
    start: FloatArray,
    *,
    tolerance: float = 1e-3,
    rim: Rim = Rim(),  # noqa: B008  (a NamedTuple does not change)
    multigrid: Multigrid | None = None,
    max_iterations: int = 300,
) -> Solution:
    r"""Solve ``A z = rhs`` by preconditioned conjugate gradients.

    Parameters
    ----------
    operator : Operator
        The matrix A.
    rhs, start : (H, W) ndarray
        Right-hand side, and where to begin.
    tolerance : float
        The iteration ends when no node is farther from the solution than this many of its
        own posterior standard deviations: for any vector e,
        :math:`|e_i| \le \sqrt{(A^{-1})_{ii}} \, \|e\|_A`, and :math:`\|e\|_A` is measured by the
        preconditioned residual, which is exact as far as the V-cycle is the inverse.
    rim : Rim
        Nodes at the edge that keep their starting value.
    multigrid : Multigrid, optional
        The preconditioner, where one is at hand.
    max_iterations : int
        When to give up.

    Returns
    -------
    Solution
        Heights and number of iterations.
    """
    precondition = multigrid or Multigrid(operator, rim)
    z = start.copy()
    work = operator.apply(z)
    residual = rim.clear(rhs - work)
    direction = rim.clear(precondition(residual))
    correction = direction
    squared = kernel.dot(residual, correction)
    n = 0
    while squared > tolerance**2 and n < max_iterations:
        rim.clear(operator.apply(direction, work))
        step = squared / kernel.dot(direction, work)
        kernel.advance(step, direction, work, z, residual)
        correction = rim.clear(precondition(residual))
        before, squared = squared, kernel.dot(residual, correction)
        kernel.turn(squared / before, correction, direction)
        n += 1
    return Solution(z, n)


def _held(operator: Operator, rim: Rim) -> Operator:
    """Return the operator with a weight on the rim that keeps it where it is, on every level."""
    stencil = operator.stencil.copy()
    heavy = 1e3 * float(operator.bound().max())
    free = rim.clear(np.ones(operator.shape))
    stencil[kernel.OWN] += heavy * (1.0 - free)
    return Operator(stencil, operator.plate, operator.membrane, operator.mass, operator.soft)


def _chebyshev(n: int) -> tuple[float, ...]:
    """Return the step lengths that damp the upper spectrum of M⁻¹A, within (0, 1], best in n steps."""
    middle, half = 0.5 * (1.0 + _SMOOTHED_FROM), 0.5 * (1.0 - _SMOOTHED_FROM)
    angles = np.pi * (2 * np.arange(n) + 1) / (2 * n)
    return tuple((1.0 / (middle + half * np.cos(angles))).tolist())


_OMEGA = _chebyshev(_N_SMOOTHING)
