"""Inverse of OpenCV's pinhole distortion by Newton's method, up to the radius at which the model folds."""

import numpy as np

from survey.core.arrays import FloatArray

_N_ITERATIONS = 50
_CONVERGED = 1e-11  # of the plane z = 1


def undistorted(plane: FloatArray, coefficients: FloatArray) -> FloatArray:
    """Return the points of the plane z = 1 that the lens shows at distorted ones.

    Parameters
    ----------
    plane : (N, 2) ndarray
        Distorted points of the plane z = 1.
    coefficients : (5,) ndarray
        k1, k2, p1, p2, k3.

    Returns
    -------
    (N, 2) ndarray
        Undistorted points; NaN where the lens shows none: beyond the radius at which the radial
        polynomial stops to grow.

    Examples
    --------
    >>> undistorted(np.array([[0.5, 0.0], [0.9, 0.0]]), np.array([-0.3, 0.0, 0.0, 0.0, 0.0])).round(6).tolist()
    [[0.54988, 0.0], [nan, nan]]
    """
    found = plane.copy()
    if not coefficients.any():
        return found
    limit, active = fold_radius(coefficients), np.arange(len(plane))
    with np.errstate(all="ignore"):
        for _ in range(_N_ITERATIONS):
            shown, slope = _distorted(found[active], coefficients)
            off = plane[active] - shown
            found[active] += np.linalg.solve(_regular(slope), off[:, :, None])[:, :, 0]
            active = active[~(np.abs(off).max(axis=1) < _CONVERGED)]
            if not len(active):
                break
        found[active] = np.nan
        found[~(np.hypot(*found.T) < limit)] = np.nan
    return found


def fold_radius(coefficients: FloatArray) -> float:
    """Return the radius on the plane z = 1 beyond which the radial polynomial falls; infinite where it never does.

    Parameters
    ----------
    coefficients : (5,) ndarray
        k1, k2, p1, p2, k3.

    Returns
    -------
    float
        The least positive root of d/dr (r + k1 r³ + k2 r⁵ + k3 r⁷).

    Examples
    --------
    >>> round(fold_radius(np.array([-0.3, 0.0, 0.0, 0.0, 0.0])), 4)
    1.0541
    """
    k1, k2, _, _, k3 = coefficients.tolist()
    squares = np.roots([7.0 * k3, 5.0 * k2, 3.0 * k1, 1.0])
    real = squares.real[(np.abs(squares.imag) < 1e-9 * np.abs(squares)) & (squares.real > 0.0)]
    return float(np.sqrt(real.min())) if len(real) else np.inf


def _distorted(plane: FloatArray, coefficients: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the distorted points (N, 2), and how they change with the undistorted ones (N, 2, 2)."""
    k1, k2, p1, p2, k3 = coefficients.tolist()
    x, y = plane.T
    s = x**2 + y**2
    radial = 1.0 + s * (k1 + s * (k2 + s * k3))
    by_s = 2.0 * (k1 + s * (2.0 * k2 + 3.0 * s * k3))
    shown = np.column_stack(
        [
            x * radial + 2.0 * p1 * x * y + p2 * (s + 2.0 * x**2),
            y * radial + p1 * (s + 2.0 * y**2) + 2.0 * p2 * x * y,
        ]
    )
    across = by_s * x * y + 2.0 * (p1 * x + p2 * y)
    slope = np.empty((len(plane), 2, 2))
    slope[:, 0, 0] = radial + by_s * x**2 + 2.0 * p1 * y + 6.0 * p2 * x
    slope[:, 1, 1] = radial + by_s * y**2 + 6.0 * p1 * y + 2.0 * p2 * x
    slope[:, 0, 1] = slope[:, 1, 0] = across
    return shown, slope


def _regular(slope: FloatArray) -> FloatArray:
    """Return matrices (N, 2, 2) with those replaced that have no finite inverse: there is no solution there."""
    determinant = slope[:, 0, 0] * slope[:, 1, 1] - slope[:, 0, 1] * slope[:, 1, 0]
    is_bad = ~(np.abs(determinant) > 1e-12) | ~np.isfinite(determinant)
    return np.where(is_bad[:, None, None], np.eye(2), slope)
