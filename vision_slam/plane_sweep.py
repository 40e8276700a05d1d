"""Plane sweep between a reference image and other views, compiled.

A patch of the reference image is taken for a plane with a known normal n. With x = (u, v, 1) the pixels of the patch, x₀ the one in
its middle, ρ the inverse depth of the middle, and R, t the pose of the reference in a view, the patch is seen there at

    x' ~ R x + ρ (n · x) / (n · x₀) t

Gallup et al. 2007, "Real-time plane-sweeping stereo with multiple sweeping directions". `sweep_patches` returns the zero-mean normalized
cross-correlation of patch and view for a series of inverse depths.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from survey.core import FloatArray, IntArray

Views = npt.NDArray[np.float32]

# Depth changes within a patch by no more than this factor: planes seen edge-on would reach to the horizon.
_MOST_SLANTED = 2.0
_LEAST_DEPTH = 0.05  # share of the depth in the reference
_LEAST_CONTRAST = 0.5  # standard deviation of a patch [grey values]


class Patches(NamedTuple):
    """Patches of the reference image.

    `centre` (N, 2): column and row. `normal` (N, 3): of their planes in the camera's frame. `first`, `step` (N,): inverse depths ``first + k step`` [1/m].
    """

    centre: IntArray
    normal: FloatArray
    first: FloatArray
    step: FloatArray


class Sweep(NamedTuple):
    """Number of inverse depths, focal length and principal point [pixels], and columns and rows of a patch on each side of its middle."""

    n_steps: int
    focal: float
    cx: float
    cy: float
    across: int
    down: int


@njit(cache=True)
def sweep_patches(
    reference: Views, views: Views, patches: Patches, relative: tuple[FloatArray, FloatArray], sweep: Sweep
) -> Views:
    """Return the correlation (N, V, n_steps) of patches with views; NaN where a view does not see the patch.

    `reference` (H, W), `views` (V, H, W): images of one pinhole camera. `relative`: turns (V, 3, 3) and shifts (V, 3) [m] of the reference in each
    view.
    """
    turn, shift = relative
    n_views, n = len(views), len(patches.centre)
    n_pixels = (2 * sweep.across + 1) * (2 * sweep.down + 1)
    found = np.full((n, n_views, sweep.n_steps), np.nan, dtype=np.float32)
    patch, plane, seen = np.empty(n_pixels), np.empty((n_pixels, 3)), np.empty(n_pixels)
    turned, at = np.empty((n_pixels, 3)), np.empty((n_pixels, 3))
    for k in range(n):
        square = _patch_at(reference, patches.centre[k], patches.normal[k], sweep, (patch, plane))
        if square < n_pixels * _LEAST_CONTRAST**2:
            continue
        for j in range(n_views):
            for i in range(n_pixels):
                for axis in range(3):
                    row = turn[j, axis]
                    turned[i, axis] = row[0] * plane[i, 0] + row[1] * plane[i, 1] + row[2]
            for h in range(sweep.n_steps):
                rho = patches.first[k] + h * patches.step[k]
                for i in range(n_pixels):
                    for axis in range(3):
                        at[i, axis] = turned[i, axis] + rho * plane[i, 2] * shift[j, axis]
                if _seen_patch(views[j], at, sweep, seen):
                    found[k, j, h] = _correlation(patch, square, seen)
    return found


@njit(cache=True)
def _patch_at(
    image: Views, centre: IntArray, normal: FloatArray, sweep: Sweep, filled: tuple[FloatArray, FloatArray]
) -> float:
    """Fill in a patch about its mean, and columns of its pixels on the plane z = 1 and their nearness over that of the middle; return its sum of squares.

    Returns -1 where the patch leaves the image.
    """
    patch, plane = filled
    column, row = centre
    height, width = image.shape
    if (
        column < sweep.across
        or row < sweep.down
        or column >= width - sweep.across
        or row >= height - sweep.down
    ):
        return -1.0
    u0, v0 = (column - sweep.cx) / sweep.focal, (row - sweep.cy) / sweep.focal
    facing = normal[0] * u0 + normal[1] * v0 + normal[2]
    i = 0
    for y in range(row - sweep.down, row + sweep.down + 1):
        for x in range(column - sweep.across, column + sweep.across + 1):
            u, v = (x - sweep.cx) / sweep.focal, (y - sweep.cy) / sweep.focal
            ratio = (normal[0] * u + normal[1] * v + normal[2]) / facing
            plane[i, 0], plane[i, 1] = u, v
            plane[i, 2] = min(max(ratio, 1.0 / _MOST_SLANTED), _MOST_SLANTED)
            patch[i] = image[y, x]
            i += 1
    patch -= patch.mean()
    return float((patch**2).sum())


@njit(cache=True)
def _seen_patch(view: Views, at: FloatArray, sweep: Sweep, seen: FloatArray) -> bool:
    """Fill in the grey values of a view at points (n, 3) of a patch in its frame; return whether it sees all of them."""
    height, width = view.shape
    for i in range(len(at)):
        z = at[i, 2]
        if z < _LEAST_DEPTH:
            return False
        x, y = sweep.focal * at[i, 0] / z + sweep.cx, sweep.focal * at[i, 1] / z + sweep.cy
        if x < 0.0 or y < 0.0 or x >= width - 1.0 or y >= height - 1.0:
            return False
        left, top = int(x), int(y)
        s, t = x - left, y - top
        upper = view[top, left] * (1.0 - s) + view[top, left + 1] * s
        lower = view[top + 1, left] * (1.0 - s) + view[top + 1, left + 1] * s
        seen[i] = upper * (1.0 - t) + lower * t
    return True


@njit(cache=True)
def _correlation(patch: FloatArray, square: float, seen: FloatArray) -> float:
    """Return the correlation of a patch about its mean with grey values; NaN where these are all alike."""
    mean, both, own = seen.mean(), 0.0, 0.0
    for i in range(len(seen)):
        both += patch[i] * (seen[i] - mean)
        own += (seen[i] - mean) ** 2
    return float(both / np.sqrt(own * square)) if own >= len(seen) * _LEAST_CONTRAST**2 else np.nan
