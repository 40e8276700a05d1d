"""Least-squares solution of the strips' errors by their overlaps and control points.

Each error has a normal prior, whose size is found by marginal likelihood like those of the errors of blocks and stretches.
"""

import numpy as np
import numpy.typing as npt
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.optimize import minimize

from survey.core.arrays import FloatArray
from survey.reconstruction.tiled.strips.equations import Differences, Normal, differences, normal_equations
from survey.reconstruction.tiled.strips.places import N_TERMS, StripPlaces
from survey.reconstruction.tiled.strips.strip_errors import Sizes, StripErrors

_LOG_SD = 0.7
# Sizes are searched within a factor of a thousand.
_MOST_LOG = 7.0


def solve_strips(
    places: StripPlaces, blocks: npt.NDArray[np.void], control: npt.NDArray[np.void], expected: Sizes
) -> StripErrors:
    """Return the strips' errors by their overlaps and control points.

    Parameters
    ----------
    places : StripPlaces
        Middles and half-lengths of the strips.
    blocks : (N,) ndarray of OVERLAP
        Differences of strips over blocks of cells.
    control : (M,) ndarray of OVERLAP
        Differences of strips and control points: `second` is 0, `n` is 1, `scatter` their variance [m²].
    expected : Sizes
        Medians of the priors of the sizes.

    Returns
    -------
    StripErrors
        Without overlaps and control points the errors are 0 and as uncertain as expected.
    """
    found = differences(places, np.concatenate([blocks, control]))
    n_strips = len(places.keys)
    sizes = _sizes(found, n_strips, expected) if len(found.starts) else expected
    normal = _normal(found, n_strips, sizes)
    factor = cho_factor(normal.matrix, lower=True)
    errors = cho_solve(factor, normal.rhs).reshape(-1, N_TERMS)
    covariance = cho_solve(factor, np.eye(len(normal.rhs)))
    return StripErrors(places, errors, covariance, sizes, _shared_in_cells(blocks))


def _sizes(found: Differences, n_strips: int, expected: Sizes) -> Sizes:
    """Return the sizes of greatest marginal likelihood, under log-normal priors about the expected ones."""
    start = np.log(expected)

    def negative(logs: FloatArray) -> float:
        normal = _normal(found, n_strips, Sizes(*np.exp(logs)))
        lower = np.linalg.cholesky(normal.matrix)
        whitened = solve_triangular(lower, normal.rhs, lower=True)
        own = normal.energy - whitened @ whitened + normal.log_determinant
        own += 2.0 * float(np.log(np.diag(lower)).sum())
        return 0.5 * float(own) + 0.5 * float(np.sum(((logs - start) / _LOG_SD) ** 2))

    bounds = [(log - _MOST_LOG, log + _MOST_LOG) for log in start]
    best = minimize(negative, start, method="L-BFGS-B", bounds=bounds)
    return Sizes(*map(float, np.exp(best.x)))


def _normal(found: Differences, n_strips: int, sizes: Sizes) -> Normal:
    """Return the normal equations with errors of some sizes."""
    prior_m = np.array([sizes.offset_m, sizes.tilt_m, sizes.tilt_m, sizes.shift_m, sizes.shift_m])
    return normal_equations(found, prior_m, n_strips, sizes.block_m, sizes.wander_m)


def _shared_in_cells(blocks: npt.NDArray[np.void]) -> float:
    """Return the standard deviation of a strip's height in a cell beyond what its points' scatter explains [m]."""
    if len(blocks) == 0:
        return 0.0
    excess = blocks["scatter"] - blocks["sampling"]
    order = np.argsort(excess)
    share = np.cumsum(blocks["n"][order]) / blocks["n"].sum()
    return float(np.sqrt(max(0.0, 0.5 * excess[order][np.searchsorted(share, 0.5)])))
