"""Differences between strips and control points, such as GNSS measurements."""

import numpy as np
import numpy.typing as npt

from survey.core.arrays import FloatArray
from survey.reconstruction.tiled.cells.sorting import STEP_M
from survey.reconstruction.tiled.job import Control
from survey.reconstruction.tiled.strips.overlaps import OVERLAP

_REACH_CELLS = 1.6
_LEAST_CELLS = 5


def control_differences(
    cells: npt.NDArray[np.void],
    cell_m: float,
    point_variance_m2: FloatArray,
    slope: FloatArray,
    control: Control,
) -> npt.NDArray[np.void]:
    """Return the differences of strips and control points, each by a plane through the cells about it.

    Parameters
    ----------
    cells : (N,) ndarray of CELL
        Cells of the tile.
    cell_m : float
        Side of a cell [m].
    point_variance_m2 : (N,) ndarray
        Variance of a point in each cell [m²].
    slope : (N, 2) ndarray
        Slopes [m/m].
    control : Control
        Control points.

    Returns
    -------
    (M,) ndarray of OVERLAP
        With `second` 0 and `n` 1. A control point that several strips see counts once in all.
    """
    x, y = ((cells[a] + cells[b]) * cell_m for a, b in (("column", "x"), ("row", "y")))
    found: list[tuple[float, ...]] = []
    for (px, py, pz), sigma_m in zip(control.xyz, control.sigma_m, strict=True):
        near = np.flatnonzero(
            (np.abs(x - px) < _REACH_CELLS * cell_m) & (np.abs(y - py) < _REACH_CELLS * cell_m)
        )
        rows = []
        for key in np.unique(cells["strip"][near]):
            own = near[cells["strip"][near] == key]
            if len(own) < _LEAST_CELLS:
                continue
            noise = point_variance_m2[own] / cells["n"][own]
            z, fit_m2 = _plane_at(np.column_stack([x[own] - px, y[own] - py]), cells["z"][own], noise)
            e, v = slope[own].mean(axis=0)
            rows.append((int(key), z - pz, fit_m2, float(e), float(v)))
        for key, d, fit_m2, e, v in rows:
            variance = fit_m2 + len(rows) * sigma_m**2
            sums = (1.0, e, v, e * e, e * v, v * v, d, d * e, d * v, d * d)
            # Each control point is a block of its own.
            number = round(py / STEP_M), round(px / STEP_M)
            found.append((key, 0, px, py, *number, variance, variance, d, 0.0, *sums))
    return np.array(found, OVERLAP)


def _plane_at(xy: FloatArray, z: FloatArray, noise_m2: FloatArray) -> tuple[float, float]:
    """Return the height of the plane through cells above the origin [m] and its variance [m²].

    What the plane leaves of the cells' heights is relief that is alike in neighbouring cells: it counts in full.
    """
    design = np.column_stack([np.ones(len(xy)), xy])
    solution, *_ = np.linalg.lstsq(design, z, rcond=None)
    misfit = float(np.sum((z - design @ solution) ** 2)) / max(len(z) - 3, 1)
    return float(solution[0]), max(misfit, float(noise_m2.mean()))
