r"""Displacements between two surveys of a moving surface by feature tracking, and their files.

`track` matches windows of the hillshades, or of the surfaces themselves, and flags outliers among neighbours.
For one window the highest normalized cross-correlation gives whole pixels. About it the displacement d, an
offset and a gain are fitted by least squares,

.. math::  f_1(p) = a + b f_2(p + d) + r(p)

with f₂ interpolated by cubic splines. Both images are smoothed before, so that the interpolation does not act
as a filter of its own, which would pull displacements towards half pixels. The residuals of neighbouring pixels
are correlated: with their autocovariance R, the gradient g and H = Σ g gᵀ,

.. math::  \operatorname{cov} d = H^{-1} \left( \sum_{p, q} R(p - q) g(p) g(q)^T \right) H^{-1}

`write_tracked` writes the displacements as points with velocities to GeoPackage, GeoJSON or Shapefile; the
covariance between east and north is not written.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely
from pyproj import CRS
from scipy.ndimage import gaussian_filter, map_coordinates, spline_filter
from scipy.spatial import cKDTree

from survey.core import (
    BoolArray,
    DataObject,
    FloatArray,
    InputError,
    IntArray,
    check_types,
    projected_crs,
    same_crs,
)
from survey.data.dem import Dem
from survey.io.vector import read_features, write_features
from survey.scoring.accuracy import NMAD_FACTOR

SMOOTHED_PX = 1.0
"""Standard deviation of the smoothing of both images [pixels]."""
_PASSES, _CONVERGED_PX = 12, 1e-4
# Pixels over which residuals correlate.
_REACH_PX = 6
# Correlations nearer to the highest one than this belong to the same match.
_ONE_PEAK_PX = 4.0


class Match(NamedTuple):
    """Displacement of a window.

    `shift` (2,): rows down and columns right [pixels]. `covariance` (2, 2): of the shift [pixels²].
    `correlation`: normalized cross-correlation at the match. `ambiguity`: what the match leaves unexplained
    over what the best match elsewhere leaves, 0 to 1. `is_converged`: whether the fit of least squares stayed
    within a pixel and a half of the highest correlation.
    """

    shift: FloatArray
    covariance: FloatArray
    correlation: float
    ambiguity: float
    is_converged: bool


class ImagePair:
    """Two images of one ground on one grid, prepared for matching.

    `first`, `second` (H, W): brightness or heights without gaps.
    """

    def __init__(self, first: FloatArray, second: FloatArray) -> None:
        self.first = gaussian_filter(first, SMOOTHED_PX)
        self._second = gaussian_filter(second, SMOOTHED_PX)
        self._splines = np.asarray(spline_filter(self._second, order=3), dtype=np.float64)
        self._gradient: list[FloatArray] = [np.asarray(axis) for axis in np.gradient(self._second)]

    def match(self, centre: tuple[int, int], half_px: int, search_px: int) -> Match:
        """Match the window of the first image about a pixel within a distance in the second one.

        `centre` (int, int): row and column. `half_px`: half of the width of the window [pixels]. `search_px`:
        largest displacement on either axis [pixels].
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

    `window` (n, n): template. `area` (m, m): at least as large. Returns (m - n + 1, m - n + 1): between -1
    and 1; 0 where the area is flat.
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


# Matches with a smaller correlation, less distinct ones, or those farther from the median of their neighbours than this many deviations, are outliers.
_LEAST_CORRELATION, _MOST_AMBIGUOUS, _MOST_DEVIATIONS = 0.5, 0.6, 4.0
_N_NEIGHBOURS = 9
# Least spread of neighbours [pixels]: that of a strain of a few thousandths.
_LEAST_SPREAD_PX = 0.1


@dataclass(frozen=True, eq=False, repr=False)
class TrackedMotion(DataObject):
    """Displacements at places of the earlier survey.

    `xy` (N, 2): easting and northing in the earlier survey [m]. `shift_m` (N, 2): displacement to the east
    and to the north [m]. `covariance` (N, 2, 2): of the displacement [m²]. `correlation` (N,): normalized
    cross-correlation. `is_outlier` (N,) bool: weak matches, and those that contradict their neighbours.
    `window_m`: width of the windows [m]; 0 where it is not known.
    """

    xy: FloatArray
    shift_m: FloatArray
    covariance: FloatArray
    correlation: FloatArray
    is_outlier: BoolArray
    window_m: float = 0.0

    @property
    def sigma_m(self) -> FloatArray:
        """Standard deviation (N, 2) of the displacements [m]."""
        sigma: FloatArray = np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))
        return sigma

    def __len__(self) -> int:
        return len(self.xy)


@check_types
def track(
    earlier: Dem,
    later: Dem,
    *,
    window_px: int = 33,
    step_px: int = 16,
    search_px: int = 24,
    shaded: bool = True,
) -> TrackedMotion:
    """Track the features of a surface from one survey to another.

    `window_px`: width of the windows that are matched, odd [pixels]. `step_px`: distance of the windows
    [pixels]. `search_px`: largest displacement on either axis that is searched [pixels].

    The window moves without turning or stretching. Correlated errors of a survey as a whole, such as a shift of its
    datum, are part of the displacement and not of its covariance: align the surveys on ground at rest first.

    >>> from survey.data.grid import Grid
    >>> rng = np.random.default_rng(1)
    >>> ground = rng.standard_normal((90, 96))
    >>> grid = Grid((0.0, 0.0, 89.0, 89.0), 1.0)
    >>> earlier, later = (Dem.on(grid, ground[:, k : k + 90]) for k in (3, 0))
    >>> moved = track(earlier, later, window_px=21, search_px=6, shaded=False)
    >>> np.median(moved.shift_m, axis=0).round(1).tolist()
    [3.0, 0.0]
    """
    check_pair(earlier, later, window_px, search_px)
    images = [hillshade(dem) if shaded else dem.elevation for dem in (earlier, later)]
    known = np.isfinite(images[0]) & np.isfinite(images[1])
    pair = ImagePair(*(np.where(known, image, np.nanmean(image)) for image in images))
    half = window_px // 2
    centres = _centres(known, half + search_px, step_px)
    if not centres:
        raise InputError(
            "no window without gaps fits into both surveys; take smaller windows or a smaller search."
        )
    matches = [pair.match(centre, half, search_px) for centre in centres]
    return replace(_field(earlier, centres, matches), window_m=window_px * earlier.step_m)


def check_pair(earlier: Dem, later: Dem, window_px: int, search_px: int) -> None:
    """Refuse surveys on different grids, and windows without a middle.

    `window_px`, `search_px`: width of the windows and of the search [pixels].
    """
    same_crs(earlier.crs, later.crs, "the two surveys")
    if earlier.shape != later.shape or not earlier.transform.almost_equals(later.transform):
        raise InputError("the two surveys lie on different grids; warp one onto the grid of the other first.")
    if window_px < 9 or window_px % 2 == 0 or search_px < 1:
        raise InputError(
            f"the window is {window_px} and the search {search_px} pixels wide; give an odd window of at least 9 and a search "
            "of at least 1."
        )


def hillshade(dem: Dem, azimuth_deg: float = 315.0, altitude_deg: float = 45.0) -> FloatArray:
    """Return the brightness (H, W) of a surface that scatters light evenly.

    `azimuth_deg`: direction of the light, clockwise from north [deg]. `altitude_deg`: height of the light
    above the horizon [deg]. Returns (H, W): cosine of the angle between light and surface; shadows are not
    cast.
    """
    east, north = dem.gradient()
    azimuth, altitude = np.radians(azimuth_deg), np.radians(altitude_deg)
    light = np.sin(azimuth) * np.cos(altitude), np.cos(azimuth) * np.cos(altitude), np.sin(altitude)
    brightness: FloatArray = (light[2] - east * light[0] - north * light[1]) / np.sqrt(
        1.0 + east**2 + north**2
    )
    return brightness


def _centres(known: BoolArray, reach: int, step_px: int) -> list[tuple[int, int]]:
    """Return the pixels about which windows and searches have no gaps."""
    rows, columns = (range(reach, n - reach, step_px) for n in known.shape)
    whole = [(r, c) for r in rows for c in columns]
    return [(r, c) for r, c in whole if known[r - reach : r + reach + 1, c - reach : c + reach + 1].all()]


def _field(dem: Dem, centres: list[tuple[int, int]], matches: list[Match]) -> TrackedMotion:
    """Return the matches in metres to the east and to the north, with their outliers."""
    step, turn = dem.step_m, np.array([[0.0, 1.0], [-1.0, 0.0]])
    rows, columns = np.array(centres).T
    shift = np.array([match.shift for match in matches]) @ turn.T * step
    covariance = turn @ np.array([match.covariance for match in matches]) @ turn.T * step**2
    correlation = np.array([match.correlation for match in matches])
    xy = np.column_stack([dem.x[columns], dem.y[rows]])
    weak = ~np.array([match.is_converged for match in matches]) | (correlation < _LEAST_CORRELATION)
    weak |= np.array([match.ambiguity for match in matches]) > _MOST_AMBIGUOUS
    weak |= ~np.isfinite(covariance).all(axis=(1, 2))
    return TrackedMotion(
        xy, shift, covariance, correlation, weak | _strays(xy, shift, covariance, weak, step)
    )


def _strays(
    xy: FloatArray, shift: FloatArray, covariance: FloatArray, weak: BoolArray, step_m: float
) -> BoolArray:
    """Return which displacements lie farther from the median of their neighbours than the spread of these allows."""
    good = np.flatnonzero(~weak)
    strays = np.zeros(len(xy), dtype=np.bool_)
    if len(good) < _N_NEIGHBOURS:
        return strays
    near = good[np.atleast_2d(cKDTree(xy[good]).query(xy[good], k=_N_NEIGHBOURS)[1])[:, 1:]]
    median = np.median(shift[near], axis=1)
    spread = NMAD_FACTOR * np.median(np.abs(shift[near] - median[:, None]), axis=1)
    own = np.sqrt(np.diagonal(covariance[good], axis1=1, axis2=2))
    allowed = _MOST_DEVIATIONS * np.sqrt(own**2 + np.maximum(spread, _LEAST_SPREAD_PX * step_m) ** 2)
    strays[good] = (np.abs(shift[good] - median) > allowed).any(axis=1)
    return strays


_COLUMNS = ("east_m", "north_m", "sigma_east_m", "sigma_north_m", "correlation", "outlier", "window_m")


def write_tracked(path: str | Path, found: TrackedMotion, days: float, crs: CRS) -> None:
    """Write displacements as points with velocities and standard deviations.

    `days`: time between the surveys [days].
    """
    columns = dict(zip(("east_m", "north_m"), found.shift_m.T, strict=True))
    columns |= dict(zip(("east_m_per_day", "north_m_per_day"), found.shift_m.T / days, strict=True))
    columns |= dict(zip(("sigma_east_m", "sigma_north_m"), found.sigma_m.T, strict=True))
    columns |= {"correlation": found.correlation, "outlier": found.is_outlier.astype(float)}
    columns |= {"window_m": np.full(len(found), found.window_m)}
    write_features(Path(path), shapely.points(found.xy), columns, crs, layer="velocity")


def read_tracked(path: str | Path, crs: CRS) -> TrackedMotion:
    """Read the displacements that `write_tracked` wrote."""
    features = read_features(path, what="the tracked displacements")
    lacking = [name for name in _COLUMNS if name not in features.attributes]
    if lacking:
        raise InputError(
            f"{path} has no column {', '.join(lacking)}; name a file that firnline track wrote, or track again."
        )
    same_crs(crs, projected_crs(features.crs, str(path)), "the surveys and the tracked displacements")
    east, north, sigma_east, sigma_north, correlation, outlier, window = (
        _numbers(features.attributes[name]) for name in _COLUMNS
    )
    covariance = np.zeros((len(east), 2, 2))
    covariance[:, 0, 0], covariance[:, 1, 1] = sigma_east**2, sigma_north**2
    xy = shapely.get_coordinates(features.geometry)
    is_outlier = (outlier != 0.0) | ~np.isfinite(covariance).all(axis=(1, 2))
    shift = np.column_stack([east, north])
    _require_finite(path, shift[~is_outlier], window)
    return TrackedMotion(xy, shift, covariance, correlation, is_outlier, float(window[0]))


def _require_finite(path: str | Path, shift: FloatArray, window: FloatArray) -> None:
    """Refuse displacements or windows that are not finite."""
    n_bad = int((~np.isfinite(shift).all(axis=1)).sum())
    if n_bad:
        raise InputError(
            f"{path} holds {n_bad} displacements that are NaN or infinite and not flagged; set their column outlier to 1."
        )
    if not np.isfinite(window).all():
        raise InputError(f"{path} has windows whose window_m is NaN or infinite; track again.")


def _numbers(values: FloatArray) -> FloatArray:
    return np.asarray(values, dtype=np.float64)
