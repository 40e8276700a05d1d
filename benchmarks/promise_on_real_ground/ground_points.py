"""Ground returns of airborne lidar on a grid, by linear interpolation between them."""

from pathlib import Path

import laspy
import numpy as np
from scipy.interpolate import LinearNDInterpolator

from survey import Dem, Grid
from survey.core.arrays import FloatArray

_GROUND = 2
_EVERY = 2


def ground_dem(folder: Path, step_m: float, crs: str) -> Dem:
    """Return the ground of all point files of a folder, on the largest rectangle that every file's columns share."""
    tiles = [_ground(file) for file in sorted(folder.glob("*.laz"))]
    west = max(float(tile[:, 0].min()) for tile in tiles)
    east = min(float(tile[:, 0].max()) for tile in tiles)
    south = min(float(tile[:, 1].min()) for tile in tiles)
    north = max(float(tile[:, 1].max()) for tile in tiles)
    grid = Grid.over((np.ceil(west), np.ceil(south), np.floor(east), np.floor(north)), step_m, crs)
    points = np.vstack(tiles)[::_EVERY]
    heights = LinearNDInterpolator(points[:, :2] - points[0, :2], points[:, 2])(grid.xy - points[0, :2])
    return Dem.on(grid, heights.reshape(grid.shape))


def _ground(file: Path) -> FloatArray:
    """Return the ground returns (N, 3) of a point file [m]."""
    las = laspy.read(file, laz_backend=laspy.LazBackend.Lazrs)
    xyz: FloatArray = np.column_stack([las.x, las.y, las.z]).astype(np.float64)
    return xyz[np.asarray(las.classification) == _GROUND]
