"""Angular blocks of stone on a height grid: boulders of debris-covered ice, and the stones of its texture."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from survey.core import FloatArray

_SIZE_EXPONENT = 2.5
_FACES = 6
_BURIED = 0.15


class Blocks(NamedTuple):
    """Blocks with six sides and a tilted top each; arrays with one row per block."""

    place_m: FloatArray
    """(N, 2): along the columns and the rows of the grid."""
    size_m: FloatArray
    tone: FloatArray
    """Reflectance."""
    bearing_rad: FloatArray
    """(N, 6): direction that a side faces."""
    reach_m: FloatArray
    """(N, 6): distance of a side's foot from the middle."""
    steepness: FloatArray
    """(N, 6): tangent of a side's slope."""
    top_m: FloatArray
    tilt: FloatArray
    """(N, 2): slope of the top."""


def number_above(least_m: float, above_1_m: float) -> float:
    """Return how many blocks are wider than a size, of which so many are wider than 1 m: a power law."""
    return float(above_1_m * least_m**-_SIZE_EXPONENT)


def draw_blocks(
    rng: np.random.Generator, n: int, sizes_m: tuple[float, float], extent_m: FloatArray, tone_sd: float
) -> Blocks:
    """Draw blocks, the largest last, at random places of a grid.

    Parameters
    ----------
    rng : Generator
        Source of the draws.
    n : int
        Number of blocks.
    sizes_m : (2,) tuple of float
        Least and greatest width; the number above a width falls with its power of 2.5 [m].
    extent_m : (2,) ndarray
        Length of the grid along its columns and its rows [m].
    tone_sd : float
        Standard deviation of the logarithm of the reflectance, whose median is 1.

    Returns
    -------
    Blocks
        Places, sizes and faces.
    """
    size = np.sort(np.minimum(sizes_m[0] * (1.0 - rng.random(n)) ** (-1.0 / _SIZE_EXPONENT), sizes_m[1]))
    return Blocks(
        rng.uniform(0.0, 1.0, (n, 2)) * extent_m,
        size,
        np.exp(tone_sd * rng.standard_normal(n)),
        2.0 * np.pi / _FACES * (np.arange(_FACES) + rng.uniform(-0.35, 0.35, (n, _FACES))),
        size[:, None] * rng.uniform(0.25, 0.5, (n, _FACES)),
        rng.uniform(1.5, 6.0, (n, _FACES)),
        size * rng.uniform(0.3, 0.7, n),
        rng.uniform(-0.4, 0.4, (n, 2)),
    )


@njit(cache=True)
def lay_blocks(
    height: npt.NDArray[np.float32],
    tone: npt.NDArray[np.float32],
    step_m: float,
    blocks: Blocks,
    periodic: bool,
) -> None:
    """Lay blocks on heights (rows, columns), partly buried, and write their reflectance into `tone`.

    Parameters
    ----------
    height : (H, W) ndarray of float32
        Heights of the nodes, which change [m].
    tone : (H, W) ndarray of float32
        Reflectance of the nodes, which changes.
    step_m : float
        Distance between nodes [m].
    blocks : Blocks
        What to lay.
    periodic : bool
        Whether the grid goes on at its opposite side; else blocks end at its edge.
    """
    rows, columns = height.shape
    for k in range(len(blocks.size_m)):
        size = blocks.size_m[k]
        x, y = blocks.place_m[k, 0] / step_m, blocks.place_m[k, 1] / step_m
        around = int(0.8 * size / step_m) + 1
        foot = height[min(int(y), rows - 1), min(int(x), columns - 1)] - _BURIED * size
        for j in range(int(y) - around, int(y) + around + 1):
            for i in range(int(x) - around, int(x) + around + 1):
                if not periodic and not (0 <= j < rows and 0 <= i < columns):
                    continue
                east, north = (i - x) * step_m, (j - y) * step_m
                top = blocks.top_m[k] + blocks.tilt[k, 0] * east + blocks.tilt[k, 1] * north
                for face in range(_FACES):
                    angle = blocks.bearing_rad[k, face]
                    inside = blocks.reach_m[k, face] - east * np.cos(angle) - north * np.sin(angle)
                    top = min(top, inside * blocks.steepness[k, face])
                row, column = j % rows, i % columns
                if top > 0.0 and foot + top > height[row, column]:
                    height[row, column] = foot + top
                    tone[row, column] = blocks.tone[k]
