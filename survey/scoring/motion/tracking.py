"""Field of displacements between two surveys of a moving surface by feature tracking."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from survey.core.arguments import check_types
from survey.core.arrays import BoolArray, FloatArray
from survey.core.crs.agreement import same_crs
from survey.core.data_object import DataObject
from survey.core.errors import InputError
from survey.data.dem import Dem
from survey.scoring.motion.template_matching import ImagePair, Match

# Matches with a smaller correlation, less distinct ones, or those farther from the median of their neighbours than this many deviations, are outliers.
_LEAST_CORRELATION, _MOST_AMBIGUOUS, _MOST_DEVIATIONS = 0.5, 0.6, 4.0
_N_NEIGHBOURS, _NMAD = 9, 1.4826
# Least spread of neighbours [pixels]: that of a strain of a few thousandths.
_LEAST_SPREAD_PX = 0.1


@dataclass(frozen=True, eq=False, repr=False)
class TrackedMotion(DataObject):
    """Displacements at places of the earlier survey.

    Parameters
    ----------
    xy : (N, 2) ndarray
        Easting and northing in the earlier survey [m].
    shift_m : (N, 2) ndarray
        Displacement to the east and to the north [m].
    covariance : (N, 2, 2) ndarray
        Of the displacement [m²].
    correlation : (N,) ndarray
        Normalized cross-correlation.
    is_outlier : (N,) ndarray of bool
        Weak matches, and those that contradict their neighbours.
    window_m : float
        Width of the windows [m]; 0 where it is not known.
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

    Parameters
    ----------
    earlier, later : Dem
        Elevations, or images, on one grid.
    window_px : int
        Width of the windows that are matched, odd [pixels].
    step_px : int
        Distance of the windows [pixels].
    search_px : int
        Largest displacement on either axis that is searched [pixels].
    shaded : bool
        Whether the surveys are elevations, of which hillshades are matched; else they are images.

    Returns
    -------
    TrackedMotion
        Windows with gaps are left out.

    Raises
    ------
    InputError
        Surveys on different grids, or too small for a window and its search.

    Notes
    -----
    The window moves without turning or stretching. Correlated errors of a survey as a whole, such as a shift of its
    datum, are part of the displacement and not of its covariance: align the surveys on ground at rest first.

    Examples
    --------
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

    Parameters
    ----------
    earlier, later : Dem
        Surveys.
    window_px, search_px : int
        Width of the windows and of the search [pixels].

    Raises
    ------
    InputError
        What `track` refuses before work starts.
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

    Parameters
    ----------
    dem : Dem
        Elevations.
    azimuth_deg : float
        Direction of the light, clockwise from north [deg].
    altitude_deg : float
        Height of the light above the horizon [deg].

    Returns
    -------
    (H, W) ndarray
        Cosine of the angle between light and surface; shadows are not cast.
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
    spread = _NMAD * np.median(np.abs(shift[near] - median[:, None]), axis=1)
    own = np.sqrt(np.diagonal(covariance[good], axis1=1, axis2=2))
    allowed = _MOST_DEVIATIONS * np.sqrt(own**2 + np.maximum(spread, _LEAST_SPREAD_PX * step_m) ** 2)
    strays[good] = (np.abs(shift[good] - median) > allowed).any(axis=1)
    return strays
