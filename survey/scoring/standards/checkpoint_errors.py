"""Errors of a map at checkpoints: their spread over the area, the interval of their RMSE, and conditions on them.

`compare` takes map minus checkpoint where the map gives a height. `Spread` measures how the checkpoints are
distributed over the area. `RmseInterval` is the 95 % interval of the RMSE: by the quantiles of χ², or by
bootstrap where the errors are biased. The functions at the end return the conditions of a standard that the
checkpoints do not meet, and errors to investigate, such as blunders and heights in feet.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import gammaincinv

from survey.core import (
    UNSTATED,
    BoolArray,
    FloatArray,
    InputError,
    frozen,
    same_crs,
    same_vertical_datum,
    stream,
)
from survey.core.lengths import FOOT_M
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.scoring.coverage import mapped_share
from survey.scoring.standards.checkpoints import Checkpoints
from survey.scoring.standards.standards import (
    ASPRS_2014,
    LEAST_COVERED,
    Standard,
    checkpoints_2014,
    checkpoints_edition_2,
)


@dataclass(frozen=True)
class Spread:
    """Spread of checkpoints over the area that they represent.

    `quadrant_shares` (4,): shares in the quarters of the bounding rectangle: south-west, south-east,
    north-west, north-east. `spacing_share`: least distance between two of them over the rectangle's diagonal;
    infinite for one point. `area_m2`: free ground of the area that is judged, on the ground [m²].
    """

    quadrant_shares: tuple[float, float, float, float]
    spacing_share: float
    area_m2: float

    @classmethod
    def of(cls, xy: Any, area: SurveyArea) -> Self:
        """Measure places (N, 2) [m] against the rectangle around an area.

        `xy` (N, 2): easting and northing of the checkpoints [m].

        >>> square = SurveyArea.rectangle((0.0, 0.0, 30.0, 40.0), "EPSG:32608")
        >>> Spread.of([[1.0, 1.0], [29.0, 1.0], [1.0, 6.0]], square)
        Spread(quadrant_shares=(0.667, 0.333, 0.0, 0.0), spacing_share=0.1, area_m2=1193.6)
        """
        points = np.asarray(xy, dtype=np.float64).reshape(-1, 2)
        xmin, ymin, xmax, ymax = area.bounds
        east, north = points[:, 0] >= 0.5 * (xmin + xmax), points[:, 1] >= 0.5 * (ymin + ymax)
        counts = np.bincount(2 * north + east, minlength=4) / max(len(points), 1)
        nearest = np.asarray(cKDTree(points).query(points, k=2)[0])[:, 1].min() if len(points) > 1 else np.inf
        shares = (float(counts[0]), float(counts[1]), float(counts[2]), float(counts[3]))
        return cls(shares, float(nearest / np.hypot(xmax - xmin, ymax - ymin)), area.ground_area_m2)


@dataclass(frozen=True)
class CheckpointErrors:
    """What a map errs at checkpoints.

    `errors_m` (N,): map minus checkpoint [m]. `sigma_z_m` (N,): standard deviations of the checkpoints [m].
    `vegetated` (N,) bool: which lie on vegetated ground. `names`: the checkpoints. `spread`: how they lie in
    the area. `left_out`: checkpoints in the area where the map gives no height. `n_outside`: checkpoints
    outside the area. `without_datum`: which of map and checkpoints state no
    vertical datum.
    `covered_share`: share of the named area on which the map gives a height; 1 where no area was named. `xyz`
    (N, 3): easting, northing and height of the checkpoints [m], where they are known. `shift_m` (N, 2): place
    in the map minus place of the checkpoint, east and north [m]; NaN where a mark was not found in the map.
    `sigma_xy_m` (N,): standard deviations of the horizontal distances of the checkpoints from their true
    places [m].
    """

    errors_m: FloatArray
    sigma_z_m: FloatArray
    vegetated: BoolArray
    names: tuple[str, ...]
    spread: Spread
    left_out: tuple[str, ...] = ()
    n_outside: int = 0
    without_datum: tuple[str, ...] = ()
    covered_share: float = 1.0
    xyz: FloatArray | None = None
    shift_m: FloatArray | None = None
    sigma_xy_m: FloatArray | None = None

    @cached_property
    def checkpoint_rmse_m(self) -> float:
        """Root mean square of the checkpoints' own standard deviations [m]."""
        return float(np.sqrt(np.mean(self.sigma_z_m**2)))

    def on(self, *, vegetated: bool) -> "CheckpointErrors | None":
        """Return those on vegetated or on open ground; ``None`` where there are none."""
        return self._only(self.vegetated if vegetated else ~self.vegetated)

    @cached_property
    def placed(self) -> "CheckpointErrors | None":
        """Those that were found in the map too; None where there are none."""
        if self.shift_m is None:
            return None
        return self._only(np.asarray(np.isfinite(self.shift_m).all(axis=1), dtype=np.bool_))

    def _only(self, mask: BoolArray) -> "CheckpointErrors | None":
        """Return some of them; None for none."""
        if not mask.any():
            return None
        return replace(
            self,
            errors_m=self.errors_m[mask],
            sigma_z_m=self.sigma_z_m[mask],
            vegetated=self.vegetated[mask],
            names=tuple(name for name, taken in zip(self.names, mask, strict=True) if taken),
            xyz=None if self.xyz is None else self.xyz[mask],
            shift_m=None if self.shift_m is None else self.shift_m[mask],
            sigma_xy_m=None if self.sigma_xy_m is None else self.sigma_xy_m[mask],
        )

    def beyond(self, limit_m: float) -> tuple[str, ...]:
        """Return the names of those whose error is larger than a limit [m]; none is ever removed.

        `limit_m`: largest error that is not named [m].
        """
        return tuple(n for n, e in zip(self.names, self.errors_m, strict=True) if abs(e) > limit_m)


def compare(dem: Dem, checkpoints: Checkpoints, area: SurveyArea | None = None) -> CheckpointErrors:
    """Compare a map with checkpoints, at their places.

    Parameters
    ----------
    dem : Dem
        The map. Its heights are those of cell centres, and the height between four of them
        is bilinear, as in the standards' test of a gridded surface.
    checkpoints : Checkpoints
        In the same CRS.
    area : SurveyArea, optional
        The ground that is judged; by default the bounds of the map. No class is met where the map covers
        less than 99.9 % of it.

    Returns
    -------
    CheckpointErrors
        Of the checkpoints in the area at which the map has a height; the others are named or counted.

    Raises
    ------
    InputError
        Mixed CRS or vertical datums, or no checkpoint where the map has a height.

    Notes
    -----
    Between coarse cells the surface is not what was mapped: at a cell of w metres and a
    curvature c the bilinear height is off by up to c w² / 8 along a line.

    Examples
    --------
    >>> from survey.data.grid import Grid
    >>> grid = Grid((0.0, 0.0, 10.0, 10.0), 5.0)
    >>> dem = Dem.on(grid, np.full(grid.shape, 7.0))
    >>> compare(dem, Checkpoints([[3.0, 4.0, 6.9]], 0.02, "EPSG:32608")).errors_m.round(3)
    array([0.1])
    """
    same_crs(dem.crs, checkpoints.crs, "the map and the checkpoints")
    same_vertical_datum(dem.vertical_datum, checkpoints.vertical_datum, "the map and the checkpoints")
    ground = area or SurveyArea.rectangle(dem.bounds, dem.crs)
    ground.require_crs(dem.crs, "the map")
    inside = ground.contains(checkpoints.xy)
    heights = dem.at(checkpoints.xy)
    used = inside & np.isfinite(heights)
    if not used.any():
        raise InputError(
            f"of {len(checkpoints)} checkpoints {int(inside.sum())} lie in the area and none where the map has a height; "
            "check that both are of one place."
        )
    silent = inside & ~used
    return CheckpointErrors(
        frozen((heights - checkpoints.xyz[:, 2])[used]),
        frozen(checkpoints.sigma_z_m[used]),
        frozen(checkpoints.vegetated[used], bool),
        tuple(checkpoints.names[k] for k in np.flatnonzero(used)),
        Spread.of(checkpoints.xy[used], ground),
        tuple(checkpoints.names[k] for k in np.flatnonzero(silent)),
        int((~inside).sum()),
        _without_datum(dem, checkpoints),
        1.0 if area is None else mapped_share(dem, area),
        frozen(checkpoints.xyz[used]),
        None if checkpoints.map_xy is None else frozen((checkpoints.map_xy - checkpoints.xy)[used]),
        None if checkpoints.map_xy is None else frozen(checkpoints.sigma_xy_m[used]),
    )


# A mean farther from 0 than this many of its standard errors counts as a bias.
_BIASED = 1.959964
_N_RESAMPLES = 4000


def rmse_factors(n: int, level: float = 0.95) -> tuple[float, float]:
    r"""Return what an observed RMSE is to be multiplied by for the ends of its interval.

    .. math::  \sqrt{n / \chi^2_{n,\,1-\alpha/2}} \quad\text{and}\quad \sqrt{n / \chi^2_{n,\,\alpha/2}}

    for normal, independent errors without bias. With n − 1 in place of n on both sides it is
    the interval of a standard deviation.

    >>> [round(factor, 4) for factor in rmse_factors(20)]
    [0.7651, 1.4441]
    """
    if n < 1 or not 0.0 < level < 1.0:
        raise InputError(f"an interval at the level {level} of {n} errors does not exist; give one or more.")
    tail = 0.5 * (1.0 - level)
    low, high = 2.0 * gammaincinv(0.5 * n, [1.0 - tail, tail])  # quantiles of χ²
    return float(np.sqrt(n / low)), float(np.sqrt(n / high))


@dataclass(frozen=True)
class RmseInterval:
    """The 95 % interval of an RMSE.

    `low_m`, `high_m`: its ends [m]. `method`: ``chi-square`` for errors whose mean does not differ from 0;
    ``bootstrap`` where it does, for then their squares follow no χ² distribution.
    """

    low_m: float
    high_m: float
    method: str

    @classmethod
    def of(cls, errors: Any) -> Self:
        """Return the interval of independent errors (N,) [m].

        `errors` (N,): independent errors [m].

        Nodes of one map are no independent errors: use this for checkpoints that lie apart.
        The bootstrap is too narrow for fewer than about ten errors. Equal errors give equal intervals.

        >>> interval = RmseInterval.of([0.1, -0.1, 0.1, -0.1, 0.1])
        >>> round(interval.low_m, 4), round(interval.high_m, 4), interval.method
        (0.0624, 0.2453, 'chi-square')
        """
        e = np.asarray(errors, dtype=np.float64).ravel()
        n = len(e)
        low, high = rmse_factors(n)
        rmse = float(np.sqrt(np.mean(e**2)))
        if n < 3 or abs(e.mean()) <= _BIASED * e.std(ddof=1) / np.sqrt(n):
            return cls(low * rmse, high * rmse, "chi-square")
        return cls(*_resampled(e), "bootstrap")


def _resampled(e: FloatArray) -> tuple[float, float]:
    """Return the percentiles of the RMSE over samples drawn with replacement; always the same draws for equal errors."""
    rng = stream(len(e), "rmse bootstrap")
    squares = (e**2)[rng.integers(0, len(e), (_N_RESAMPLES, len(e)))].mean(axis=1)
    low, high = np.sqrt(np.percentile(squares, (2.5, 97.5)))
    return float(low), float(high)


BLUNDER_FACTOR = 3.0
"""Errors beyond this many times the limit of the RMSE are to be investigated."""


# Blunders: so many times the error that this share of at least so many checkpoints stays below; the worst are named.
_TIMES_USUAL, _USUAL_SHARE, _LEAST_CHECKPOINTS, _N_NAMED = 10.0, 0.8, 10, 5
# Heights in feet: their ratio to those of the map, to this share, where they are not near sea level.
_FEET_TOLERANCE, _LEAST_FEET = 0.01, 300.0
# Shares and spacings are compared with a hair of slack, so that 20 % of 30 points may be 6 of 30.
_SLACK = 1e-9


def missing_cover(errors: CheckpointErrors) -> list[str]:
    """Return what the map misses of the area."""
    if errors.covered_share >= LEAST_COVERED:
        return []
    return [f"heights on {LEAST_COVERED:.1%} of the area (the map covers {errors.covered_share:.1%})"]


def least_numbers(standard: Standard, area_km2: float) -> tuple[int, int]:
    """Return the least numbers of checkpoints on open and on vegetated ground."""
    if standard.name == ASPRS_2014:
        return checkpoints_2014(area_km2)
    n = checkpoints_edition_2(area_km2)
    return n, n


def missing_number(standard: Standard, errors: CheckpointErrors, n_least: int, ground: str) -> list[str]:
    """Return a condition where there are too few checkpoints."""
    n = len(errors.errors_m)
    if n >= n_least:
        return []
    return [f"{n_least} checkpoints on {ground} ground (there are {n}){_mark(standard, 'n_least')}"]


def missing_accuracy(standard: Standard, errors: CheckpointErrors, class_m: float | None) -> list[str]:
    """Compare the checkpoints' accuracy with what the class asks of them."""
    if class_m is None or standard.sharper is None:
        return []
    needed = class_m / standard.sharper
    if errors.checkpoint_rmse_m <= needed * (1.0 + _SLACK):
        return []
    return [
        f"checkpoints accurate to {needed:.3g} m ({standard.sharper:g} times better than the class), not {errors.checkpoint_rmse_m:.3g} m"
    ]


def missing_in_general(standard: Standard, errors: CheckpointErrors) -> list[str]:
    """Return what the standard misses in the number of checkpoints."""
    return [] if standard.n_least is None else missing_number(standard, errors, standard.n_least, "any")


def guidance_of(standard: Standard, errors: CheckpointErrors) -> list[str]:
    """Return where the checkpoints are spread less evenly than the standard advises; that is no condition.

    The NSSDA says how points *may* be distributed over a rectangular area of uniform accuracy (appendix 3-C).
    """
    advised = []
    share, spacing = standard.quadrant_share, standard.spacing_share
    found = min(errors.spread.quadrant_shares)
    if share is not None and found < share - _SLACK:
        advised.append(
            f"guidance: {share:.0%} of the checkpoints in every quarter of the area (one has {found:.0%}){_mark(standard, 'quadrant_share')}"
        )
    apart = errors.spread.spacing_share
    if spacing is not None and apart < spacing - _SLACK:
        advised.append(
            f"guidance: {spacing:.0%} of the diagonal between any two checkpoints (two are {apart:.1%} apart){_mark(standard, 'spacing_share')}"
        )
    return advised


def cautions_of(standard: Standard, errors: CheckpointErrors, limit_m: float | None) -> list[str]:
    """Return errors to investigate: a bias, blunders, a datum that is not stated."""
    found = datum_cautions(errors)
    if limit_m is None:
        return found
    bias = abs(float(np.mean(errors.errors_m)))
    if standard.bias_share is not None and bias > standard.bias_share * limit_m:
        found.append(
            f"the mean error {bias:.3g} m exceeds {standard.bias_share:.0%} of the class: investigate{_mark(standard, 'bias_share')}"
        )
    blunders = errors.beyond(BLUNDER_FACTOR * limit_m)
    if blunders:
        found.append(
            f"errors beyond {BLUNDER_FACTOR:g} times the limit at {', '.join(blunders)}: investigate, they are in the figures{_mark(standard, 'blunders')}"
        )
    return found


def datum_cautions(errors: CheckpointErrors) -> list[str]:
    """Return cautions where a vertical datum is not stated, and where heights are in feet or a few are blunders."""
    if _are_feet(errors):
        return [
            "the heights of the checkpoints are 3.28 times those of the map, as feet are; convert them to metres"
        ]
    unstated = [
        f"{' and '.join(errors.without_datum)} state no vertical datum; datums can differ by tens of metres (--datum)"
    ]
    return (unstated if errors.without_datum else []) + _blunder_cautions(errors)


def _without_datum(dem: Dem, checkpoints: Checkpoints) -> tuple[str, ...]:
    """Return which of map and checkpoints state no vertical datum."""
    datums = {"the heights of the map": dem.vertical_datum, "the checkpoints": checkpoints.vertical_datum}
    return tuple(name for name, datum in datums.items() if datum == UNSTATED)


def _are_feet(errors: CheckpointErrors) -> bool:
    if errors.xyz is None or not len(errors.errors_m) or errors.xyz[:, 2].min() <= 0.0:
        return False
    height = errors.xyz[:, 2]
    ratio = float(np.median((height + errors.errors_m) / height)) / FOOT_M
    return bool(abs(ratio - 1.0) < _FEET_TOLERANCE and np.median(height) > _LEAST_FEET)


def _blunder_cautions(errors: CheckpointErrors) -> list[str]:
    """Return a caution where few checkpoints err by far more than all others; none is left out for its error."""
    n = len(errors.errors_m)
    size_m = np.abs(errors.errors_m - np.median(errors.errors_m))
    usual_m = (
        max(float(np.quantile(size_m, _USUAL_SHARE)), float(np.median(errors.sigma_z_m))) if n else np.inf
    )
    rows = np.flatnonzero(size_m > _TIMES_USUAL * usual_m)
    if n < _LEAST_CHECKPOINTS or not len(rows):
        return []
    worst = rows[np.argsort(-size_m[rows], kind="stable")][:_N_NAMED]
    named = ", ".join(f"{errors.names[row]} ({errors.errors_m[row]:+.2f} m)" for row in worst)
    return [
        f"{len(rows)} of {n} checkpoints err by more than {_TIMES_USUAL:g} times as much as most others, and the statistics hang on "
        f"them: {named}; check whether they are blunders"
    ]


def _mark(standard: Standard, what: str) -> str:
    return " (unverified)" if what in standard.unverified else ""
