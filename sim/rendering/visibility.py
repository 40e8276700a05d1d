"""Visibility of a height field: exact ray casting, and a sweep over azimuths that finds the ranges of all pixels.

Coordinates are metres east and north of the south-western node and above a datum near the
ground, so that single precision holds a tenth of a millimetre. A ray is given by its
horizontal unit direction (ux, uy) and its slope, dz per metre of horizontal range.

`first_hit` casts one ray on the bilinear surface, cell by cell. `sweep` fills a table of approximate ranges in one pass
per azimuth. The table is indexed by the tangent of half the azimuth from the viewing direction (columns)
and by the ray's slope (rows, dense near the horizon) and holds 1 / range, which over a plane
is exactly linear in the slope: interpolating it is an excellent start for the second pass.
`meet_ground` makes the ranges of one image row exact.
"""

import math
from typing import NamedTuple

import cv2
import numpy as np

from sim.rendering.compiled import Doubles, Floats, Ints, by_share, entry, f32, i32, row_loop, scalar
from sim.world.fine_terrain import FineTerrain

# Cells of a block that a ray above its highest node may jump over: most of a ray is far above the ground.
FINE_BLOCK = 4
MIDDLE_BLOCK = 16
COARSE_BLOCK = 64


class Surface(NamedTuple):
    """Heights for the compiled loops: the first row is the southern one."""

    height: Floats
    """(rows, columns) [m]."""
    step_m: float
    fine_blocks: Floats
    """Highest node within one block of each block of 4 × 4 cells [m]."""
    middle_blocks: Floats
    """The same for 16 × 16 cells, and for 64 × 64 cells."""
    coarse_blocks: Floats


def surface_of(terrain: FineTerrain, datum_m: float) -> Surface:
    """Prepare the terrain's heights above a datum."""
    return surface_on(np.ascontiguousarray(terrain.height[::-1]) - np.float32(datum_m), terrain.step_m)


def surface_on(height: Floats, step_m: float) -> Surface:
    """Prepare heights whose first row is the southern one."""
    fine, middle, coarse = (_block_maxima(height, n) for n in (FINE_BLOCK, MIDDLE_BLOCK, COARSE_BLOCK))
    return Surface(height, step_m, fine, middle, coarse)


def _block_maxima(height: Floats, block: int) -> Floats:
    """Return the highest corner of the cells of each block and its neighbours: from anywhere in it a jump of one block is safe."""
    corners = cv2.dilate(height, np.ones((2, 2), np.uint8), anchor=(0, 0))
    rows, columns = (-(-n // block) for n in height.shape)
    padded = np.full((rows * block, columns * block), -1e9, np.float32)
    padded[: height.shape[0], : height.shape[1]] = corners
    highest = padded.reshape(rows, block, columns, block).max(axis=(1, 3))
    return np.ascontiguousarray(cv2.dilate(highest, np.ones((3, 3), np.uint8)))


@scalar
def height_and_gradient(height: Floats, per_step: float, x: float, y: float) -> tuple[float, float, float]:
    """Return the bilinear surface's height and its exact gradient (dz/dx, dz/dy) at a place."""
    rows, columns = height.shape
    u = min(max(x * per_step, 0.0), columns - 1.001)
    v = min(max(y * per_step, 0.0), rows - 1.001)
    i, j = int(u), int(v)
    a, b = u - i, v - j
    south = height[j, i + 1] - height[j, i]
    north = height[j + 1, i + 1] - height[j + 1, i]
    z_south, z_north = height[j, i] + south * a, height[j + 1, i] + north * a
    rise = z_north - z_south
    return z_south + rise * b, (south + (north - south) * b) * per_step, rise * per_step


@scalar
def first_hit(
    surface: Surface, origin: Doubles, ux: float, uy: float, slope: float, start: float, end: float
) -> float:
    """Return the horizontal range at which a ray first meets the ground between two ranges; -1 for never."""
    height = surface.height
    per_step = 1.0 / surface.step_m
    rows, columns = height.shape
    per_x = 1.0 / (ux * per_step) if abs(ux) > 1e-9 else 1e12
    per_y = 1.0 / (uy * per_step) if abs(uy) > 1e-9 else 1e12
    u0, v0 = origin[0] * per_step, origin[1] * per_step
    r = start
    while r < end:
        u, v = u0 + ux * per_step * (r + 1e-5), v0 + uy * per_step * (r + 1e-5)
        z = origin[2] + slope * r
        if u < 0.0 or v < 0.0 or u >= columns - 1 or v >= rows - 1:
            return -1.0
        i, j = int(u), int(v)
        free = _free_range(surface, i, j, z, slope)
        if free > 0.0:
            r += free
            continue
        leaves = min((i + (1 if ux > 0 else 0) - u0) * per_x, (j + (1 if uy > 0 else 0) - v0) * per_y)
        hit = _patch_hit(height, per_step, i, j, u0 - i, v0 - j, origin[2], ux, uy, slope, r, leaves)
        if hit >= 0.0:
            return hit
        r = max(leaves, r + 1e-4)
    return -1.0


@scalar
def _free_range(surface: Surface, i: int, j: int, z: float, slope: float) -> float:
    """Return how far a ray at a height over a cell is above the blocks of cells around it; 0 when it may be below."""
    fall = min(slope, 0.0) * surface.step_m
    # A little less than a block, for the maximum covers one block to each side and no more.
    if z + fall * COARSE_BLOCK > surface.coarse_blocks[j >> 6, i >> 6]:
        return 0.99 * COARSE_BLOCK * surface.step_m
    if z + fall * MIDDLE_BLOCK > surface.middle_blocks[j >> 4, i >> 4]:
        return 0.99 * MIDDLE_BLOCK * surface.step_m
    if z + fall * FINE_BLOCK > surface.fine_blocks[j >> 2, i >> 2]:
        return 0.99 * FINE_BLOCK * surface.step_m
    return 0.0


@scalar
def _patch_hit(
    height: Floats,
    per_step: float,
    i: int,
    j: int,
    a0: float,
    b0: float,
    z0: float,
    ux: float,
    uy: float,
    slope: float,
    enters: float,
    leaves: float,
) -> float:
    """Return the root, between two ranges, of the ray's height above one bilinear patch: c2 r² + c1 r + c0; -1 for none."""
    z = height[j, i]
    p, q = height[j, i + 1] - z, height[j + 1, i] - z
    t = height[j + 1, i + 1] - z - p - q
    a1, b1 = ux * per_step, uy * per_step
    c2 = -t * a1 * b1
    c1 = slope - (p * a1 + q * b1 + t * (a0 * b1 + a1 * b0))
    c0 = z0 - (z + p * a0 + q * b0 + t * a0 * b0)
    if (c2 * leaves + c1) * leaves + c0 >= 0.0 and not (c2 > 0.0 and c1 < 0.0):
        return -1.0
    discriminant = c1 * c1 - 4.0 * c2 * c0
    if discriminant < 0.0:
        return -1.0
    # Both roots without the cancellation of nearly equal terms.
    half = -0.5 * (c1 + math.copysign(math.sqrt(discriminant), c1))
    first = half / c2 if abs(c2) > 1e-14 else 1e18
    second = c0 / half if half != 0.0 else 1e18
    first, second = min(first, second), max(first, second)
    if enters - 1e-4 <= first <= leaves + 1e-4:
        return first
    if enters - 1e-4 <= second <= leaves + 1e-4:
        return second
    return -1.0


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
            # The rows rise, and what is nearer hides what is farther: each row gets the first chord that reaches it.
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


FOUND = 0
EDGE = 1
"""Beside an occlusion edge: the exact walk decides."""
OUTSIDE = 2
"""Not in the table: the exact walk decides."""
SKY = 3


class RowRays(NamedTuple):
    """Properties of the rays of one row, pixel by pixel."""

    ux: Floats
    """Horizontal unit direction."""
    uy: Floats
    slope: Floats
    range_m: Floats
    """Horizontal range of the hit."""
    z: Floats
    """Height of the hit."""
    gx: Floats
    """Gradient of the surface at the hit."""
    gy: Floats
    nearest: Floats
    """Largest and least of the four 1 / range in the table."""
    farthest: Floats
    fate: Ints
    """FOUND, EDGE, OUTSIDE or SKY."""


@scalar
def meet_ground(
    lens_x: Floats,
    lens_y: Floats,
    lens_z: Floats,
    rotation: Doubles,
    origin: Doubles,
    view: View,
    table: Floats,
    table_rows: int,
    flat: Floats,
    columns: int,
    rows: int,
    step_m: float,
    rays: RowRays,
) -> None:
    """Rotate a row's rays into the world, look up their ranges and refine them by Newton's method.

    On the bilinear surface Z, with f(r) = oz + slope r - Z(o + u r), one step is
    r - f / (slope - grad Z · u); a second evaluation tests convergence.
    """
    _look_up(lens_x, lens_y, lens_z, rotation, view, table, table_rows, rays)
    if not _sees_ground(rays):
        return
    _make_exact(origin, flat, columns, rows, step_m, rays)


@row_loop
def _look_up(
    lens_x: Floats,
    lens_y: Floats,
    lens_z: Floats,
    rotation: Doubles,
    view: View,
    table: Floats,
    table_rows: int,
    rays: RowRays,
) -> None:
    """Rotate a row's rays into the world; look up their first ranges and the bounds of the table."""
    zero, one, knee = f32(0), f32(1), f32(NEAR_HORIZON)
    r00, r01, r02 = f32(rotation[0, 0]), f32(rotation[0, 1]), f32(rotation[0, 2])
    r10, r11, r12 = f32(rotation[1, 0]), f32(rotation[1, 1]), f32(rotation[1, 2])
    r20, r21, r22 = f32(rotation[2, 0]), f32(rotation[2, 1]), f32(rotation[2, 2])
    ahead_x, ahead_y = f32(view.forward_x), f32(view.forward_y)
    c0, per_c = f32(view.first_column), f32(1.0 / view.column_step)
    q0, per_q = f32(view.first_row), f32(1.0 / view.row_step)
    nr = i32(table_rows)
    c_end, q_end = f32(table.size // table_rows - 1.01), f32(table_rows - 1.01)
    for c in range(rays.ux.size):
        dx = r00 * lens_x[c] + r01 * lens_y[c] + r02 * lens_z[c]
        dy = r10 * lens_x[c] + r11 * lens_y[c] + r12 * lens_z[c]
        dz = r20 * lens_x[c] + r21 * lens_y[c] + r22 * lens_z[c]
        level = one / np.sqrt(dx * dx + dy * dy + f32(1e-12))
        ux, uy, slope = dx * level, dy * level, dz * level
        tangent = (uy * ahead_x - ux * ahead_y) / (f32(1.000001) + ux * ahead_x + uy * ahead_y)
        ct = (tangent - c0) * per_c
        qt = (slope / (knee + abs(slope)) - q0) * per_q
        outside = (ct < zero) | (ct > c_end) | (qt < zero)
        cc, qq = min(max(ct, zero), c_end), min(max(qt, zero), q_end)
        i, j = i32(cc), i32(qq)
        a, b = cc - f32(i), qq - f32(j)
        p = i32(i32(i * nr) + j)
        w0, w1 = table[entry(p)], table[entry(i32(p + i32(1)))]
        w2, w3 = table[entry(i32(p + nr))], table[entry(i32(i32(p + nr) + i32(1)))]
        high, low = max(w0, w1, w2, w3), min(w0, w1, w2, w3)
        w0 += (w1 - w0) * b
        w2 += (w3 - w2) * b
        rays.ux[c], rays.uy[c], rays.slope[c] = ux, uy, slope
        rays.range_m[c] = one / max(w0 + (w2 - w0) * a, f32(1e-5))
        rays.nearest[c], rays.farthest[c] = high, low
        no_ground = (high <= zero) | (qt > q_end)
        rays.fate[c] = i32(OUTSIDE) if outside else (i32(SKY) if no_ground else i32(EDGE))


@row_loop
def _sees_ground(rays: RowRays) -> bool:
    """Return whether the table has ground for any ray of the row."""
    highest = f32(0)
    for c in range(rays.nearest.size):
        highest = max(highest, rays.nearest[c])
    return highest > f32(0)


@row_loop
def _make_exact(origin: Doubles, flat: Floats, columns: int, rows: int, step_m: float, rays: RowRays) -> None:
    """Refine the ranges by Newton's method, and mark the rays that converged."""
    zero = f32(0)
    ox, oy, oz, inv = f32(origin[0]), f32(origin[1]), f32(origin[2]), f32(1.0 / step_m)
    n = i32(columns)
    u_end, v_end = f32(columns - 1.001), f32(rows - 1.001)
    for c in range(rays.ux.size):
        ux, uy, slope, start = rays.ux[c], rays.uy[c], rays.slope[c], rays.range_m[c]
        high, low = rays.nearest[c], rays.farthest[c]
        # ---- Newton, then once more to see
        r, steep, miss, z, gx, gy = start, zero, zero, zero, zero, zero
        for step in range(2):
            u = min(max((ox + ux * r) * inv, zero), u_end)
            v = min(max((oy + uy * r) * inv, zero), v_end)
            i, j = i32(u), i32(v)
            a, b = u - f32(i), v - f32(j)
            p = i32(i32(j * n) + i)
            z0, z1 = flat[entry(p)], flat[entry(i32(p + i32(1)))]
            z2, z3 = flat[entry(i32(p + n))], flat[entry(i32(i32(p + n) + i32(1)))]
            south, north = z1 - z0, z3 - z2
            z0 += south * a
            z2 += north * a
            z = z0 + (z2 - z0) * b
            gx, gy = (south + (north - south) * b) * inv, (z2 - z0) * inv
            steep = min(slope - gx * ux - gy * uy, f32(-1e-5))
            miss = oz + slope * r - z
            if step == 0:
                r -= miss / steep
        # Start values that differ lie on both sides of an occlusion edge, where Newton's method may find the wrong one.
        # About 1 % of the pixels on snow, and up to 8 % beside crevasses, are left to the exact walk.
        arrived = (
            (high - low < f32(0.08) * high)
            & (abs(r - start) < f32(0.1) * start)
            & (abs(miss) < -steep * (f32(0.004) + f32(0.0003) * r))
            & (rays.fate[c] != i32(OUTSIDE))
            & (gx * gx + gy * gy < f32(2))
        )
        rays.range_m[c], rays.z[c], rays.gx[c], rays.gy[c] = r - miss / steep, z, gx, gy
        rays.fate[c] = i32(FOUND) if arrived else rays.fate[c]
