"""Independent checkpoints: their files, their separation from control points, and the design of new ones.

`Checkpoints` holds places whose height was measured independently of the map; `Checkpoints.refuse_control`
refuses those within 0.1 m of a control point. `design_checkpoints` draws places at random: at least 20 % in
each quarter of the area, no two nearer than 10 % of its diagonal (NSSDA), on gentle ground and within reach of
the route.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
import shapely
from pyproj import CRS

from survey.core import (
    UNSTATED,
    BoolArray,
    FloatArray,
    InputError,
    checked,
    frozen,
    printable,
    projected_crs,
    same_vertical_datum,
)
from survey.core.arrays import lattice_places
from survey.core.map_scale import MapScale
from survey.core.transformation import metric_crs, transformed
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.route import Route
from survey.io.point_files import NamedPoints, read_named_points
from survey.io.point_table import PLACE, PointTable

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
    map_xy : (N, 2) array_like, optional
        Easting and northing at which each mark was found in the map [m], in the CRS of the map; NaN where it was not.
    sigma_xy_m : float or (N,) array_like, optional
        Standard deviation of the horizontal distance of each checkpoint from its true place [m]; needed with `map_xy`.

    Raises
    ------
    InputError
        No points, wrong shapes, NaN, a sigma of 0 or less, two points at one place, places in the map
        without `sigma_xy_m`.

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
    map_xy: Any = None
    sigma_xy_m: Any = None

    def __post_init__(self) -> None:
        xyz = checked(self.xyz, (None, 3), "the checkpoints")
        n = len(xyz)
        if n == 0:
            raise InputError("there are no checkpoints; give at least one.")
        sigma = _positive(self.sigma_z_m, n, "sigma", "measured")
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
        if self.map_xy is not None:
            self._check_places_in_map()
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
        columns: Mapping[str, str] | None = None,
        units: str | None = None,
    ) -> Self:
        """Read checkpoints from a table (CSV, text), GeoPackage, GeoJSON, GPX, LAS/LAZ or PLY.

        Beside the place, the columns ``sigma_z_m``, ``name``, ``vegetated`` (0 or 1) and
        ``control`` (0 or 1) are understood, and those of GNSS exports (``Point, Easting, Northing,
        Elevation, SDV``). Columns ``map_x_m``, ``map_y_m`` with ``sigma_xy_m`` state where each mark was found in the map.

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
        columns : mapping of str to str, optional
            Column of a table by own name, such as ``{"x_m": "Rechtswert", "sigma_z_m": "SDV"}``.
        units : {"m", "ft", "us-ft"}, optional
            Unit of heights and their standard deviations where neither column, header nor CRS states it.

        Raises
        ------
        InputError
            A damaged file, no uncertainty, or points that were control: a map agrees with
            the points that it was made from.
        """
        named = read_named_points(path, "the checkpoint file", columns, crs=crs, units=units)
        crs = None if crs is None else metric_crs(crs, str(path)).crs
        table = named.table
        _refuse_control(path, named)
        sigma = table.columns.get("sigma_z_m", sigma_m)
        if sigma is None:
            raise InputError(
                f"{path} states no uncertainty of the checkpoints' heights; name one for all with --sigma, choose a column with --columns sigma_z=NAME, or add a column sigma_z_m."
            )
        stated = table.vertical_datum
        if stated and vertical_datum:
            same_vertical_datum(stated, vertical_datum, f"{path} and the request")
        xyz, system = _places(path, table, crs)
        vegetated = table.columns.get("vegetated", np.zeros(len(xyz))) != 0.0
        names = tuple(printable(name) for name in named.names)
        found = [table.columns.get(name) for name in ("map_x_m", "map_y_m")]
        map_xy = None if found[0] is None or found[1] is None else np.column_stack([found[0], found[1]])
        sigma_xy = None if map_xy is None else table.columns.get("sigma_xy_m")
        datum = stated or vertical_datum or UNSTATED
        try:
            return cls(xyz, sigma, system, datum, names, vegetated, map_xy, sigma_xy)
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
        near = np.asarray(_tree(control).query(self.xy)[0]) <= tolerance_m
        if near.any():
            used = [self.names[k] for k in np.flatnonzero(near)]
            raise InputError(
                f"{_listed(used)} lie within {tolerance_m:g} m of control points; a map agrees with what it was made from, "
                "leave them out of the checkpoints."
            )

    def _check_places_in_map(self) -> None:
        """Refuse places in the map of another number, or without their uncertainty."""
        n = len(self.xyz)
        places = np.asarray(self.map_xy, dtype=np.float64)
        if places.shape != (n, 2) or np.isinf(places).any():
            raise InputError(
                f"there are {n} checkpoints; two numbers or NaN were expected for each in map_xy."
            )
        if self.sigma_xy_m is None:
            raise InputError(
                "the checkpoints state where they were found in the map and not how well they were placed; add a column "
                "sigma_xy_m, or choose one with --columns sigma_xy=NAME."
            )
        object.__setattr__(self, "map_xy", frozen(places))
        object.__setattr__(self, "sigma_xy_m", _positive(self.sigma_xy_m, n, "sigma_xy", "placed"))

    def _refuse_repeats(self) -> None:
        pairs = _tree(self.xy).query_pairs(1e-6)
        if pairs:
            i, j = min(pairs)
            raise InputError(
                f"the checkpoints {self.names[i]} and {self.names[j]} lie at one place; count each place once."
            )


def _positive(sigma: Any, n: int, name: str, done: str) -> FloatArray:
    """Return one standard deviation (N,) for each checkpoint; refuse those of 0 or less."""
    sigmas = checked(np.broadcast_to(np.asarray(sigma, dtype=np.float64), (n,)), (n,), "the sigmas")
    if (sigmas <= 0.0).any():
        raise InputError(
            f"{int((sigmas <= 0).sum())} checkpoints have a {name} of 0 or less; state how well they were {done}."
        )
    return sigmas


def _refuse_control(path: str | Path, named: NamedPoints) -> None:
    """Refuse points that the map was made from."""
    control = named.table.columns.get("control")
    if control is not None and (control != 0.0).any():
        used = [named.names[k] for k in np.flatnonzero(control)]
        raise InputError(
            f"{path}: {_listed(used)} served as control; a map agrees with what it was made from, leave them out."
        )


def _places(path: str | Path, table: PointTable, crs: Any) -> tuple[FloatArray, CRS]:
    """Return the places (N, 3) of a table in a projected CRS, and that CRS."""
    xyz = np.column_stack([table.columns[name] for name in PLACE])
    system = projected_crs(table.crs if crs is None else crs, str(path))
    if table.crs is not None:
        xyz = np.column_stack([transformed(xyz[:, :2], table.crs, system, str(path)), xyz[:, 2]])
    return xyz, system


def control_places(path: str | Path, crs: Any) -> FloatArray:
    """Read the places (M, 2) [m] of the points that a map was made from; their other columns do not matter."""
    table = read_named_points(path, "the control file", crs=crs, units="m").table
    xy = np.column_stack([table.columns[name] for name in PLACE[:2]])
    return xy if table.crs is None else transformed(xy, table.crs, projected_crs(crs, "the map"), str(path))


def within_reach(xy: FloatArray, route_line: Any, reach_m: float) -> BoolArray:
    """Return which places (N, 2) lie within a distance [m] of a line."""
    near: BoolArray = shapely.dwithin(shapely.points(xy), route_line, reach_m)
    return near


def _listed(names: list[str]) -> str:
    shown = ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")
    return f"checkpoint{'s' if len(names) > 1 else ''} {shown}"


LEAST_SHARE = 0.20
"""Share of the points in each quarter of the area (NSSDA)."""
LEAST_SPACING = 0.10
"""Least distance between two points over the diagonal of the area (NSSDA)."""
_N_CANDIDATES_A_SIDE = 120
_N_TRIES = 60


def design_checkpoints(
    area: SurveyArea,
    n: int,
    rng: np.random.Generator,
    *,
    terrain: Dem | None = None,
    max_slope_deg: float = 10.0,
    route: Route | None = None,
    reach_m: float = 50.0,
) -> FloatArray:
    """Choose n places for checkpoints.

    Each quarter of the area's bounding rectangle holds at least 20 % of them, no two are
    nearer than 10 % of its diagonal, all lie on ground that is gentle and within reach of
    the route. Within these bounds places are drawn at random, so that their errors represent
    the area.

    Parameters
    ----------
    area : SurveyArea
        Places lie on its free ground.
    n : int
        Number of places.
    rng : numpy.random.Generator
        For the draw.
    terrain : Dem, optional
        Coarse heights; steeper ground is left out, for there an error in place is one in height.
    max_slope_deg : float
        Steepest ground [deg]; the scale factor of the CRS is applied where it differs from 1 by more than 1 %.
    route : Route, optional
        Places too far from it are left out.
    reach_m : float
        Largest distance from the route [m].

    Returns
    -------
    (n, 2) ndarray
        Easting and northing [m], from south-west to north-east by quarters.

    Raises
    ------
    InputError
        That many places do not fit; the message states how many candidates each bound leaves.

    Notes
    -----
    A tenth of the diagonal between neighbours leaves room for at most about 60 points in a square.

    Examples
    --------
    >>> area = SurveyArea.rectangle((0.0, 0.0, 600.0, 600.0), "EPSG:32608")
    >>> places = design_checkpoints(area, 30, np.random.default_rng(1))
    >>> from survey.scoring.standards.checkpoint_errors import Spread
    >>> spread = Spread.of(places, area)
    >>> min(spread.quadrant_shares) >= 0.2, spread.spacing_share >= 0.1
    (True, True)
    """
    if n < 1:
        raise InputError(f"{n} checkpoints were asked for; one or more can be placed.")
    candidates = _candidates(area, terrain, max_slope_deg, route, reach_m)
    quarter = _quarter(candidates, area)
    xmin, ymin, xmax, ymax = area.bounds
    apart_m = LEAST_SPACING * float(np.hypot(xmax - xmin, ymax - ymin))
    chosen = _most_drawn(candidates, quarter, n, least=_least(n), apart_m=apart_m, rng=rng)
    if len(chosen) == n:
        return _in_order(candidates, quarter, chosen)
    *counts, last = np.bincount(quarter, minlength=4)
    raise InputError(
        f"{n} checkpoints do not fit: {len(chosen)} were placed at {apart_m:.0f} m from one another, with {', '.join(map(str, counts))} "
        f"and {last} candidates in the four quarters on gentle ground within reach; ask for fewer, allow steeper ground or a longer reach."
    )


def fitting_checkpoints(
    area: SurveyArea, n: int, rng: np.random.Generator, **ground: Any
) -> tuple[FloatArray, str]:
    """Choose up to n places for checkpoints, less well spread where the area leaves no other choice.

    `ground`: as for `design_checkpoints`. Returns: places (N, 2) [m], and in a sentence what could not be kept; empty
    where all was.
    """
    try:
        return design_checkpoints(area, n, rng, **ground), ""
    except InputError as error:
        candidates = _candidates(area, **ground)
        if not len(candidates):
            raise InputError(
                "no ground of the area is gentle and within reach; allow steeper ground or a longer reach."
            ) from error
    quarter, chosen = _quarter(candidates, area), np.empty(0)
    xmin, ymin, xmax, ymax = area.bounds
    for share in (1.0, 0.5, 0.25):
        apart_m = share * LEAST_SPACING * float(np.hypot(xmax - xmin, ymax - ymin))
        chosen = _most_drawn(candidates, quarter, n, least=0, apart_m=apart_m, rng=rng)
        if len(chosen) == n:
            break
    least = int(np.bincount(quarter[chosen], minlength=4).min())
    lost = [
        "" if len(chosen) == n else f"{len(chosen)} of {n} fit on gentle ground within reach",
        ""
        if share == 1.0
        else f"neighbours are {apart_m:.0f} m apart, {100 * share * LEAST_SPACING:.2g} % of the diagonal",
        ""
        if least >= _least(len(chosen))
        else f"a quarter of the area holds {least}, fewer than {LEAST_SHARE:.0%}",
    ]
    return _in_order(candidates, quarter, chosen), "; ".join(part for part in lost if part) + "."


def _least(n: int) -> int:
    """Return how many of n checkpoints each quarter holds at least."""
    return int(np.ceil(LEAST_SHARE * n - 1e-9)) if n >= 4 else 0


def _most_drawn(places: FloatArray, quarter: Any, n: int, **bounds: Any) -> Any:
    """Draw places several times; return the indices of the first n, or of the most that were found."""
    most: Any = np.empty(0, dtype=np.int64)
    for _ in range(_N_TRIES):
        chosen = _drawn(places, quarter, n, **bounds)
        most = max(most, chosen, key=len)
        if len(most) == n:
            break
    return most


def _in_order(places: FloatArray, quarter: Any, chosen: Any) -> FloatArray:
    """Return chosen places from south-west to north-east by quarters."""
    ordered: FloatArray = frozen(places[chosen[np.argsort(quarter[chosen], kind="stable")]])
    return ordered


def _candidates(
    area: SurveyArea,
    terrain: Dem | None = None,
    max_slope_deg: float = 10.0,
    route: Route | None = None,
    reach_m: float = 50.0,
) -> FloatArray:
    """Return the places of a fine grid over the area that can be stood on and reached."""
    xmin, ymin, xmax, ymax = area.bounds
    x, y = (
        low + (np.arange(_N_CANDIDATES_A_SIDE) + 0.5) * (high - low) / _N_CANDIDATES_A_SIDE
        for low, high in ((xmin, xmax), (ymin, ymax))
    )
    places = lattice_places(x, y)
    fit = area.contains(places)
    factor = MapScale.over(area.crs, area.bounds).notable_factor
    if terrain is not None:
        area.require_crs(terrain.crs, "the terrain")
        # NaN, beyond the terrain, compares as false: unknown ground is not chosen.
        fit &= terrain.slope().at(places) <= _grid_slope_deg(max_slope_deg, factor)
    if route is not None:
        area.require_crs(route.crs, "the route")
        fit &= within_reach(places, route.line, reach_m * factor)
    return places[fit]


def _grid_slope_deg(slope_deg: float, factor: float) -> float:
    """Return the slope in the CRS of ground of a slope [deg], for a linear scale factor."""
    return (
        slope_deg if factor == 1.0 else float(np.degrees(np.arctan(np.tan(np.radians(slope_deg)) / factor)))
    )


def _tree(places: FloatArray) -> Any:
    """Return a tree of places (N, 2)."""
    # A tenth of a second: a table that cannot be read is refused without it.
    from scipy.spatial import cKDTree

    return cKDTree(places)


def _quarter(places: FloatArray, area: SurveyArea) -> Any:
    """South-west 0, south-east 1, north-west 2, north-east 3."""
    xmin, ymin, xmax, ymax = area.bounds
    return 2 * (places[:, 1] >= 0.5 * (ymin + ymax)) + (places[:, 0] >= 0.5 * (xmin + xmax))


def _drawn(
    places: FloatArray, quarter: Any, n: int, *, least: int, apart_m: float, rng: np.random.Generator
) -> Any:
    """Draw places one by one, each far from those before; first the least number in every quarter."""
    free: BoolArray = np.ones(len(places), dtype=bool)
    tree = _tree(places)
    chosen: list[int] = []

    def take(mask: BoolArray) -> bool:
        left = np.flatnonzero(free & mask)
        if not len(left):
            return False
        index = int(rng.choice(left))
        chosen.append(index)
        free[tree.query_ball_point(places[index], apart_m * (1.0 - 1e-9))] = False
        return True

    for _ in range(least):
        if not all(take(quarter == k) for k in range(4)):
            return np.array(chosen)
    while len(chosen) < n and take(np.ones(len(places), dtype=bool)):
        pass
    return np.array(chosen)
