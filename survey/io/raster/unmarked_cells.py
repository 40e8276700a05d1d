"""Cells without a height that a raster does not mark as such, found by the gap between them and all others."""

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import InputError

_LEAST_GAP_M = 100.0
_LEAST_CELLS = 2


def refuse_detached(elevation: FloatArray, step_m: float, name: str) -> None:
    """Refuse elevations whose lowest or highest number is repeated, and far from every other one.

    Collars and voids are often filled with a number such as 0 that the file does not declare. No ground is
    surrounded by nothing but cliffs that are higher than 100 m and steeper than 45 degrees.

    Parameters
    ----------
    elevation : (H, W) ndarray
        Elevations [m], NaN where unknown.
    step_m : float
        Width of a cell [m].
    name : str
        Name of the file, for the message.

    Raises
    ------
    InputError
        At least two cells hold the same number, and all others are farther from it than 100 m and a cell's width.

    Examples
    --------
    >>> ground = np.array([[812.0, 815.0, 0.0], [811.0, 814.0, 0.0]])
    >>> refuse_detached(ground, 10.0, "dem.tif")
    Traceback (most recent call last):
    survey.core.errors.InputError: dem.tif holds 2 cells of exactly 0 m, and all others are 811 m or more...
    """
    for number, others, gap_m in _extremes(elevation):
        n_cells = int((elevation == number).sum())
        if n_cells >= _LEAST_CELLS and gap_m > max(_LEAST_GAP_M, step_m):
            raise InputError(
                f"{name} holds {n_cells} cells of exactly {number:g} m, and all others are {others}: "
                f"{number:g} stands for unknown cells and is not declared; make it nodata (gdal_edit.py -a_nodata {number:g})."
            )


def _extremes(elevation: FloatArray) -> list[tuple[float, str, float]]:
    """Return the lowest and the highest number, where the others begin, and the gap between them [m]."""
    known = elevation[np.isfinite(elevation)]
    if known.size == 0 or known.min() == known.max():
        return []
    low, high = float(known.min()), float(known.max())
    above, below = float(known[known > low].min()), float(known[known < high].max())
    return [(low, f"{above:g} m or more", above - low), (high, f"{below:g} m or less", high - below)]
