"""Co-register two elevation models on unchanged ground (Nuth and Kääb 2011)."""

from dataclasses import dataclass

import numpy as np

from survey.core import BoolArray, FloatArray, InputError, same_crs, same_vertical_datum
from survey.data.dem import Dem
from survey.scoring.accuracy import NMAD_FACTOR

_N_ROUNDS = 30
_CONVERGED_CELLS = 1e-4
_N_LEAST = 50
# Differences farther than this from the median, in robust deviations, take no part.
_TRIMMED = 3.0
# Least spread of the slopes [m/m]: a horizontal shift of flat ground is unobservable.
_LEAST_SLOPE_SPREAD = 1e-3


@dataclass(frozen=True)
class Shift:
    """Translation that aligns a surface with another one.

    `east_m`, `north_m`, `up_m`: added to the coordinates, in the CRS of the surfaces [m]. `n`: cells of
    unchanged ground in the fit. `nmad_before_m`, `nmad_after_m`: spread of the difference there [m].
    """

    east_m: float
    north_m: float
    up_m: float
    n: int
    nmad_before_m: float
    nmad_after_m: float

    def applied(self, xy: FloatArray, dem: Dem) -> FloatArray:
        """Return the heights (N,) of the shifted surface at places (N, 2) [m].

        `xy` (N, 2): easting and northing [m]. Returns (N,): heights [m]; NaN where the shifted surface has
        none.
        """
        return dem.at(xy - (self.east_m, self.north_m)) + self.up_m


def coregister(moving: Dem, reference: Dem, stable: BoolArray | None = None) -> Shift:
    r"""Estimate the shift that aligns a surface with a reference.

    .. math::  z_{ref}(x) - z(x - s) - s_z \approx s \cdot \nabla z(x), \qquad
               \text{or}\quad dh / \tan\beta = a \cos(b - \psi) + c

    Nuth and Kääb (2011, The Cryosphere 5, 271–290) write it with slope β and aspect ψ; here
    the same plane in the slopes is fitted by least squares, differences beyond three robust
    deviations trimmed, and repeated until the shift converges.

    `stable` (H, W) bool: the reference's cells that did not change; all by default.

    One shift for the whole raster: no tilt, no scale, no jitter of a sensor.

    >>> from survey.data.grid import Grid
    >>> x, y = np.meshgrid(np.arange(41.0), np.arange(41.0))
    >>> def hills(east, north):
    ...     return 9.0 * np.sin((x - east) / 6.0) + 7.0 * np.cos((40.0 - y - north) / 5.0)
    >>> grid = Grid((0.0, 0.0, 40.0, 40.0), 1.0)
    >>> shift = coregister(Dem.on(grid, hills(0.0, 0.0)), Dem.on(grid, hills(1.5, -0.5) + 2.0))
    >>> round(shift.east_m, 1), round(shift.north_m, 1), round(shift.up_m, 1)
    (1.5, -0.5, 2.0)
    """
    same_crs(moving.crs, reference.crs, "the two elevation models")
    same_vertical_datum(moving.vertical_datum, reference.vertical_datum, "the two elevation models")
    known = np.isfinite(reference.elevation) & (True if stable is None else stable)
    xy, heights = reference.xy[known.ravel()], reference.elevation[known]
    slopes = tuple(gradient[known] for gradient in reference.gradient())
    before = heights - moving.at(xy)
    shift = np.zeros(3)
    for _ in range(_N_ROUNDS):
        step, n = _step(xy, heights, slopes, moving, shift)
        shift += step
        if np.abs(step[:2]).max() < _CONVERGED_CELLS * reference.step_m:
            break
    after = heights - moving.at(xy - shift[:2]) - shift[2]
    east, north, up = shift.tolist()
    return Shift(east, north, up, n, _nmad(before), _nmad(after))


def _step(
    xy: FloatArray, heights: FloatArray, slopes: tuple[FloatArray, ...], moving: Dem, shift: FloatArray
) -> tuple[FloatArray, int]:
    """Return one correction of the shift, and how many cells gave it."""
    rest = heights - moving.at(xy - shift[:2]) - shift[2]
    columns = np.column_stack([-slopes[0], -slopes[1], np.ones(len(rest))])
    used = np.isfinite(rest) & np.isfinite(columns).all(axis=1)
    if used.sum() < _N_LEAST:
        raise InputError(
            f"{int(used.sum())} cells of unchanged ground are common to both elevation models; {_N_LEAST} are needed to align them."
        )
    far = np.abs(rest - np.median(rest[used]))
    used &= far <= _TRIMMED * max(_nmad(rest[used]), 1e-9)
    if columns[used, :2].std(axis=0).min() < _LEAST_SLOPE_SPREAD:
        raise InputError(
            "the unchanged ground is too flat to determine a horizontal shift; leave co-registration out."
        )
    solution: FloatArray = np.linalg.lstsq(columns[used], rest[used], rcond=None)[0]
    return solution, int(used.sum())


def _nmad(values: FloatArray) -> float:
    e = values[np.isfinite(values)]
    return float(NMAD_FACTOR * np.median(np.abs(e - np.median(e)))) if len(e) else float("nan")
