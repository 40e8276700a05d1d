"""Cells as rasters of a window: height over all strips, slope."""

import numpy as np
import numpy.typing as npt
from scipy.ndimage import uniform_filter

from survey.core.arrays import FloatArray
from survey.reconstruction.tiled.layout import CellWindow


def mean_heights(cells: npt.NDArray[np.void], window: CellWindow, offset_m: FloatArray) -> FloatArray:
    """Return the mean height of the points of each cell (rows, columns) [m]; NaN for cells without any.

    Parameters
    ----------
    cells : (N,) ndarray of CELL
        Cells in the window.
    window : CellWindow
        Where they lie.
    offset_m : (N,) ndarray
        Subtracted from the heights [m].
    """
    flat = (cells["row"] - window.south).astype(np.int64) * window.columns + cells["column"] - window.west
    n = np.bincount(flat, cells["n"], window.rows * window.columns)
    total = np.bincount(flat, cells["n"] * (cells["z"] - offset_m), window.rows * window.columns)
    heights: FloatArray = np.full(len(n), np.nan)
    np.divide(total, n, out=heights, where=n > 0)
    return heights.reshape(window.shape)


def filled(heights: FloatArray, width: int) -> FloatArray:
    """Return the moving average (rows, columns) of known heights over a square of cells; NaN where none is known."""
    known = np.isfinite(heights)
    level = float(heights[known].mean()) if known.any() else 0.0
    share = uniform_filter(known.astype(np.float64), width, mode="constant")
    total = uniform_filter(np.where(known, heights - level, 0.0), width, mode="constant")
    average = np.full(heights.shape, np.nan)
    np.divide(total, share, out=average, where=share > 0.5 / width**2)
    return average + level


def slopes(heights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the rise per cell eastwards and northwards (rows, columns) [m] of averaged heights; 0 where unknown."""
    smooth = filled(heights, 3)
    if min(smooth.shape) < 2:
        return np.zeros(smooth.shape), np.zeros(smooth.shape)
    north: FloatArray = np.gradient(smooth, axis=0)
    east: FloatArray = np.gradient(smooth, axis=1)
    return np.nan_to_num(east), np.nan_to_num(north)
