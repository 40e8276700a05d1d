"""Errors of a map at checkpoints, and the spread of the checkpoints over the area."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from scipy.spatial import cKDTree

from survey.core.arrays import BoolArray, FloatArray, frozen
from survey.core.crs.agreement import same_crs
from survey.core.crs.vertical_datum import UNSTATED, same_vertical_datum
from survey.core.errors import InputError
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.scoring.covered_area import covered_share
from survey.scoring.standards.checkpoints import Checkpoints


@dataclass(frozen=True)
class Spread:
    """Spread of checkpoints over the area that they represent.

    Parameters
    ----------
    quadrant_shares : (4,) tuple of float
        Shares in the quarters of the bounding rectangle: south-west, south-east, north-west, north-east.
    spacing_share : float
        Least distance between two of them over the rectangle's diagonal; infinite for one point.
    area_m2 : float
        Free ground of the area that is judged, on the ground [m²].
    """

    quadrant_shares: tuple[float, float, float, float]
    spacing_share: float
    area_m2: float

    @classmethod
    def of(cls, xy: Any, area: SurveyArea) -> Self:
        """Measure places (N, 2) [m] against the rectangle around an area.

        Parameters
        ----------
        xy : (N, 2) array_like
            Easting and northing of the checkpoints [m].
        area : SurveyArea
            In the same CRS.

        Returns
        -------
        Spread
            Shares, spacing and area.

        Examples
        --------
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

    Parameters
    ----------
    errors_m : (N,) array_like
        Map minus checkpoint [m].
    sigma_z_m : (N,) array_like
        Standard deviations of the checkpoints [m].
    vegetated : (N,) array_like of bool
        Which lie on vegetated ground.
    names : tuple of str
        The checkpoints.
    spread : Spread
        How they lie in the area.
    left_out : tuple of str
        Checkpoints in the area where the map gives no height.
    n_outside : int
        Checkpoints outside the area.
    has_datums : bool
        Both the map and the checkpoints state the same vertical datum.
    covered_share : float
        Share of the named area on which the map gives a height; 1 where no area was named.
    xyz : (N, 3) ndarray, optional
        Easting, northing and height of the checkpoints [m], where they are known.
    shift_m : (N, 2) ndarray, optional
        Place in the map minus place of the checkpoint, east and north [m]; NaN where a mark was not found in the map.
    sigma_xy_m : (N,) ndarray, optional
        Standard deviations of the horizontal distances of the checkpoints from their true places [m].
    """

    errors_m: FloatArray
    sigma_z_m: FloatArray
    vegetated: BoolArray
    names: tuple[str, ...]
    spread: Spread
    left_out: tuple[str, ...] = ()
    n_outside: int = 0
    has_datums: bool = True
    covered_share: float = 1.0
    xyz: FloatArray | None = None
    shift_m: FloatArray | None = None
    sigma_xy_m: FloatArray | None = None

    @cached_property
    def checkpoint_rmse_m(self) -> float:
        """Root mean square of the checkpoints' own standard deviations [m]."""
        return float(np.sqrt(np.mean(self.sigma_z_m**2)))

    def on(self, *, vegetated: bool) -> "CheckpointErrors | None":
        """Return those on vegetated or on open ground; ``None`` where there are none.

        Parameters
        ----------
        vegetated : bool
            True for vegetated, False for open ground.

        Returns
        -------
        CheckpointErrors or None
            The errors there.
        """
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

        Parameters
        ----------
        limit_m : float
            Largest error that is not named [m].

        Returns
        -------
        tuple of str
            Names of the checkpoints.
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
        dem.vertical_datum == checkpoints.vertical_datum != UNSTATED,
        1.0 if area is None else covered_share(dem, area),
        frozen(checkpoints.xyz[used]),
        None if checkpoints.map_xy is None else frozen((checkpoints.map_xy - checkpoints.xy)[used]),
        None if checkpoints.map_xy is None else frozen(checkpoints.sigma_xy_m[used]),
    )
