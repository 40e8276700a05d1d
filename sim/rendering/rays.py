"""Ray refinement: exact ranges of the rays of one image row from the table's approximate ones."""

from typing import NamedTuple

import numpy as np

from sim.rendering.compiled import Doubles, Floats, Ints, entry, f32, i32, row_loop, scalar
from sim.rendering.sweep import NEAR_HORIZON, View

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
        rays.range_m[c] = one / max(w0 + (w2 - w0) * a, f32(1e-4))
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
        arrived = (
            (high - low < f32(0.08) * high)
            & (abs(r - start) < f32(0.1) * start)
            & (abs(miss) < -steep * (f32(0.004) + f32(0.0003) * r))
            & (rays.fate[c] != i32(OUTSIDE))
            & (gx * gx + gy * gy < f32(2))
        )
        rays.range_m[c], rays.z[c], rays.gx[c], rays.gy[c] = r - miss / steep, z, gx, gy
        rays.fate[c] = i32(FOUND) if arrived else rays.fate[c]
