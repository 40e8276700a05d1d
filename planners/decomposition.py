"""Parallel swaths over any polygon: clipped to the free ground, cut into cells, at the best angle."""

from typing import Any

import numpy as np
import shapely

from planners.transit import FreeGround
from survey.arrays import FloatArray, IntArray
from survey.errors import ConfigError, InputError

_SHORTEST_M = 0.01
"""Clipping leaves crumbs where a line grazes a corner; shorter ones than this are dropped [m]."""


def swaths_on(
    ground: FreeGround, spacing_m: float, heading_deg: float, *, inset_m: float = 0.0
) -> list[FloatArray]:
    """Lay parallel swaths over the free ground.

    The ground's width across the heading is divided into ``n = ceil(width / spacing)``
    equal strips; a swath runs along the middle of each, from border to border, so a
    rectangle gets the lines at ``(i + 1/2) L / n``.

    Parameters
    ----------
    ground : FreeGround
        Where rovers may be.
    spacing_m : float
        Largest distance between neighbouring swaths [m].
    heading_deg : float
        Direction of the first swath, counter-clockwise from east [deg]; the following
        swaths lie to its right.
    inset_m : float
        How far swaths end before the border, across every border [m].

    Returns
    -------
    list of (2, 2) ndarray
        Both ends of every swath [m], line by line, all pointing along the heading.

    Raises
    ------
    ConfigError
        A spacing that is not greater than 0, an inset below 0.
    InputError
        Ground on which no swath fits.
    """
    _check_spacing(spacing_m)
    if not (np.isfinite(inset_m) and inset_m >= 0.0):
        raise ConfigError(f"the inset is {inset_m} m; it must be 0 or greater.")
    lines = clipped(ground, _lines_over(ground.polygon, spacing_m, heading_deg), inset_m=inset_m)
    if not lines:
        xmin, ymin, xmax, ymax = ground.polygon.bounds
        raise InputError(
            f"no swath fits on the ground of {xmax - xmin:.1f} × {ymax - ymin:.1f} m with an inset of {inset_m:g} m; "
            "reduce the inset or give a larger area."
        )
    return lines


def _check_spacing(spacing_m: float) -> None:
    if not (np.isfinite(spacing_m) and spacing_m > 0.0):
        raise ConfigError(f"the spacing of the swaths is {spacing_m} m; it must be greater than 0.")


def _axes(heading_deg: float) -> tuple[FloatArray, FloatArray]:
    """Return the unit vectors along the heading and to its right; exact for multiples of 90°."""
    quarter, rest = divmod(heading_deg, 90.0)
    angle = np.radians(rest)
    c, s = (np.cos(angle), np.sin(angle)) if rest else (1.0, 0.0)
    for _ in range(int(quarter) % 4):
        c, s = -s, c
    return np.array([c, s]) + 0.0, np.array([s, -c]) + 0.0


def _lines_over(polygon: Any, spacing_m: float, heading_deg: float) -> list[FloatArray]:
    """Return the middle lines of equal strips over the polygon, longer than it."""
    along, right = _axes(heading_deg)
    xy = shapely.get_coordinates(polygon)
    u, v = xy @ along, xy @ right
    n = max(int(np.ceil((v.max() - v.min()) / spacing_m - 1e-9)), 1)
    offsets = v.min() + (np.arange(n) + 0.5) * (v.max() - v.min()) / n
    reach = 1.0 + 0.01 * (u.max() - u.min())
    first, last = (u.min() - reach) * along, (u.max() + reach) * along
    return [np.array([first + offset * right, last + offset * right]) for offset in offsets]


def clipped(ground: FreeGround, lines: list[FloatArray], *, inset_m: float = 0.0) -> list[FloatArray]:
    """Cut polylines (N, 2) to the free ground; none of the pieces has a metre outside it.

    Where the exact piece is not covered by the ground because of rounding, it is cut at
    a border moved `MARGIN_M` inwards instead.
    """
    shape = ground.polygon if inset_m == 0.0 else ground.polygon.buffer(-inset_m, join_style="mitre")
    inner = ground.inner if inset_m == 0.0 else shape
    shapely.prepare(shape)
    pieces: list[FloatArray] = []
    for line in lines:
        for piece in _pieces(shape, line):
            if ground.covers(shapely.linestrings(piece)):
                pieces.append(piece)
            else:
                pieces.extend(p for p in _pieces(inner, piece) if ground.covers(shapely.linestrings(p)))
    return pieces


def _pieces(shape: Any, line: FloatArray) -> list[FloatArray]:
    """Return the parts of a polyline that lie in a shape, in its order and direction."""
    whole = shapely.linestrings(line)
    cut = shapely.get_parts(shapely.intersection(shape, whole))
    parts = [part for part in cut if part.geom_type == "LineString" and part.length > _SHORTEST_M]
    if len(line) > 2 and len(parts) > 1:
        parts = list(shapely.get_parts(shapely.line_merge(shapely.multilinestrings(parts))))
    arrays = []
    for part in parts:
        xy = shapely.get_coordinates(part)
        ends = shapely.line_locate_point(whole, shapely.points(xy[[0, -1]]))
        arrays.append((float(min(ends)), xy if ends[0] <= ends[1] else xy[::-1]))
    return [xy for _, xy in sorted(arrays, key=lambda item: item[0])]


def ends_of(swaths: list[FloatArray]) -> FloatArray:
    """Return the first and last points (2 N, 2) of the swaths, swath by swath."""
    return np.array([[swath[0], swath[-1]] for swath in swaths], dtype=np.float64).reshape(-1, 2)


def cells(swaths: list[FloatArray], heading_deg: float) -> IntArray:
    """Group straight swaths into the cells of a boustrophedon decomposition (Choset 2000).

    Swaths on neighbouring lines belong to one cell when each is the other's only
    neighbour; a line that splits, merges, begins or ends starts a new cell.

    Parameters
    ----------
    swaths : list of (2, 2) ndarray
        As `swaths_on` returns them [m].
    heading_deg : float
        Their heading, counter-clockwise from east [deg].

    Returns
    -------
    (N,) ndarray of int
        The cell of each swath, counted from 0 in the order of the lines.
    """
    along, right = _axes(heading_deg)
    ends = ends_of(swaths).reshape(-1, 2, 2)
    u = np.sort(ends @ along, axis=1)
    line = np.unique(np.round(ends[:, 0] @ right, 3), return_inverse=True)[1]
    cell = np.full(len(swaths), -1, dtype=np.int64)
    n_cells = 0
    for i in range(len(swaths)):
        before = _beside(u, i, np.flatnonzero(line == line[i] - 1))
        if len(before) == 1 and len(_beside(u, before[0], np.flatnonzero(line == line[i]))) == 1:
            cell[i] = cell[before[0]]
        else:
            cell[i], n_cells = n_cells, n_cells + 1
    return cell


def _beside(u: FloatArray, i: int, others: IntArray) -> IntArray:
    """Return those of `others` whose stretch along the heading overlaps that of swath `i`."""
    beside: IntArray = others[(u[others, 0] < u[i, 1]) & (u[others, 1] > u[i, 0])]
    return beside
