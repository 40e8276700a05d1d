"""Points summed into the data's stencil, its right-hand side, the draws and the moments, compiled.

The layout is the stencil's: own weight, and couplings to the east, north, north-east and north-west.
"""

import numpy as np
import numpy.typing as npt
from numba import njit

from survey.core.arrays import FloatArray

Draws = npt.NDArray[np.float32]


@njit(cache=True, inline="always")
def _hashed(key: np.uint64) -> np.uint64:
    """Return 64 well-mixed bits (the finaliser of SplitMix64)."""
    key = (key ^ (key >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    key = (key ^ (key >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return key ^ (key >> np.uint64(31))


@njit(cache=True)
def add_points(
    points: FloatArray, stencil: FloatArray, rhs: FloatArray, draws: Draws, first_number: int
) -> int:
    """Add points to stencil and right-hand side; return how many lay on the lattice.

    The columns of `points` (N, 4) are the lattice coordinates u (east) and v (north), the
    height [m] and the weight [1/m²]. Every draw gets each point's error with a random sign,
    so that over the draws its covariance is that of the measurements.
    """
    rows, columns = rhs.shape
    n_draws = draws.shape[2]
    signs = np.empty(n_draws, dtype=np.float32)
    n_inside = 0
    for k in range(len(points)):
        u, v, z, w = points[k]
        i, j = int(np.floor(u)), int(np.floor(v))
        # A point on the last row or column belongs to the cell before it.
        i -= i == columns - 1 and u == i
        j -= j == rows - 1 and v == j
        if i < 0 or j < 0 or i >= columns - 1 or j >= rows - 1:
            continue
        n_inside += 1
        s, t = u - i, v - j
        sw, se, nw, ne = (1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t
        wz = w * z
        stencil[0, j, i] += w * sw * sw
        stencil[0, j, i + 1] += w * se * se
        stencil[0, j + 1, i] += w * nw * nw
        stencil[0, j + 1, i + 1] += w * ne * ne
        stencil[1, j, i] += w * sw * se
        stencil[1, j + 1, i] += w * nw * ne
        stencil[2, j, i] += w * sw * nw
        stencil[2, j, i + 1] += w * se * ne
        stencil[3, j, i] += w * sw * ne
        stencil[4, j, i + 1] += w * se * nw
        rhs[j, i] += wz * sw
        rhs[j, i + 1] += wz * se
        rhs[j + 1, i] += wz * nw
        rhs[j + 1, i + 1] += wz * ne
        if n_draws:
            bits = _hashed(np.uint64(first_number + k) * np.uint64(0x9E3779B97F4A7C15))
            root = np.float32(np.sqrt(w))
            for d in range(n_draws):
                if d % 64 == 0 and d > 0:
                    bits = _hashed(bits)
                signs[d] = root if (bits >> np.uint64(d % 64)) & np.uint64(1) else -root
            a, b, c, e = np.float32(sw), np.float32(se), np.float32(nw), np.float32(ne)
            for d in range(n_draws):
                draws[j, i, d] += a * signs[d]
                draws[j, i + 1, d] += b * signs[d]
                draws[j + 1, i, d] += c * signs[d]
                draws[j + 1, i + 1, d] += e * signs[d]
    return n_inside


@njit(cache=True)
def add_moments(points: FloatArray, moments: FloatArray) -> None:
    """Add Σ w t tᵀ and Σ w t z, with t = (1, u, v), to `moments` (3, 4)."""
    for k in range(len(points)):
        u, v, z, w = points[k]
        for a, left in enumerate((w, w * u, w * v)):
            moments[a, 0] += left
            moments[a, 1] += left * u
            moments[a, 2] += left * v
            moments[a, 3] += left * z


@njit(cache=True)
def add_moments_of_sums(stencil: FloatArray, rhs: FloatArray, moments: FloatArray) -> None:
    """Add to `moments` what `add_moments` would have, from the sums over the points: Tᵀ S T and Tᵀ b."""
    rows, columns = rhs.shape
    steps = ((0, 0), (1, 0), (0, 1), (1, 1), (-1, 1))
    for j in range(rows):
        for i in range(columns):
            moments[0, 3] += rhs[j, i]
            moments[1, 3] += rhs[j, i] * i
            moments[2, 3] += rhs[j, i] * j
            for layer in range(5):
                w = stencil[layer, j, i]
                if w == 0.0:
                    continue
                east, north = steps[layer]
                u, v = i + east, j + north
                # A coupling stands for two entries of the matrix, one on either side of its diagonal.
                half = 0.5 * w if layer == 0 else w
                moments[0, 0] += 2.0 * half
                moments[0, 1] += half * (i + u)
                moments[0, 2] += half * (j + v)
                moments[1, 1] += 2.0 * half * i * u
                moments[1, 2] += half * (i * v + j * u)
                moments[2, 2] += 2.0 * half * j * v
    moments[1, 0], moments[2, 0], moments[2, 1] = moments[0, 1], moments[0, 2], moments[1, 2]
