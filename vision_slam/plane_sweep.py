"""Plane sweep between a reference image and other views, compiled.

A patch of the reference image is taken for a plane with a known normal n. With x = (u, v, 1) the pixels of the patch, x₀ the one in
its middle, ρ the inverse depth of the middle, and R, t the pose of the reference in a view, the patch is seen there at

    x' ~ R x + ρ (n · x) / (n · x₀) t

Gallup et al. 2007, "Real-time plane-sweeping stereo with multiple sweeping directions". `sweep_patches` returns the zero-mean normalized
cross-correlation of patch and view for a series of inverse depths.
"""

import numpy as np
import numpy.typing as npt
from numba import njit

from survey.core import FloatArray, IntArray

Views = npt.NDArray[np.float32]

# Depth changes within a patch by no more than this factor: planes seen edge-on would reach to the horizon.
_MOST_SLANTED = 2.0
_LEAST_CONTRAST = 0.5  # standard deviation of a patch [grey values]


@njit(cache=True, fastmath=False)
def sweep_patches(
    reference: Views,
    views: Views,
    centre: IntArray,
    normal: FloatArray,
    first: FloatArray,
    step: FloatArray,
    n_steps: int,
    turn: FloatArray,
    shift: FloatArray,
    lens: tuple[float, float, float],
    half: tuple[int, int],
) -> Views:
    """Return the correlation (N, V, n_steps) of patches with views; NaN where a view does not see the patch.

    `reference` (H, W), `views` (V, H, W): images of one pinhole camera. `centre` (N, 2): column and row of the patches. `normal` (N, 3): of their
    planes in the camera's frame. `first`, `step` (N,): inverse depths ``first + k step`` [1/m]. `turn` (V, 3, 3), `shift` (V, 3): pose of
    the reference in each view [m]. `lens`: focal length and principal point [pixels]. `half`: columns and rows on each side of the middle.
    """
    focal, cx, cy = lens
    n_views, height, width = views.shape
    across, down = half
    n_pixels = (2 * across + 1) * (2 * down + 1)
    found = np.full((len(centre), n_views, n_steps), np.nan, dtype=np.float32)
    patch, along = np.empty(n_pixels), np.empty((n_pixels, 3))
    slant, turned, seen = np.empty(n_pixels), np.empty((n_pixels, 3)), np.empty(n_pixels)
    for k in range(len(centre)):
        column, row = centre[k]
        if column < across or row < down or column >= width - across or row >= height - down:
            continue
        u0, v0 = (column - cx) / focal, (row - cy) / focal
        facing = normal[k, 0] * u0 + normal[k, 1] * v0 + normal[k, 2]
        i, mean = 0, 0.0
        for y in range(row - down, row + down + 1):
            for x in range(column - across, column + across + 1):
                u, v = (x - cx) / focal, (y - cy) / focal
                along[i, 0], along[i, 1], along[i, 2] = u, v, 1.0
                ratio = (normal[k, 0] * u + normal[k, 1] * v + normal[k, 2]) / facing
                slant[i] = min(max(ratio, 1.0 / _MOST_SLANTED), _MOST_SLANTED)
                patch[i] = reference[y, x]
                mean += patch[i]
                i += 1
        mean /= n_pixels
        square = 0.0
        for i in range(n_pixels):
            patch[i] -= mean
            square += patch[i] ** 2
        if square < n_pixels * _LEAST_CONTRAST**2:
            continue
        for j in range(n_views):
            for i in range(n_pixels):
                for axis in range(3):
                    turned[i, axis] = (
                        turn[j, axis, 0] * along[i, 0] + turn[j, axis, 1] * along[i, 1] + turn[j, axis, 2]
                    )
            for h in range(n_steps):
                rho = first[k] + h * step[k]
                total, inside = 0.0, rho > 0.0
                for i in range(n_pixels):
                    if not inside:
                        break
                    nearness = rho * slant[i]
                    z = turned[i, 2] + nearness * shift[j, 2]
                    if z < 0.05:
                        inside = False
                        break
                    x = focal * (turned[i, 0] + nearness * shift[j, 0]) / z + cx
                    y = focal * (turned[i, 1] + nearness * shift[j, 1]) / z + cy
                    if x < 0.0 or y < 0.0 or x >= width - 1.0 or y >= height - 1.0:
                        inside = False
                        break
                    left, top = int(x), int(y)
                    s, t = x - left, y - top
                    upper = views[j, top, left] * (1.0 - s) + views[j, top, left + 1] * s
                    lower = views[j, top + 1, left] * (1.0 - s) + views[j, top + 1, left + 1] * s
                    seen[i] = upper * (1.0 - t) + lower * t
                    total += seen[i]
                if not inside:
                    continue
                total /= n_pixels
                both, own = 0.0, 0.0
                for i in range(n_pixels):
                    both += patch[i] * (seen[i] - total)
                    own += (seen[i] - total) ** 2
                if own >= n_pixels * _LEAST_CONTRAST**2:
                    found[k, j, h] = both / np.sqrt(own * square)
    return found
