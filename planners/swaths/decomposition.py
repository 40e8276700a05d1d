"""Boustrophedon decomposition: parallel swaths clipped to free ground of any shape and grouped into cells.

`swaths_on` lays lines at a spacing, clips each to the ground less a headland for turns, and adds lines where a pocket
of the ground would stay unswept. `cells` joins swaths of neighbouring lines between which no border lies; swaths of a
cell can be driven back and forth without a detour.
"""

from typing import Any

import numpy as np
import shapely
from shapely import Polygon

from planners.config import SwathConfig
from planners.routes.shortest_paths import FreeGround, ends_of
from planners.swaths.reference_lines import CRUMB_M, axes_of, lines_over, pieces_on
from survey.core import ConfigError, FloatArray, InputError, IntArray

_CRUMB_M2 = 1e-4
_THREAD_SHARE = 1e-6
"""Neighbouring strips overlap by this share of a spacing, or rounding would leave threads that join pieces."""
_POCKET_ROUNDS = 4
_CHORDS = 9


def swaths_on(
    ground: FreeGround,
    spacing_m: float,
    heading_deg: float,
    *,
    lines: list[FloatArray] | None = None,
    headland_m: float = 0.0,
) -> list[FloatArray]:
    """Lay parallel swaths over the free ground.

    The ground's width across the heading is divided into ``n = ceil(width / spacing)``
    equal strips; a swath runs along the middle of each, from border to border, so a
    rectangle gets the lines at ``(i + 1/2) L / n``. Ground that no such swath sweeps and
    that is longer than a spacing along the heading (a passage beside a hole, a flat tip)
    gets a swath of its own; `unswept` returns what is still left.

    `spacing_m`: largest distance between neighbouring swaths [m]. `heading_deg`: direction of the first
    swath, counter-clockwise from east [deg]; the following swaths lie to its right. `lines`: to lay swaths on instead.
    `headland_m`: width of the strip along every border that swaths leave free [m]. Returns: both ends of every swath
    [m], cell by cell, all pointing along the heading.
    """
    _require_spacing(spacing_m)
    if not (np.isfinite(headland_m) and headland_m >= 0.0):
        raise ConfigError(f"the headland is {headland_m} m; it must be 0 or greater.")
    if lines is None:
        config = SwathConfig.model_validate({"spacing_m": spacing_m, "shortest_m": 0.0})
        lines, _ = lines_over(without_headland(ground, headland_m), config, heading_deg)
    lines = clip_lines(ground, lines, headland_m=headland_m)
    lines += _in_pockets(ground, lines, spacing_m, heading_deg, headland_m)
    if not lines:
        xmin, ymin, xmax, ymax = ground.polygon.bounds
        raise InputError(
            f"no swath fits on the ground of {xmax - xmin:.1f} × {ymax - ymin:.1f} m with a headland of {headland_m:g} m; "
            "reduce it or give a larger area."
        )
    return _cell_by_cell(lines, heading_deg)


def _require_spacing(spacing_m: float) -> None:
    if not (np.isfinite(spacing_m) and spacing_m > 0.0):
        raise ConfigError(f"the spacing of the swaths is {spacing_m} m; it must be greater than 0.")


def _cell_by_cell(lines: list[FloatArray], heading_deg: float) -> list[FloatArray]:
    """Sort straight lines from left to right of the heading and along it, then by their cells."""
    along, left = axes_of(heading_deg)
    start = np.array([line[0] for line in lines])
    order = np.lexsort((start @ along, np.round(-(start @ left), 6)))
    swaths = [lines[i] for i in order]
    return [swaths[i] for i in np.argsort(cells(swaths, heading_deg), kind="stable")]


def unswept(
    ground: FreeGround, swaths: list[FloatArray], spacing_m: float, *, headland_m: float = 0.0
) -> list[Polygon]:
    """Return the pieces of ground farther than half a spacing from every swath, the largest first.

    Parallel swaths leave the tips beyond their ends where a border is slanted; no metre
    of such a tip is farther than half a spacing from the line that the swath is cut from.
    Ground within `headland_m` of a border is left out.
    """
    _require_spacing(spacing_m)
    half_m = (0.5 + _THREAD_SHARE) * spacing_m
    swept = shapely.union_all(
        shapely.buffer([shapely.linestrings(swath) for swath in swaths], half_m, quad_segs=16)
    )
    rest = shapely.get_parts(shapely.difference(without_headland(ground, headland_m), swept))
    return sorted((piece for piece in rest if piece.area > _CRUMB_M2), key=lambda piece: -piece.area)


def without_headland(ground: FreeGround, headland_m: float) -> Any:
    """Return the ground less a border of that width; the same at swaths, headlands and pockets."""
    return ground.polygon if headland_m == 0.0 else ground.polygon.buffer(-headland_m, quad_segs=4)


def _in_pockets(
    ground: FreeGround, lines: list[FloatArray], spacing_m: float, heading_deg: float, headland_m: float
) -> list[FloatArray]:
    """Lay a swath through every unswept piece that is longer than a spacing along the heading."""
    added: list[FloatArray] = []
    for _ in range(_POCKET_ROUNDS):
        found: list[FloatArray] = []
        for piece in unswept(ground, lines + added, spacing_m, headland_m=headland_m):
            line = _longest_through(piece, heading_deg, spacing_m)
            if line is not None:
                found += clip_lines(ground, [line], headland_m=headland_m)
        if not found:
            break
        added += found
    return added


def _longest_through(piece: Polygon, heading_deg: float, least_m: float) -> FloatArray | None:
    """Return the line along the heading, as long as a piece, that meets most of it; None if the piece is not longer than `least_m`."""
    along, left = axes_of(heading_deg)
    xy = shapely.get_coordinates(piece)
    u, v = xy @ along, xy @ left
    if np.ptp(u) <= least_m:
        return None
    # Places that turn with the piece: its middle, then pairs to both sides of it.
    shares = sorted(np.linspace(0.05, 0.95, _CHORDS), key=lambda share: abs(share - 0.5))
    offsets = v.min() + np.array(shares) * np.ptp(v)
    lines = np.array(
        [[u.min() * along + offset * left, u.max() * along + offset * left] for offset in offsets]
    )
    met = shapely.length(shapely.intersection(piece, shapely.linestrings(lines)))
    best = int(np.flatnonzero(met >= met.max() - CRUMB_M)[0])
    longest: FloatArray = lines[best]
    return longest if met[best] > 0.0 else None


def clip_lines(ground: FreeGround, lines: list[FloatArray], *, headland_m: float = 0.0) -> list[FloatArray]:
    """Cut polylines (N, 2) to the free ground; none of the pieces has a metre outside it.

    Where the exact piece is not covered by the ground because of rounding, it is cut at
    a border moved `MARGIN_M` inwards instead.
    """
    shape = without_headland(ground, headland_m)
    inner = ground.inner if headland_m == 0.0 else shape
    shapely.prepare(shape)
    pieces: list[FloatArray] = []
    for line in lines:
        full = shapely.linestrings(line)
        # Most lines of a route are covered as they are, which is found many times faster than their intersection.
        if shapely.covers(shape, full) and ground.covers(full):
            pieces.append(line)
            continue
        for piece in pieces_on(shape, line):
            if ground.covers(shapely.linestrings(piece)):
                pieces.append(piece)
            else:
                pieces.extend(p for p in pieces_on(inner, piece) if ground.covers(shapely.linestrings(p)))
    return pieces


def cells(swaths: list[FloatArray], heading_deg: float) -> IntArray:
    """Group straight swaths into the cells of a boustrophedon decomposition (Choset 2000).

    Swaths on neighbouring lines belong to one cell when each is the other's only
    neighbour; a line that splits, merges, begins or ends starts a new cell.

    `swaths`: as `swaths_on` returns them [m]. `heading_deg`: their heading, counter-clockwise from east
    [deg]. Returns (N,) int: the cell of each swath, counted from 0 in the order of the lines.
    """
    along, left = axes_of(heading_deg)
    ends = ends_of(swaths).reshape(-1, 2, 2)
    u = np.sort(ends @ along, axis=1)
    line = np.unique(np.round(-(ends[:, 0] @ left), 3), return_inverse=True)[1]
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
