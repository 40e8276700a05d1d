r"""Displacement of one window between two images: normalized cross-correlation, then least squares.

The highest normalized cross-correlation gives whole pixels. About it the displacement d, an offset and a gain are fitted,

.. math::  f_1(p) = a + b f_2(p + d) + r(p)

with f₂ interpolated by cubic splines. Both images are smoothed before, so that the interpolation does not act as a filter
of its own, which would pull displacements towards half pixels. The residuals of neighbouring pixels are correlated: with
their autocovariance R, the gradient g and H = Σ g gᵀ,

.. math::  \operatorname{cov} d = H^{-1} \left( \sum_{p, q} R(p - q) g(p) g(q)^T \right) H^{-1}
"""

from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates, spline_filter

from survey.core.arrays import FloatArray, IntArray

SMOOTHED_PX = 1.0
"""Standard deviation of the smoothing of both images [pixels]."""
_PASSES, _CONVERGED_PX = 12, 1e-4
# Pixels over which residuals correlate.
_REACH_PX = 6
# Correlations nearer to the highest one than this belong to the same match.
_ONE_PEAK_PX = 4.0


class Match(NamedTuple):
    """Displacement of a window.

    Parameters
    ----------
    shift : (2,) ndarray
        Rows down and columns right [pixels].
    covariance : (2, 2) ndarray
        Of the shift [pixels²].
    correlation : float
        Normalized cross-correlation at the match.
    ambiguity : float
        What the match leaves unexplained over what the best match elsewhere leaves, 0 to 1.
    is_converged : bool
        Whether the fit of least squares stayed within a pixel and a half of the highest correlation.
    """

    shift: FloatArray
    covariance: FloatArray
    correlation: float
    ambiguity: float
    is_converged: bool


class ImagePair:
    """Two images of one ground on one grid, prepared for matching.

    Parameters
    ----------
    first, second : (H, W) ndarray
        Brightness or heights without gaps.
    """

    def __init__(self, first: FloatArray, second: FloatArray) -> None:
        self.first = gaussian_filter(first, SMOOTHED_PX)
        self._second = gaussian_filter(second, SMOOTHED_PX)
        self._splines = np.asarray(spline_filter(self._second, order=3), dtype=np.float64)
        self._gradient: list[FloatArray] = [np.asarray(axis) for axis in np.gradient(self._second)]

    def match(self, centre: tuple[int, int], half_px: int, search_px: int) -> Match:
        """Match the window of the first image about a pixel within a distance in the second one.

        Parameters
        ----------
        centre : (int, int)
            Row and column.
        half_px : int
            Half of the width of the window [pixels].
        search_px : int
            Largest displacement on either axis [pixels].

        Returns
        -------
        Match
            Window and search must lie within the images.
        """
        row, column = centre
        window = self.first[row - half_px : row + half_px + 1, column - half_px : column + half_px + 1]
        reach = half_px + search_px
        area = self._second[row - reach : row + reach + 1, column - reach : column + reach + 1]
        scores = normalized_correlation(window, area)
        peak = np.array(np.unravel_index(int(np.argmax(scores)), scores.shape))
        facts = float(scores.max()), _ambiguity(scores, peak)
        return self._refined(window, np.array(centre), peak - search_px, facts)

    def _refined(
        self, window: FloatArray, centre: IntArray, whole: IntArray, facts: tuple[float, float]
    ) -> Match:
        """Fit displacement, offset and gain by Gauss-Newton steps from whole pixels."""
        indices: IntArray = np.moveaxis(np.indices(window.shape), 0, -1).astype(np.int64)
        places = indices - (np.array(window.shape) - 1) // 2 + centre
        shift = whole.astype(np.float64)
        for _ in range(_PASSES):
            seen, gradient = self._at(places + shift)
            design = np.column_stack([np.ones(seen.size), seen.ravel(), gradient.reshape(-1, 2)])
            found = np.linalg.lstsq(design, window.ravel())[0]
            step = found[2:] / found[1] if found[1] > 0.0 else np.zeros(2)
            shift = shift + step
            if np.abs(step).max() < _CONVERGED_PX or np.abs(shift - whole).max() > 1.5:
                break
        inside = bool(np.abs(shift - whole).max() <= 1.5 and found[1] > 0.0)
        residual = (window.ravel() - design @ found).reshape(window.shape) / max(abs(found[1]), 1e-12)
        return Match(shift, _covariance(residual, gradient), *facts, inside)

    def _at(self, places: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the second image (n, n) and its gradient (n, n, 2) at places."""
        coordinates = np.moveaxis(places, -1, 0)
        seen = map_coordinates(self._splines, coordinates, order=3, prefilter=False, mode="nearest")
        gradient = [
            np.asarray(map_coordinates(axis, coordinates, order=1, mode="nearest")) for axis in self._gradient
        ]
        return seen, np.stack(gradient, axis=-1)


def normalized_correlation(window: FloatArray, area: FloatArray) -> FloatArray:
    """Return the normalized cross-correlation of a window (n, n) with every place of an area.

    Parameters
    ----------
    window : (n, n) ndarray
        Template.
    area : (m, m) ndarray
        At least as large.

    Returns
    -------
    (m - n + 1, m - n + 1) ndarray
        Between -1 and 1; 0 where the area is flat.
    """
    from scipy.signal import fftconvolve  # slow to import, and scores of maps need none

    about, ones = window - window.mean(), np.ones_like(window)
    shifted = area - area.mean()
    cross = fftconvolve(shifted, about[::-1, ::-1], mode="valid")
    total, squares = (fftconvolve(values, ones, mode="valid") for values in (shifted, shifted**2))
    spread = np.maximum(squares - total**2 / window.size, 0.0)
    floor = 1e-12 * max(float(spread.max(initial=0.0)), 1e-300)
    norm = np.sqrt(np.maximum(spread, floor) * max(float(np.sum(about**2)), 1e-300))
    return np.where(spread > floor, cross / norm, 0.0)


def _ambiguity(scores: FloatArray, peak: IntArray) -> float:
    """Return (1 - best) / (1 - second best), the second beyond a few pixels from the best."""
    row, column = np.indices(scores.shape)
    elsewhere = scores[np.hypot(row - peak[0], column - peak[1]) > _ONE_PEAK_PX]
    second = float(elsewhere.max()) if elsewhere.size else 0.0
    return float((1.0 - scores.max()) / max(1.0 - second, 1e-9))


def _covariance(residual: FloatArray, gradient: FloatArray) -> FloatArray:
    """Return the covariance (2, 2) of a displacement from residuals (n, n) that are correlated, and gradients (n, n, 2)."""
    flat = gradient.reshape(-1, 2)
    information = flat.T @ flat
    if np.linalg.cond(information) > 1e12:
        return np.full((2, 2), np.inf)
    lags = slice(residual.shape[0] - 1 - _REACH_PX, residual.shape[0] + _REACH_PX)
    overlap = _correlated(np.ones_like(residual), np.ones_like(residual))[lags, lags]
    auto = _correlated(residual, residual)[lags, lags] / overlap
    auto *= residual.size / (residual.size - 4.0)
    middle = np.empty((2, 2))
    for a in (0, 1):
        for b in (0, 1):
            middle[a, b] = np.sum(auto * _correlated(gradient[..., a], gradient[..., b])[lags, lags])
    inverse = np.linalg.inv(information)
    covariance: FloatArray = inverse @ (0.5 * (middle + middle.T)) @ inverse
    least = np.mean(residual**2) * inverse
    return covariance if (np.diag(covariance) > np.diag(least)).all() else least


def _correlated(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the sums of products of two images for every lag."""
    from scipy.signal import fftconvolve

    correlated: FloatArray = fftconvolve(a, b[::-1, ::-1], mode="full")
    return correlated
