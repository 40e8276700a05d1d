"""Roughness of raster cells, and outlines of marked cells."""

import numpy as np
import rasterio.features
import shapely
from scipy.ndimage import convolve

from survey.core.arrays import BoolArray, FloatArray
from survey.data.dem import Dem


def roughness(dem: Dem) -> FloatArray:
    """Return the standard deviation of heights about the plane through each 3 × 3 cells [m].

    The plane is the least-squares one; with nine heights and three parameters the sum of
    squares is divided by six. NaN at the border and beside nodata.

    Examples
    --------
    >>> from affine import Affine
    >>> tilted = Dem(np.add.outer(np.arange(4.0), np.arange(4.0)), Affine(1, 0, 0, 0, -1, 0), "EPSG:32608")
    >>> bool(np.nanmax(roughness(tilted)) < 1e-9)
    True
    """
    z = dem.elevation - np.nanmean(dem.elevation)
    ones, step = np.ones((3, 3)), np.array([-1.0, 0.0, 1.0])
    mean = convolve(z, ones / 9.0, mode="constant", cval=np.nan)
    square = convolve(z * z, ones, mode="constant", cval=np.nan)
    east = convolve(z, np.tile(step, (3, 1)), mode="constant", cval=np.nan)
    north = convolve(z, np.tile(step[:, None], (1, 3)), mode="constant", cval=np.nan)
    # Over nine cells the columns and rows are orthogonal with squared length 6.
    residual = square - 9.0 * mean**2 - (east**2 + north**2) / 6.0
    sd: FloatArray = np.sqrt(np.maximum(residual, 0.0) / 6.0)
    return sd


def cell_outline(cells: BoolArray, dem: Dem) -> shapely.Geometry:
    """Return ground that holds the marked cells and half a cell around them, smoothed outwards only.

    Beyond that half cell, slopes interpolated between cell centres are those of open cells alone.
    """
    shapes = rasterio.features.shapes(cells.astype(np.uint8), mask=cells, transform=dem.transform)
    union = shapely.union_all([shapely.geometry.shape(geometry) for geometry, _ in shapes])
    # Simplification takes away up to a quarter of a cell, so the outline is moved out by as much.
    tolerance = 0.25 * dem.step_m
    return shapely.simplify(union.buffer(0.5 * dem.step_m + tolerance, join_style="mitre"), 0.95 * tolerance)
