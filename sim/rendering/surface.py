"""Bilinear surface and exact ray casting, cell by cell.

Coordinates are metres east and north of the south-western node and above a datum near the
ground, so that single precision holds a tenth of a millimetre. A ray is given by its
horizontal unit direction (ux, uy) and its slope, dz per metre of horizontal range.
"""

import math
from typing import NamedTuple

import cv2
import numpy as np

from sim.rendering.compiled import Doubles, Floats, scalar
from sim.world.fine_terrain import FineTerrain

FINE_BLOCK = 16
COARSE_BLOCK = 64


class Surface(NamedTuple):
    """Heights for the compiled loops: the first row is the southern one."""

    height: Floats
    """(rows, columns) [m]."""
    step_m: float
    fine_blocks: Floats
    """Highest node within one block of each block of 16 × 16 cells [m]."""
    coarse_blocks: Floats
    """The same for 64 × 64 cells."""


def surface_of(terrain: FineTerrain, datum_m: float) -> Surface:
    """Prepare the terrain's heights above a datum."""
    height = np.ascontiguousarray(terrain.height[::-1]) - np.float32(datum_m)
    return Surface(
        height, terrain.step_m, _block_maxima(height, FINE_BLOCK), _block_maxima(height, COARSE_BLOCK)
    )


def _block_maxima(height: Floats, block: int) -> Floats:
    """Return the highest node of each block and its neighbours: from anywhere in it a jump of one block is safe."""
    rows, columns = (-(-n // block) for n in height.shape)
    padded = np.full((rows * block, columns * block), -1e9, np.float32)
    padded[: height.shape[0], : height.shape[1]] = height
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
    far, near = COARSE_BLOCK * surface.step_m, FINE_BLOCK * surface.step_m
    r = start
    while r < end:
        u, v = u0 + ux * per_step * (r + 1e-5), v0 + uy * per_step * (r + 1e-5)
        z = origin[2] + slope * r
        if u < 0.0 or v < 0.0 or u >= columns - 1 or v >= rows - 1:
            return -1.0
        i, j = int(u), int(v)
        if min(z, z + slope * far) > surface.coarse_blocks[j // COARSE_BLOCK, i // COARSE_BLOCK]:
            r += 0.99 * far
            continue
        if min(z, z + slope * near) > surface.fine_blocks[j // FINE_BLOCK, i // FINE_BLOCK]:
            r += 0.99 * near
            continue
        leaves = min((i + (1 if ux > 0 else 0) - u0) * per_x, (j + (1 if uy > 0 else 0) - v0) * per_y)
        hit = _patch_hit(height, per_step, i, j, u0 - i, v0 - j, origin[2], ux, uy, slope, r, leaves)
        if hit >= 0.0:
            return hit
        r = max(leaves, r + 1e-4)
    return -1.0


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
    half = -0.5 * (c1 + math.copysign(math.sqrt(discriminant), c1))
    first = half / c2 if abs(c2) > 1e-14 else 1e18
    second = c0 / half if half != 0.0 else 1e18
    first, second = min(first, second), max(first, second)
    if enters - 1e-4 <= first <= leaves + 1e-4:
        return first
    if enters - 1e-4 <= second <= leaves + 1e-4:
        return second
    return -1.0
