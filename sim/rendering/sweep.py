"""Visibility sweep: approximate range of the first hit in every direction, from one pass per azimuth.

The table is indexed by the tangent of half the azimuth from the viewing direction (columns)
and by the ray's slope (rows, dense near the horizon) and holds 1 / range, which over a plane
is exactly linear in the slope: interpolating it is an excellent start for the second pass.
"""

import math
from typing import NamedTuple

import numpy as np

from sim.rendering.compiled import Doubles, Floats, by_share, entry, f32, i32, row_loop, scalar
from sim.rendering.surface import Surface

NEAR_HORIZON = 0.15
"""Slope at which the rows stop being dense: row coordinate = slope / (0.15 + |slope|)."""
_FARTHEST_M = 2000.0


class View(NamedTuple):
    """Directions of the table's columns and rows."""

    forward_x: float
    """Horizontal unit vector of the viewing direction."""
    forward_y: float
    first_column: float
    """Tangent of half the azimuth of column 0."""
    column_step: float
    first_row: float
    """Row coordinate of row 0."""
    row_step: float


def sample_ranges(farthest_m: float) -> Floats:
    """Return the ranges at which the terrain is sampled: 6 cm apart, from 10 m on 0.6 % of the range [m]."""
    ranges = [0.12]
    while ranges[-1] < min(farthest_m, _FARTHEST_M):
        ranges.append(ranges[-1] + max(0.06, 0.006 * ranges[-1]))
    return np.array(ranges, np.float32)


def view_of(directions: Doubles, forward: Doubles, n_columns: int, n_rows: int) -> View:
    """Return the table's layout for rays (N, 3) along the image's edges in the world frame.

    Directions more than 143° to the side, or steeper than -6, are left to the exact walk.
    """
    ahead = forward[:2] / max(float(np.hypot(forward[0], forward[1])), 1e-9)
    level = np.maximum(np.hypot(directions[:, 0], directions[:, 1]), 1e-9)
    side = directions[:, 1] * ahead[0] - directions[:, 0] * ahead[1]
    tangent = side / (level + directions[:, :2] @ ahead + 1e-9)
    left, right = max(tangent.min() - 0.01, -3.0), min(tangent.max() + 0.01, 3.0)
    slope = directions[:, 2] / level
    lowest, highest = max(slope.min() - 0.02, -6.0), min(max(slope.max() + 0.02, -0.2), 0.5)
    first, last = (s / (NEAR_HORIZON + abs(s)) for s in (lowest, highest))
    column_step, row_step = (right - left) / (n_columns - 1), (last - first) / (n_rows - 1)
    return View(
        float(ahead[0]), float(ahead[1]), float(left), float(column_step), float(first), float(row_step)
    )


def row_slopes(view: View, n_rows: int) -> Floats:
    """Return the slope that each row of the table stands for."""
    q = view.first_row + view.row_step * np.arange(n_rows)
    return (NEAR_HORIZON * q / (1.0 - np.abs(q))).astype(np.float32)


@row_loop
def _profile(
    n: int,
    flat: Floats,
    columns: int,
    rows: int,
    u0: float,
    v0: float,
    du: float,
    dv: float,
    eye: float,
    ranges: Floats,
    heights: Floats,
) -> None:
    """Compute heights above the eye along one azimuth."""
    u_end, v_end = f32(columns - 1.001), f32(rows - 1.001)
    u0, v0, du, dv, eye = f32(u0), f32(v0), f32(du), f32(dv), f32(eye)
    for k in range(n):
        u = min(max(u0 + du * ranges[k], f32(0)), u_end)
        v = min(max(v0 + dv * ranges[k], f32(0)), v_end)
        i, j = i32(u), i32(v)
        a, b = u - f32(i), v - f32(j)
        p = i32(i32(j * i32(columns)) + i)
        z0, z1 = flat[entry(p)], flat[entry(i32(p + i32(1)))]
        p = i32(p + i32(columns))
        z2, z3 = flat[entry(p)], flat[entry(i32(p + i32(1)))]
        south = z0 + (z1 - z0) * a
        north = z2 + (z3 - z2) * a
        heights[k] = south + (north - south) * b - eye


@by_share
def sweep(
    worker: int,
    n_workers: int,
    surface: Surface,
    eye: Doubles,
    view: View,
    ranges: Floats,
    slopes: Floats,
    table: Floats,
) -> None:
    """Fill table[column, row] with 1 / range of the first hit, 0 where there is none."""
    height = surface.height
    rows, columns = height.shape
    per_step = 1.0 / surface.step_m
    yaw = math.atan2(view.forward_y, view.forward_x)
    flat = height.ravel()
    heights = np.empty(ranges.size, np.float32)
    for c in range(worker, table.shape[0], n_workers):
        azimuth = yaw + 2.0 * math.atan(view.first_column + c * view.column_step)
        cx, cy = math.cos(azimuth), math.sin(azimuth)
        border = min(
            _to_border(eye[0], cx, (columns - 1) * surface.step_m),
            _to_border(eye[1], cy, (rows - 1) * surface.step_m),
        )
        n = _n_nearer(ranges, f32(border))
        _profile(
            n,
            flat,
            columns,
            rows,
            eye[0] * per_step,
            eye[1] * per_step,
            cx * per_step,
            cy * per_step,
            eye[2],
            ranges,
            heights,
        )
        _running_horizon(n, ranges, heights, slopes, table[c])


@scalar
def _n_nearer(ranges: Floats, border: float) -> int:
    """Return how many ascending ranges are below a border; NumPy's search takes half a second to compile."""
    first, last = 0, ranges.size
    while first < last:
        middle = (first + last) // 2
        if ranges[middle] < border:
            first = middle + 1
        else:
            last = middle
    return first


@row_loop
def _running_horizon(n: int, ranges: Floats, heights: Floats, slopes: Floats, column: Floats) -> None:
    """From near to far, give each row that becomes visible its 1 / range on the chord of the profile."""
    row, n_rows = 0, slopes.size
    r_before, z_before = f32(0), heights[0]  # the ground below the camera counts as level
    for k in range(n):
        r, z = ranges[k], heights[k]
        if row < n_rows and slopes[row] * r <= z:
            grade = (z - z_before) / (r - r_before)
            below = z_before - grade * r_before
            nearest, farthest = f32(1) / max(r_before, f32(1e-3)), f32(1) / r
            while row < n_rows and slopes[row] * r <= z:
                inverse = (slopes[row] - grade) / min(below, f32(-1e-6)) if below < 0 else farthest
                column[row] = min(max(inverse, farthest), nearest)
                row += 1
        r_before, z_before = r, z
    while row < n_rows:
        column[row] = 0
        row += 1


@row_loop
def _to_border(place: float, direction: float, size: float) -> float:
    """Return the range at which a horizontal direction leaves the map along one axis."""
    if direction > 1e-9:
        return (size - place) / direction
    return -place / direction if direction < -1e-9 else 1e9
