"""Cells of a satellite's elevation model as measurements of means over parallelograms."""

from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np
from pyproj import CRS

from survey.core import Bounds, FloatArray, InputError, same_vertical_datum
from survey.core.crs import equal_crs
from survey.core.transformation import transformed
from survey.data import Dem, SurfacePoints
from survey.reconstruction.gp.engines.fourier_basis import FourierBasis
from survey.reconstruction.prior import PriorErrors
from survey.reconstruction.prior_likelihood import (
    ErrorSizes,
    Innovations,
    Level,
    conflicts,
    level,
    likeliest_sizes,
)

# Beyond these many cells their covariance is no longer a detail.
_MOST_CELLS = 4000
# Blocks of cells where there are more.
_N_BLOCKS = 1600
_NONE_ESTIMATED = ErrorSizes(0.0, 0.0, 1.0, 0.0, 0.0, 0.0)


class CommonError(NamedTuple):
    """An error that all cells have in common, linear in one unknown.

    `name`: name of the unknown, with its unit. `rows` (C,): error of each cell for an unknown of 1 [m per
    unit]. `sigma`: prior standard deviation of the unknown.
    """

    name: str
    rows: FloatArray
    sigma: float

    @property
    def is_offset(self) -> bool:
        """Whether it is a vertical offset."""
        return self.name in _OFFSETS


_OFFSETS = ("datum_m", "epoch_m")


@dataclass(frozen=True)
class SatelliteCells:
    r"""Means of the terrain over parallelograms, each with noise.

    .. math::  S_c = \frac{1}{|c|} \int_c f + \sum_j a_{cj} \beta_j + \eta_c, \qquad \eta \sim N(0, R),
               \qquad \beta_j \sim N(0, \sigma_j^2)

    A cell is no point: read at its centre it flattens crests and fills hollows. The unknowns β are offsets of datum and
    epoch, a tilt, and a horizontal shift, which acts through the slope of the cells themselves.

    `centre` (C, 2): easting and northing in the survey's CRS [m]. `sides` (C, 2, 2): the two sides of each
    cell, as vectors [m]. `height` (C,): mean heights [m]. `common`: errors that all cells have in common.
    `sizes`: sizes of the errors that make up R.
    """

    centre: FloatArray
    sides: FloatArray
    height: FloatArray
    common: tuple[CommonError, ...] = ()
    sizes: ErrorSizes = _NONE_ESTIMATED

    @classmethod
    def of(cls, dem: Dem, crs: CRS, bounds: Bounds, errors: PriorErrors) -> Self:
        """Take the cells of a coarse model, in its own grid and CRS, that meet the site."""
        column, row = np.meshgrid(np.arange(dem.shape[1]) + 0.5, np.arange(dem.shape[0]) + 0.5)
        here = _placed(dem, crs, column.ravel(), row.ravel())
        half = 0.5 * np.eye(2)
        ends = [
            [_placed(dem, crs, column.ravel() + sign * dc, row.ravel() + sign * dr) for sign in (1.0, -1.0)]
            for dc, dr in half
        ]
        sides = np.stack([after - before for after, before in ends], axis=1)
        reach = 0.5 * np.abs(sides).sum(axis=1)
        low, high = np.array(bounds[:2]), np.array(bounds[2:])
        height = dem.elevation.ravel()
        kept = ((here + reach > low) & (here - reach < high)).all(axis=1) & np.isfinite(height)
        if not 0 < kept.sum() <= _MOST_CELLS:
            raise InputError(
                f"{int(kept.sum())} known cells of the satellite's model meet the site; between 1 and {_MOST_CELLS} are "
                "needed, check that both are in the same place, or take coarser cells."
            )
        centre = here[kept]
        slope = _slopes(dem, sides)[kept]
        return cls(centre, sides[kept], height[kept], _common_errors(centre, slope, errors))

    def with_sizes(self, sizes: ErrorSizes) -> Self:
        """Return the cells with sizes of their own errors and of their offset."""
        common = tuple(
            one._replace(sigma=one.sigma * sizes.level_factor) if one.is_offset else one
            for one in self.common
        )
        return replace(self, common=common, sizes=sizes)

    def with_free_level(self, sigma_m: float) -> Self:
        """Return the cells with an offset of this standard deviation in place of those assumed."""
        others = tuple(one for one in self.common if not one.is_offset)
        return replace(self, common=(CommonError(_OFFSETS[0], np.ones(len(self)), sigma_m), *others))

    def with_slope(self, slope: FloatArray) -> Self:
        """Return the cells with a shift that acts through slopes (C, 2) of the terrain [m/m]."""
        rows = {"shift_east_m": -slope[:, 0], "shift_north_m": -slope[:, 1]}
        return replace(
            self, common=tuple(one._replace(rows=rows.get(one.name, one.rows)) for one in self.common)
        )

    @property
    def covariance(self) -> FloatArray:
        """R (C, C) [m²]."""
        return self.sizes.covariance(self.centre)

    @property
    def common_rows(self) -> FloatArray:
        """Errors of the cells (C, J) for common unknowns of 1."""
        return np.column_stack([np.zeros((len(self), 0)), *(one.rows for one in self.common)])

    @property
    def common_sigma(self) -> FloatArray:
        """Prior standard deviations (J,) of the common unknowns."""
        return np.array([one.sigma for one in self.common])

    def common_facts(self, value: FloatArray, covariance: FloatArray) -> dict[str, float]:
        """Return the estimated common unknowns (J,) and their standard deviations, for the record."""
        facts: dict[str, float] = {}
        for k, one in enumerate(self.common):
            facts[f"satellite_{one.name}"] = float(value[k])
            facts[f"satellite_{one.name}_sigma"] = float(np.sqrt(covariance[k, k]))
        offsets = [k for k, one in enumerate(self.common) if one.is_offset]
        if offsets:
            facts["satellite_offset_m"] = float(value[offsets].sum())
            facts["satellite_offset_m_sigma"] = float(np.sqrt(covariance[np.ix_(offsets, offsets)].sum()))
        return facts

    def innovations(self, expected: FloatArray, covariance: FloatArray) -> Innovations:
        """Return the cells less the means that points alone state, with the covariance of all but their own errors.

        `expected`, `covariance` (C,) and (C, C): means [m] and their covariance [m²].
        """
        others = [one.rows * one.sigma for one in self.common if not one.is_offset]
        common = np.column_stack([np.zeros((len(self), 0)), *others])
        level_m = float(np.linalg.norm([one.sigma for one in self.common if one.is_offset]))
        return Innovations(self.centre, self.height - expected, covariance + common @ common.T, level_m)

    def misfits(self, expected: FloatArray, covariance: FloatArray) -> Innovations:
        """Return the innovations with the covariance of all errors but the offset, the cells' own included.

        `expected`, `covariance` (C,) and (C, C): means that points alone state [m] and their covariance [m²].
        """
        innovations = self.innovations(expected, covariance)
        return innovations._replace(covariance=innovations.covariance + self.covariance)

    def __len__(self) -> int:
        return len(self.height)

    def features(self, basis: FourierBasis, amplitudes: FloatArray) -> FloatArray:
        r"""Return the means of the whitened waves over the cells (C, m).

        Over a parallelogram with sides u and v the mean of a wave is exactly
        ``sinc(ω·u/2) sinc(ω·v/2)`` of its value at the centre.
        """
        omega = basis.omega
        phase = (self.centre - basis.box.centre_m) @ omega.T
        damped = amplitudes * np.ones_like(phase)
        for side in (self.sides[:, 0], self.sides[:, 1]):
            damped *= np.sinc((side @ omega.T) / (2.0 * np.pi))
        return np.concatenate([damped * np.cos(phase), (damped * np.sin(phase))[:, 1:]], axis=1)


def in_blocks(dem: Dem, bounds: Bounds, errors: PriorErrors) -> tuple[Dem, PriorErrors]:
    """Return a coarse model in blocks of cells where thousands of these meet the site, and the error model of a block.

    The independent error of a block of n × n cells is that of a cell over n; what cells share is unchanged.
    """
    n_cells = (bounds[2] - bounds[0]) * (bounds[3] - bounds[1]) / dem.step_m**2
    if n_cells <= _MOST_CELLS:
        return dem, errors
    n = int(np.ceil(np.sqrt(n_cells / _N_BLOCKS)))
    white = errors.white._replace(median_m=errors.white.median_m / n)
    return dem.block_mean(n * dem.step_m), errors._replace(white=white)


def _common_errors(centre: FloatArray, slope: FloatArray, errors: PriorErrors) -> tuple[CommonError, ...]:
    """Return the errors of offset, tilt and shift that the model has, and leave out those of size 0."""
    ones, (east_km, north_km) = np.ones(len(centre)), (centre - centre.mean(axis=0)).T / 1000.0
    tilt, shift = errors.tilt_sigma_m_per_km, errors.shift_sigma_m
    every = (
        CommonError(_OFFSETS[0], ones, errors.datum_sigma_m),
        CommonError(_OFFSETS[1], ones, errors.epoch_sigma_m),
        CommonError("tilt_east_m_per_km", east_km, tilt),
        CommonError("tilt_north_m_per_km", north_km, tilt),
        CommonError("shift_east_m", -slope[:, 0], shift),
        CommonError("shift_north_m", -slope[:, 1], shift),
    )
    return tuple(one for one in every if one.sigma > 0.0)


def _slopes(dem: Dem, sides: FloatArray) -> FloatArray:
    """Return the slope (N, 2) of a coarse model at its cells, east and north in the survey's CRS; 0 beside nodata."""
    down, right = np.gradient(dem.elevation)
    along = np.nan_to_num(np.column_stack([right.ravel(), down.ravel()]))
    slope: FloatArray = np.linalg.solve(sides, along[:, :, None])[:, :, 0]
    return slope


def _placed(dem: Dem, crs: CRS, column: FloatArray, row: FloatArray) -> FloatArray:
    """Return places (N, 2) in a CRS of fractional columns and rows of a raster."""
    a, b, c, d, e, f = tuple(dem.transform)[:6]
    places = np.column_stack([a * column + b * row + c, d * column + e * row + f])
    if equal_crs(dem.crs, crs):
        return places
    return transformed(places, dem.crs, crs, "the satellite's model")


def prior_cells(
    satellite: Dem | None, points: SurfacePoints, bounds: Bounds, errors: PriorErrors
) -> tuple[SatelliteCells | None, PriorErrors]:
    """Return a prior's cells, in blocks where there are thousands of them, with their error model."""
    if satellite is None:
        return None, errors
    same_vertical_datum(satellite.vertical_datum, points.vertical_datum, "the satellite and the points")
    dem, errors = in_blocks(satellite, bounds, errors)
    return SatelliteCells.of(dem, points.crs, bounds, errors), errors


# The level of a prior that contradicts the points has this standard deviation, in offsets. Its stated level is left out
# where it is less probable than the share.
_FREE_LEVEL, _LEAST_LEVEL = 10.0, 0.005


class StatedLevel(NamedTuple):
    """Cells whose level contradicts the points, as their error model has it, and the probability that it holds."""

    cells: SatelliteCells
    probability: float


class JudgedCells(NamedTuple):
    """Cells with the sizes of their errors, conflicts of prior and points, and the cells with their stated level."""

    cells: SatelliteCells
    conflicts: tuple[str, ...]
    stated: StatedLevel | None = None


def judge_cells(
    cells: SatelliteCells, errors: PriorErrors, expected: FloatArray, covariance: FloatArray
) -> JudgedCells:
    """Estimate the sizes of the cells' errors, with a free level where prior and points disagree.

    `expected`, `covariance` (C,) and (C, C): means that points alone state [m] and their covariance [m²].
    """
    innovations = cells.innovations(expected, covariance)
    sized, stated = cells.with_sizes(likeliest_sizes(innovations, errors)), None
    height = _level(innovations, sized, errors)
    if height.is_conflict:
        free = cells.with_free_level(_FREE_LEVEL * abs(height.offset_m))
        innovations, exact = free.innovations(expected, covariance), errors._replace(level_log_sd=0.0)
        sized = free.with_sizes(likeliest_sizes(innovations, exact))
        probability = _level(innovations, sized, errors).probability
        if probability >= _LEAST_LEVEL:
            stated = StatedLevel(cells.with_sizes(sized.sizes), probability)
    total = innovations._replace(covariance=innovations.with_level + sized.covariance)
    used = 0.0 if stated is None else stated.probability
    found = conflicts(height, total, sized.sizes.white_m, errors.white, used)
    return JudgedCells(sized, found, stated)


def _level(innovations: Innovations, cells: SatelliteCells, errors: PriorErrors) -> Level:
    """Return the offset of the cells from the points, with the errors that the cells have in their sizes."""
    own = innovations._replace(covariance=innovations.covariance + cells.covariance)
    return level(own, errors.level_sigma_m)
