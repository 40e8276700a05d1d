"""Maps of moving ice at other epochs than that of their survey, and maps with their age."""

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.dem import Dem
from survey.data.ice.motion import IceMotion
from survey.reconstruction.base import CHECK, CLAIM, ELEVATION, UNSEEN, Reconstruction
from survey.reconstruction.motion.map_age import AGE, MapAge


def with_age(result: Reconstruction, motion: IceMotion) -> Reconstruction:
    """Return a map with its age among the diagnostics.

    Parameters
    ----------
    result : Reconstruction
        Map of the epoch of the motion.
    motion : IceMotion
        Motion of the ice after the map.

    Returns
    -------
    Reconstruction
        The same map, which states velocity, lowering and for how long it holds its class.
    """
    facts = {AGE: MapAge.of(result.mean, result.std, motion).facts()}
    return replace(result, diagnostics={**result.diagnostics, **facts})


def at_epoch(result: Reconstruction, motion: IceMotion, epoch_s: float) -> tuple[Reconstruction, IceMotion]:
    """Move a map of ice that flows and lowers to another epoch.

    Parameters
    ----------
    result : Reconstruction
        Map of the elevation at the epoch of the motion.
    motion : IceMotion
        Motion of the ice after the map.
    epoch_s : float
        Epoch wanted, in seconds of the recording.

    Returns
    -------
    result : Reconstruction
        On the same nodes, with its age. The standard deviation includes that of the motion; ice that flows in from beyond
        the map is unseen. Bounds and tests of the map, which are those of its own epoch, are left out.
    motion : IceMotion
        The same motion, counted from the new epoch.

    Raises
    ------
    InputError
        A map of another quantity, or an epoch by which the ice has left it.

    Notes
    -----
    Errors of map and motion count as independent, as they nearly are at the middle of a survey.
    """
    if result.quantity != ELEVATION:
        raise InputError(
            f"the map is one of {result.quantity}; another epoch is computed of {ELEVATION} alone."
        )
    grid, mean = result.mean.grid(), result.mean.elevation
    times = np.full(len(grid.xy), epoch_s)
    flat = np.column_stack([grid.xy, np.zeros(len(grid.xy))])
    from_xy = motion.at_epoch(flat, times)[:, :2]
    height = result.mean.at(from_xy) + motion.displacement(from_xy, times)[:, 2]
    if not np.isfinite(height).any():
        raise InputError(
            f"by the epoch {epoch_s:g} s all ice of the map has left it; name an epoch nearer to that of the map, "
            f"{motion.epoch_s:g} s."
        )
    variance = result.std.at(from_xy) ** 2 + _motion_variance(result.mean, motion, from_xy, times)
    moved = replace(
        result,
        mean=Dem.on(grid, height.reshape(mean.shape), result.mean.vertical_datum),
        std=Dem.on(grid, np.sqrt(variance).reshape(mean.shape), result.std.vertical_datum),
        support=_support(result, from_xy),
        lower=None,
        upper=None,
        diagnostics={k: v for k, v in result.diagnostics.items() if k not in (CHECK, CLAIM)},
    )
    later = replace(motion, epoch_s=float(epoch_s))
    return with_age(moved, later), later


def _motion_variance(mean: Dem, motion: IceMotion, xy: FloatArray, times: FloatArray) -> FloatArray:
    """Return the variance (N,) that the motion adds to heights that it has moved by some times [m²]."""
    slopes = [Dem.on(mean.grid(), part).at(xy) for part in mean.gradient()]
    by_shift = np.column_stack([-slopes[0], -slopes[1], np.ones(len(xy))])
    by = np.einsum("na,nar->nr", by_shift, motion.derivatives(xy, times))
    variance: FloatArray = np.einsum("nr,rs,ns->n", by, motion.spread, by)
    return variance


def _support(result: Reconstruction, from_xy: FloatArray) -> npt.NDArray[np.uint8]:
    """Return the codes (H, W) of the nodes that are nearest to where the ice comes from."""
    grid = result.mean.grid()
    column = np.rint((from_xy[:, 0] - grid.x[0]) / grid.step_m).astype(np.int64)
    row = np.rint((grid.y[0] - from_xy[:, 1]) / grid.step_m).astype(np.int64)
    rows, columns = grid.shape
    inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    codes = result.support[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)]
    return np.where(inside, codes, UNSEEN).reshape(grid.shape).astype(np.uint8)
