"""Error statistics by class of ground: slope, land cover, or any classes of the nodes or checkpoints."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.scoring.accuracy import Calibration, ErrorStatistics

SLOPE_EDGES_DEG = (0.0, 5.0, 10.0, 20.0, 30.0, 90.0)
"""Limits of the classes of slope [deg]."""
NO_CLASS = "no class"
"""Name of the errors that lie in none of the classes."""


@dataclass(frozen=True)
class ClassScore:
    """Error statistics of one class.

    Parameters
    ----------
    name : str
        Name of the class.
    n : int
        Number of errors in it.
    rmse_m, nmad_m, bias_m : float
        Root mean square, normalized median absolute deviation and mean of the errors [m].
    coverage_95 : float
        Share of the errors within ±1.96 stated standard deviations; NaN where none is stated.
    """

    name: str
    n: int
    rmse_m: float
    nmad_m: float
    bias_m: float
    coverage_95: float


def class_scores(errors: Any, std: Any, classes: Any) -> tuple[ClassScore, ...]:
    """Compute error statistics for each class.

    Parameters
    ----------
    errors : (N,) array_like
        Map minus reference [m].
    std : (N,) array_like
        Stated standard deviations [m]; NaN where none is stated.
    classes : (N,) array_like of str
        Name of the class of each error.

    Returns
    -------
    tuple of ClassScore
        One for each class that occurs, in the order of their names as `sorted` by numbers and letters.

    Raises
    ------
    InputError
        Arrays of different lengths, or none.

    Examples
    --------
    >>> rows = class_scores([0.1, -0.1, 0.4], [0.1, 0.1, 0.1], ["ice", "ice", "rock"])
    >>> [(row.name, row.n, round(row.rmse_m, 2), row.coverage_95) for row in rows]
    [('ice', 2, 0.1, 1.0), ('rock', 1, 0.4, 0.0)]
    """
    e, s, c = np.asarray(errors, dtype=np.float64), np.asarray(std, dtype=np.float64), np.asarray(classes)
    if not (e.shape == s.shape == c.shape) or e.ndim != 1 or not len(e):
        raise InputError(
            f"there are {e.size} errors, {s.size} standard deviations and {c.size} classes; one of each was expected."
        )
    names = sorted(set(c.tolist()), key=_order)
    return tuple(_class_score(name, e[c == name], s[c == name]) for name in names)


def slope_classes(
    slope_deg: FloatArray, edges_deg: Sequence[float] = SLOPE_EDGES_DEG
) -> npt.NDArray[np.str_]:
    """Return the name of the class of each slope (N,) [deg].

    Parameters
    ----------
    slope_deg : (N,) ndarray
        Slopes [deg]; NaN belongs to no class.
    edges_deg : sequence of float
        Limits of the classes, ascending [deg]; a limit belongs to the steeper class.

    Returns
    -------
    (N,) ndarray of str
        Such as ``"5 to 10°"``.

    Examples
    --------
    >>> slope_classes(np.array([0.0, 5.0, 40.0, np.nan])).tolist()
    ['0 to 5°', '5 to 10°', '30 to 90°', 'no class']
    """
    names = np.array([f"{low:g} to {high:g}°" for low, high in pairwise(edges_deg)] + [NO_CLASS])
    index = np.searchsorted(edges_deg, slope_deg, side="right") - 1
    known = np.isfinite(slope_deg) & (index >= 0) & (index < len(edges_deg) - 1)
    found: npt.NDArray[np.str_] = names[np.where(known, index, len(edges_deg) - 1)]
    return found


def _class_score(name: str, errors: FloatArray, std: FloatArray) -> ClassScore:
    found = ErrorStatistics.of(errors)
    coverage = Calibration.of(errors, std).coverage_95
    return ClassScore(name, found.n, found.rmse_m, found.nmad_m, found.bias_m, coverage)


def _order(name: str) -> tuple[bool, float, str]:
    """Sort names that begin with a number by it, the others by their letters, and no class last."""
    head = name.split(" ", maxsplit=1)[0]
    number = float(head) if head.replace(".", "", 1).isdigit() else np.inf
    return name == NO_CLASS, number, name
