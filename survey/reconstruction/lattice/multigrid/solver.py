r"""Conjugate gradients with a multigrid preconditioner, for every surface made of springs and plates.

The energy of heights z on a lattice is quadratic,

.. math::  E(z) = \tfrac12 z^T A z - b^T z, \qquad A = S + \alpha P + \beta L + \epsilon I

with the data stencil S, the thin plate P, the membrane (lattice Laplacian) L and a mass. Its
minimum is found in a number of steps that hardly grows with the lattice.
"""

from typing import NamedTuple

import numpy as np

from survey.core.arrays import FloatArray
from survey.reconstruction.lattice.multigrid import v_cycle as multigrid
from survey.reconstruction.lattice.multigrid.levels import Operator, hierarchy, rooms


class Rim(NamedTuple):
    """How many rows in the south and north, and columns in the west and east, are held fixed."""

    south: int = 0
    north: int = 0
    west: int = 0
    east: int = 0


FREE = Rim()
"""Nothing is held fixed."""


class VCyclePreconditioner:
    """One V-cycle as an approximate inverse, symmetric and positive definite.

    Parameters
    ----------
    operator : Operator
        The finest level.
    rim : Rim
        What is held fixed.
    """

    def __init__(self, operator: Operator, rim: Rim = FREE) -> None:
        self.operator = operator
        self.levels = hierarchy(operator, (rim.south, rim.north, rim.west, rim.east))

    def __call__(self, residual: FloatArray) -> FloatArray:
        """Return roughly A⁻¹ times a residual."""
        z = np.zeros_like(residual)
        room = rooms(self.levels.shapes)
        multigrid.cycle(self.operator, self.levels, residual, z, room)
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
    preconditioner : Preconditioner, optional
        Where one is at hand; its rim keeps the heights of `start`.
    max_iterations : int
        When to give up.

    Returns
    -------
    Solution
        Heights and number of iterations.

    Raises
    ------
    ValueError
        When the three do not lie on one lattice.

    Examples
    --------
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
    return Solution(*multigrid.conjugate_gradients(operator, by.levels, rhs, start, until))


__all__ = ["FREE", "Operator", "Rim", "Solution", "VCyclePreconditioner", "solve"]
