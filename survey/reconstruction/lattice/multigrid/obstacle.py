r"""A surface below a ceiling: the lattice's energy with a one-sided spring at every node over which rays passed.

.. math::  \min_z \; \tfrac12 z^T A z - b^T z + \rho \sum_i h(z_i - c_i), \qquad
           h(v) = \begin{cases} 0 & v \le 0 \\ v^2 / 2 & v \le v_0 \\ v_0 v - v_0^2 / 2 & v > v_0 \end{cases}

Where the surface touches is not known beforehand: every step of a semi-smooth Newton method takes the
nodes above the ceiling to hang on its springs, and solves for all, until the same nodes touch again
(Hintermüller, Ito and Kunisch 2002). Springs that are stretched too far pull no harder (Huber's loss, by
reweighting): where points contradict a ceiling, the points win.
"""

from typing import NamedTuple

import numpy as np

from survey.core.arrays import FloatArray
from survey.reconstruction.lattice.multigrid.solver import (
    FREE,
    Operator,
    Rim,
    Solution,
    VCyclePreconditioner,
    solve,
)

_MOST_STEPS = 40
# Until the same nodes touch again, a solution need not be as good.
_ROUGHLY = 5.0


class Ceiling(NamedTuple):
    """What a surface is not to rise above.

    Parameters
    ----------
    height : (H, W) ndarray
        c; infinite where there is none [m].
    spring : float
        ρ: how hard it is, its inverse variance in units of A [1/m²].
    yield_m : float
        v₀: the stretch beyond which a spring pulls no harder [m].
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

    Parameters
    ----------
    operator : Operator
        The matrix A.
    rhs, start : (H, W) ndarray
        Right-hand side b, and where to begin: best the solution without ceiling.
    ceiling : Ceiling
        Where it is and how hard.
    tolerance : float
        As in `solve`; and the share by which springs' weights may still change at the end.
    rim : Rim
        What keeps the heights of `start`.

    Returns
    -------
    Solution
        Heights, and the iterations of all steps together.

    Examples
    --------
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
    by = VCyclePreconditioner(_pulled(operator, foreseen), rim)
    allowed = _ROUGHLY * tolerance
    for _ in range(_MOST_STEPS):
        z, n = solve(_pulled(operator, pull), rhs + pull * level, z, tolerance=allowed, preconditioner=by)
        n_iterations += n
        before, pull = pull, ceiling.pull(z)
        if (np.abs(pull - before) <= tolerance * np.minimum(pull, before)).all():
            if allowed == tolerance:
                break
            allowed = tolerance
        # A preconditioner made for stronger springs still serves; for weaker ones it could fail.
        if (pull > foreseen).any():
            foreseen = np.maximum(pull, foreseen)
            by = VCyclePreconditioner(_pulled(operator, foreseen), rim)
    return Solution(z, n_iterations)


def _pulled(operator: Operator, pull: FloatArray) -> Operator:
    stencil = operator.stencil.copy()
    stencil[0] += pull
    return Operator(stencil, operator.weights, operator.soft)
