"""Independent checkpoints and the errors of a map at them."""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
import shapely
from pyproj import CRS
from scipy.spatial import cKDTree

from survey.core.arrays import BoolArray, FloatArray, checked, frozen
from survey.core.errors import InputError
from survey.core.geodesy import UNSTATED, projected_crs, same_crs, same_vertical_datum, transformed
from survey.core.text import printable
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.io.named_points import read_named_points
from survey.io.point_columns import PLACE
from survey.scoring.covered_area import covered_share

CONTROL_M = 0.10
"""A checkpoint this near to a control point counts as the same mark [m]."""


@dataclass(frozen=True)
class Checkpoints:
    """Places whose height was measured independently of the map, and better.

    Parameters
    ----------
    xyz : (N, 3) array_like
        Easting, northing, height [m].
    sigma_z_m : float or (N,) array_like
        Standard deviation of the heights [m].
    crs : str or pyproj.CRS
        Projected, in metres.
    vertical_datum : str
        What the heights count from; ``""`` when unstated.
    names : tuple of str, optional
        By default ``"1"``, ``"2"`` …
    vegetated : (N,) array_like of bool, optional
        Points in tall grass, crops, brush or forest, which newer standards judge apart; on
        ice there are none.

    Raises
    ------
    InputError
        No points, wrong shapes, NaN, a sigma of 0 or less, two points at one place.

    Examples
    --------
    >>> Checkpoints([[0.0, 0.0, 5.0]], 0.02, "EPSG:32608").names
    ('1',)
    """

    xyz: FloatArray
    sigma_z_m: Any
    crs: CRS
    vertical_datum: str = UNSTATED
    names: tuple[str, ...] = ()
    vegetated: Any = None

    def __post_init__(self) -> None:
        xyz = checked(self.xyz, (None, 3), "the checkpoints")
        n = len(xyz)
        if n == 0:
            raise InputError("there are no checkpoints; give at least one.")
        sigma = checked(
            np.broadcast_to(np.asarray(self.sigma_z_m, dtype=np.float64), (n,)), (n,), "the sigmas"
        )
        if (sigma <= 0.0).any():
            raise InputError(
                f"{int((sigma <= 0).sum())} checkpoints have a sigma of 0 or less; state how well they were measured."
            )
        names = tuple(self.names) or tuple(str(k) for k in range(1, n + 1))
        cover = np.zeros(n, dtype=bool) if self.vegetated is None else np.asarray(self.vegetated, dtype=bool)
        if len(names) != n or cover.shape != (n,):
            raise InputError(
                f"there are {n} checkpoints, {len(names)} names and {cover.size} land covers; give one each."
            )
        for name, value in (("xyz", xyz), ("sigma_z_m", sigma), ("names", names)):
            object.__setattr__(self, name, value)
        object.__setattr__(self, "vegetated", frozen(cover, bool))
        object.__setattr__(self, "crs", projected_crs(self.crs, "the set of checkpoints"))
        self._refuse_repeats()

    def __len__(self) -> int:
        return len(self.xyz)

    @classmethod
    def read(
        cls,
        path: str | Path,
        *,
        crs: Any = None,
        sigma_m: float | None = None,
        vertical_datum: str | None = None,
    ) -> Self:
        """Read checkpoints from CSV, GeoPackage, GeoJSON, GPX, LAS/LAZ or PLY.

        Beside the place, the columns ``sigma_z_m``, ``name``, ``vegetated`` (0 or 1) and
        ``control`` (0 or 1) are understood.

        Parameters
        ----------
        path : str or pathlib.Path
            The file; its ending names the format.
        crs : str or pyproj.CRS, optional
            The projected CRS to work in: of the file when it names none, else transformed to.
        sigma_m : float, optional
            Standard deviation of all heights [m], for files that state none.
        vertical_datum : str, optional
            For files that do not state it.

        Raises
        ------
        InputError
            A damaged file, no uncertainty, or points that were control: a map agrees with
            the points that it was made from.
        """
        named = read_named_points(path, "the checkpoint file")
        table = named.table
        columns = table.columns
        control = columns.get("control")
        if control is not None and (control != 0.0).any():
            used = [named.names[k] for k in np.flatnonzero(control)]
            raise InputError(
                f"{path}: {_listed(used)} served as control; a map agrees with what it was made from, leave them out."
            )
        sigma = columns.get("sigma_z_m", sigma_m)
        if sigma is None:
            raise InputError(
                f"{path} states no uncertainty of the checkpoints; add a column sigma_z_m or name one sigma for all."
            )
        stated = table.vertical_datum
        if stated and vertical_datum:
            same_vertical_datum(stated, vertical_datum, f"{path} and the request")
        xyz = np.column_stack([columns[name] for name in PLACE])
        system = projected_crs(table.crs if crs is None else crs, str(path))
        if table.crs is not None:
            xyz = np.column_stack([transformed(xyz[:, :2], table.crs, system, str(path)), xyz[:, 2]])
        try:
            return cls(
                xyz,
                sigma,
                system,
                stated or vertical_datum or UNSTATED,
                tuple(printable(name) for name in named.names),
                columns.get("vegetated", np.zeros(len(xyz))) != 0.0,
            )
        except InputError as error:
            raise InputError(f"{path}: {error}") from error

    @property
    def xy(self) -> FloatArray:
        """Easting and northing (N, 2) [m]."""
        return self.xyz[:, :2]

    def refuse_control(self, control_xy: Any, tolerance_m: float = CONTROL_M) -> None:
        """Refuse when a checkpoint is one of the points (M, 2) that the map was made from [m].

        Parameters
        ----------
        control_xy : (M, 2) array_like
            Easting and northing of the control points [m].
        tolerance_m : float
            Distance below which two points are the same mark [m].

        Raises
        ------
        InputError
            Names the checkpoints that lie within the tolerance of a control point.
        """
        control = np.asarray(control_xy, dtype=np.float64).reshape(-1, 2)
        if len(control) == 0:
            return
        near = np.asarray(cKDTree(control).query(self.xy)[0]) <= tolerance_m
        if near.any():
            used = [self.names[k] for k in np.flatnonzero(near)]
            raise InputError(
                f"{_listed(used)} lie within {tolerance_m:g} m of control points; a map agrees with what it was made from, "
                "leave them out of the checkpoints."
            )

    def _refuse_repeats(self) -> None:
        pairs = cKDTree(self.xy).query_pairs(1e-6)
        if pairs:
            i, j = min(pairs)
            raise InputError(
                f"the checkpoints {self.names[i]} and {self.names[j]} lie at one place; count each place once."
            )


@dataclass(frozen=True)
class Spread:
    """How checkpoints are spread over the area that they speak for.

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
        mask = self.vegetated if vegetated else ~self.vegetated
        if not mask.any():
            return None
        names = tuple(name for name, taken in zip(self.names, mask, strict=True) if taken)
        return replace(
            self,
            errors_m=self.errors_m[mask],
            sigma_z_m=self.sigma_z_m[mask],
            vegetated=self.vegetated[mask],
            names=names,
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
    )


def control_places(path: str | Path, crs: Any) -> FloatArray:
    """Read the places (M, 2) [m] of the points that a map was made from; their other columns do not matter."""
    table = read_named_points(path, "the control file").table
    xy = np.column_stack([table.columns[name] for name in PLACE[:2]])
    return xy if table.crs is None else transformed(xy, table.crs, projected_crs(crs, "the map"), str(path))


def within_reach(xy: FloatArray, route_line: Any, reach_m: float) -> BoolArray:
    """Tell which places (N, 2) lie within a distance [m] of a line."""
    near: BoolArray = shapely.dwithin(shapely.points(xy), route_line, reach_m)
    return near


def _listed(names: list[str]) -> str:
    shown = ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")
    return f"checkpoint{'s' if len(names) > 1 else ''} {shown}"
