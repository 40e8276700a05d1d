r"""Slopes too steep to drive, from the bounds alone: also where no point was seen.

Ground that is at least l at a place A and at most u at a place B, a distance d away, rises between the
two at least once as steeply as the chord (the mean value theorem),

.. math::  \max_{AB} |\nabla f| \ge (l_A - u_B) / d

however it runs in between. A point pins the bounds at A, rays keep B low: so the far side of a crest is
known to be steep before it is seen (Fig. 4 of the space-carving paper, where A has to be the highest
place of its surroundings because no lower bound is at hand).

A chord of one step applies to both its nodes, and one of two steps of the node between, whichever of its
halves is the steep one. Of a longer one some node is steep, and which is not known; it marks all between
its ends where it falls by 15 % more for every step beyond two, so that most of them have to be.
"""

import numpy as np

from survey.core.arrays import BoolArray, FloatArray
from survey.core.errors import InputError
from survey.data.dem import Dem
from survey.reconstruction.base import Reconstruction

# Chords longer than this show that the ground is steep, and not where [m].
_REACH_M = 1.0
_DIRECTIONS = ((0, 1), (1, 0), (1, 1), (1, -1))
# By so much more a chord has to fall for every step beyond two.
_MORE_PER_STEP = 0.15


def steep_ground(reconstruction: Reconstruction, limit_deg: float) -> Dem:
    """Return 1 where the ground is steeper than a limit for certain, 0 elsewhere, NaN beyond the map.

    Parameters
    ----------
    reconstruction : Reconstruction
        A map; its bounds must hold, its mean and standard deviation are not asked.
    limit_deg : float
        Steepest slope that is not lethal [deg].

    Returns
    -------
    Dem
        On the map's grid: the nodes under chords up to 1 m long, or one step, that are steeper than the limit.

    Raises
    ------
    InputError
        A map without bounds of its own, or a limit that is no slope.

    Notes
    -----
    What is 0 is not known to be safe: the bounds there only allow of gentle ground, or are wide apart.

    Examples
    --------
    A step of 1 m, seen from above: the bounds meet on the plateau, and rays keep the ground before it low.

    >>> from survey.data.grid import Grid
    >>> grid = Grid((0.0, 0.0, 5.0, 1.0), 1.0)
    >>> low, high = np.tile([1.0, 1.0, 1.0, -9.0, -9.0, 0.0], (2, 1)), np.tile([1.0, 1.0, 1.0, 0.2, 0.1, 0.0], (2, 1))
    >>> flat, codes = Dem.on(grid, 0.5 * (low + high)), np.ones(grid.shape, dtype=int)
    >>> step = Reconstruction(flat, flat, codes, "field", {}, Dem.on(grid, low), Dem.on(grid, high))
    >>> steep_ground(step, 30.0).elevation[0]
    array([0., 0., 1., 1., 0., 0.])
    """
    if reconstruction.lower is None or reconstruction.upper is None:
        raise InputError(
            f"the map by {reconstruction.method} has no bounds of its own, which steep ground is found from; map it with rays."
        )
    if not 0.0 < limit_deg < 90.0:
        raise InputError(f"a slope of {limit_deg:g}° is no limit to stay below; give one between 0 and 90°.")
    lower, upper = reconstruction.lower.elevation, reconstruction.upper.elevation
    step_m = reconstruction.mean.step_m
    steep = steep_chords(lower, upper, step_m, limit_deg, max(_REACH_M, step_m))
    grid = reconstruction.mean.grid()
    return Dem.on(grid, np.where(np.isfinite(reconstruction.mean.elevation), steep, np.nan))


def steep_chords(
    lower: FloatArray, upper: FloatArray, step_m: float, limit_deg: float, reach_m: float
) -> BoolArray:
    """Return which nodes (H, W) lie on a chord up to `reach_m` long from a lower bound down to an upper one that is too steep."""
    steep = np.zeros(lower.shape, dtype=bool)
    rise = np.tan(np.radians(limit_deg))
    for south, east in _DIRECTIONS:
        length_m = step_m * np.hypot(south, east)
        for k in range(1, int(reach_m / length_m + 1e-9) + 1):
            here, there = _pair(lower.shape, k * south, k * east)
            needed = rise * k * length_m * (1.0 + _MORE_PER_STEP * max(k - 2, 0))
            down = (lower[here] - upper[there] > needed) | (lower[there] - upper[here] > needed)
            for m in range(k + 1) if k == 1 else range(1, k):
                along = tuple(
                    slice(a.start + m * d, a.stop + m * d) for a, d in zip(here, (south, east), strict=True)
                )
                steep[along] |= down
    return steep


def _pair(shape: tuple[int, ...], south: int, east: int) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Return the nodes that have another one so many rows and columns away, and those others."""
    rows, columns = shape
    west = max(-east, 0)
    here = (slice(0, rows - south), slice(west, columns - max(east, 0)))
    return here, (slice(south, rows), slice(west + east, columns - max(east, 0) + east))
