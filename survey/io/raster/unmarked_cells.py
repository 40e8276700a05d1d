"""Cells without a height that a raster does not mark as such, found by the gap between them and all others."""

from typing import NamedTuple

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import InputError

_LEAST_GAP_M = 100.0
_LEAST_CELLS = 2
LOWEST_M, HIGHEST_M = -12_000.0, 9_000.0
"""Heights between which all ground on Earth lies."""


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
    extremes = Extremes()
    extremes.add(elevation)
    extremes.refuse_detached(step_m, name)


def refuse_impossible(elevation: FloatArray, name: str) -> None:
    """Refuse elevations most of which are beyond any ground on Earth, as decimetres or millimetres without a unit are.

    Parameters
    ----------
    elevation : (H, W) ndarray
        Elevations [m], NaN where unknown.
    name : str
        Name of the file, for the message.

    Raises
    ------
    InputError
        The median is above 9000 m or below -12,000 m.
    """
    known = elevation[np.isfinite(elevation)]
    middle_m = float(np.median(known)) if known.size else 0.0
    if not LOWEST_M <= middle_m <= HIGHEST_M:
        raise InputError(
            f"{name} holds elevations about {middle_m:,.0f} m, beyond all ground on Earth; state the unit or the scale of its numbers "
            "(gdal_edit.py -scale 0.1 for decimetres)."
        )


class Extremes:
    """The lowest and the highest number of a raster, how many cells hold them, and where the others begin.

    Rasters that are read in blocks add one block after the other.

    Examples
    --------
    >>> extremes = Extremes()
    >>> extremes.add(np.array([[812.0, 815.0], [811.0, 814.0]]))
    >>> extremes.add(np.array([[0.0], [0.0]]))
    >>> extremes.refuse_detached(10.0, "dem.tif")
    Traceback (most recent call last):
    survey.core.errors.InputError: dem.tif holds 2 cells of exactly 0 m, and all others are 811 m or more...
    """

    def __init__(self) -> None:
        self._low, self._negated_high = _NOTHING, _NOTHING

    def add(self, elevation: FloatArray) -> None:
        """Count the elevations of a block, NaN where unknown."""
        known = elevation[np.isfinite(elevation)]
        self._low = _merged(self._low, _lowest(known))
        self._negated_high = _merged(self._negated_high, _lowest(-known))

    def refuse_detached(self, step_m: float, name: str) -> None:
        """Raise InputError as `refuse_detached` does."""
        for sign, words, (number, n_cells, others) in (
            (1.0, "or more", self._low),
            (-1.0, "or less", self._negated_high),
        ):
            gap_m = others - number
            if n_cells >= _LEAST_CELLS and np.isfinite(gap_m) and gap_m > max(_LEAST_GAP_M, step_m):
                filled = sign * number + 0.0
                raise InputError(
                    f"{name} holds {n_cells} cells of exactly {filled:g} m, and all others are {sign * others:g} m {words}: "
                    f"{filled:g} stands for unknown cells and is not declared; make it nodata (gdal_edit.py -a_nodata {filled:g})."
                )


class _Lowest(NamedTuple):
    """The lowest number, how many cells hold it, and the next higher one; infinite where there is none."""

    number: float
    n_cells: int
    others: float


_NOTHING = _Lowest(np.inf, 0, np.inf)


def _lowest(known: FloatArray) -> _Lowest:
    if known.size == 0:
        return _NOTHING
    number = float(known.min())
    is_lowest = known == number
    others = known[~is_lowest]
    return _Lowest(number, int(is_lowest.sum()), float(others.min()) if others.size else np.inf)


def _merged(a: _Lowest, b: _Lowest) -> _Lowest:
    if a.number == b.number:
        return _Lowest(a.number, a.n_cells + b.n_cells, min(a.others, b.others))
    low, high = (a, b) if a.number < b.number else (b, a)
    return _Lowest(low.number, low.n_cells, min(low.others, high.number))
