"""Reference ray caster for tests: every cell that a ray crosses, in double precision, without tables."""

import numpy as np

from sim.world.fine_terrain import FineTerrain
from survey.core.arrays import BoolArray, FloatArray


def brute_force_depth(
    terrain: FineTerrain, origin: FloatArray, directions: FloatArray, farthest_m: float
) -> FloatArray:
    """Return the distance at which rays first meet the bilinear surface.

    Over each cell the ray's height above the surface is a quadratic in the distance along
    it; its least root between entering and leaving the cell is the hit.

    Parameters
    ----------
    terrain : FineTerrain
        The surface.
    origin : (3,) ndarray
        Where the rays start: easting, northing, elevation [m].
    directions : (N, 3) ndarray
        Unit vectors in the world frame.
    farthest_m : float
        How far to look [m].

    Returns
    -------
    (N,) ndarray
        Distance along the ray [m]; infinite where nothing is met within `farthest_m` or the
        terrain's edge.

    Examples
    --------
    >>> from sim.config.world import SceneryConfig
    >>> from sim.world.fine_terrain import fine_terrain
    >>> from survey.data.dem import Dem
    >>> from survey.data.grid import Grid
    >>> flat = Dem.on(Grid((0.0, 0.0, 9.0, 9.0), 1.0), np.zeros((10, 10)))
    >>> bare = SceneryConfig(dune_sd_m=0.0, sastrugi_sd_m=0.0, hummock_sd_m=0.0, crevasses_per_ha=0.0,
    ...     pools_per_ha=0.0, channels_per_ha=0.0, dirt_cones_per_ha=0.0)
    >>> down = np.array([[0.6, 0.0, -0.8], [0.0, 0.0, 1.0]])
    >>> brute_force_depth(fine_terrain(flat, bare, 0), np.array([4.0, 4.1, 0.8]), down, 9.0).tolist()
    [1.0, inf]
    """
    step = terrain.step_m
    south_up = terrain.height[::-1].astype(np.float64)
    start = np.append((origin[:2] - terrain.origin) / step, origin[2])
    speed = directions / np.array([step, step, 1.0])
    found = np.full(len(directions), np.inf)
    entered = np.zeros(len(directions))
    going = np.arange(len(directions))
    while len(going):
        place, fast = start[:2] + speed[going, :2] * (entered[going, None] + 1e-9), speed[going]
        cell = np.floor(place).astype(np.int64)
        inside = (cell >= 0).all(axis=1) & (cell < np.array(south_up.shape[::-1]) - 1).all(axis=1)
        inside &= entered[going] < farthest_m
        going, cell, fast = going[inside], cell[inside], fast[inside]
        leaves = _leaves(start, fast, cell, farthest_m)
        hit, distance = _roots(south_up, start, fast, cell, entered[going], leaves)
        found[going[hit]] = distance[hit]
        entered[going] = leaves
        going = going[~hit]
    return np.where(found <= farthest_m, found, np.inf)


def _leaves(start: FloatArray, speed: FloatArray, cell: FloatArray, farthest_m: float) -> FloatArray:
    """Distance at which each ray leaves its cell."""
    border = cell + (speed[:, :2] > 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = (border - start[:2]) / speed[:, :2]
    leaves: FloatArray = np.where(np.abs(speed[:, :2]) > 1e-12, reach, farthest_m + 1.0).min(axis=1)
    return leaves


def _roots(
    height: FloatArray,
    start: FloatArray,
    speed: FloatArray,
    cell: FloatArray,
    enters: FloatArray,
    leaves: FloatArray,
) -> tuple[BoolArray, FloatArray]:
    """Whether and where rays meet the bilinear patch of their cell, a + b t + c t² = 0 for the height above it."""
    i, j = cell.astype(np.int64).T
    z = height[j, i]
    east, north = height[j, i + 1] - z, height[j + 1, i] - z
    twist = height[j + 1, i + 1] - z - east - north
    u, v = (start[:2] - cell).T
    du, dv, dz = speed.T
    a = start[2] - (z + east * u + north * v + twist * u * v)
    b = dz - (east * du + north * dv + twist * (u * dv + v * du))
    c = -twist * du * dv
    root = np.sqrt(np.maximum(b * b - 4.0 * a * c, 0.0))
    half = -0.5 * (b + np.where(b >= 0.0, root, -root))
    with np.errstate(divide="ignore", invalid="ignore"):
        both = np.sort(np.stack([half / c, a / half]), axis=0)
    within = (both >= enters - 1e-7) & (both <= leaves + 1e-7) & (b * b >= 4.0 * a * c)
    return within.any(axis=0), np.where(within[0], both[0], both[1])
