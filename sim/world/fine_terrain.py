"""Fine terrain: heights, materials and normals of the simulated ground."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from affine import Affine
from pyproj import CRS

from sim.world.hazards import FloatGrid, Hazard
from survey.core.arrays import FloatArray
from survey.data.dem import Dem

ByteGrid = npt.NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class FineTerrain:
    """Fine terrain: heights on a grid of 0.25 m or finer, surface properties, and hazards.

    Between the nodes the surface is bilinear: `elevation`, the physics, the images and the
    laser see the same ground.

    Parameters
    ----------
    height : (H, W) float32 ndarray
        Elevation [m]; the first row is the northern one, as in a `Dem`.
    transform : affine.Affine
        Of the cells around the nodes, as in a `Dem`.
    crs : pyproj.CRS
        Projected, in metres.
    vertical_datum : str
        Of the terrain it was made from.
    tone : (H, W) uint8 ndarray
        Reflectance as a share of clean snow's, 255 for all of it.
    water : (H, W) uint8 ndarray
        Share of open water, 255 for all.
    openness : (H, W) uint8 ndarray
        Share of the sky that a place sees, 255 for all; small in crevasses.
    hazards : tuple of Hazard
        Crevasses, channels, pools and cones with their outlines.

    Notes
    -----
    A height field has no overhangs: a crevasse's walls are one cell wide.
    """

    height: FloatGrid
    transform: Affine
    crs: CRS
    vertical_datum: str
    tone: ByteGrid
    water: ByteGrid
    openness: ByteGrid
    hazards: tuple[Hazard, ...]

    @property
    def step_m(self) -> float:
        """Distance between neighbouring nodes [m]."""
        return float(self.transform.a)

    @property
    def origin(self) -> FloatArray:
        """Easting and northing of the south-western node [m]."""
        rows, _ = self.height.shape
        step = self.step_m
        return np.array([self.transform.c + 0.5 * step, self.transform.f - (rows - 0.5) * step])

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """``(xmin, ymin, xmax, ymax)`` of the outermost nodes [m]."""
        rows, columns = self.height.shape
        x, y = self.origin.tolist()
        return x, y, x + (columns - 1) * self.step_m, y + (rows - 1) * self.step_m

    @cached_property
    def dem(self) -> Dem:
        """Heights as a terrain model (a copy in double precision)."""
        return Dem(self.height.astype(np.float64), self.transform, self.crs, self.vertical_datum)

    def elevation(self, xy: FloatArray) -> FloatArray:
        """Return the height of places (N, 2) [m]; NaN beyond the outermost nodes."""
        corners, s, t, inside = self._patches(xy)
        south_west, south_east, north_west, north_east = corners
        south = south_west + (south_east - south_west) * s
        north = north_west + (north_east - north_west) * s
        return np.where(inside, south + (north - south) * t, np.nan)

    def normal(self, xy: FloatArray) -> FloatArray:
        """Return the surface's unit normals (N, 3), pointing up, at places (N, 2); NaN beyond the nodes."""
        corners, s, t, inside = self._patches(xy)
        south_west, south_east, north_west, north_east = corners
        to_east = (south_east - south_west) * (1.0 - t) + (north_east - north_west) * t
        to_north = (north_west - south_west) * (1.0 - s) + (north_east - south_east) * s
        up = np.column_stack([-to_east, -to_north, np.full(len(s), self.step_m)])
        up[~inside] = np.nan
        normals: FloatArray = up / np.linalg.norm(up, axis=1, keepdims=True)
        return normals

    def _patches(self, xy: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, npt.NDArray[np.bool_]]:
        """Return the heights of the four nodes around each place (SW, SE, NW, NE), the place between them, and whether it is inside."""
        rows, columns = self.height.shape
        uv = (np.asarray(xy, dtype=np.float64).reshape(-1, 2) - self.origin) / self.step_m
        inside = (uv >= 0.0).all(axis=1) & (uv[:, 0] <= columns - 1) & (uv[:, 1] <= rows - 1)
        uv = np.where(inside[:, None], uv, 0.0)
        column = np.minimum(uv[:, 0].astype(np.int64), columns - 2)
        row = rows - 1 - np.minimum(uv[:, 1].astype(np.int64), rows - 2)
        z = self.height
        around = z[row, column], z[row, column + 1], z[row - 1, column], z[row - 1, column + 1]
        corners = np.stack(around).astype(np.float64)
        return corners, uv[:, 0] - column, uv[:, 1] - (rows - 1 - row), inside
