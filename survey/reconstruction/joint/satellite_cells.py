"""Cells of a satellite's elevation model as measurements of means over parallelograms."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from pyproj import CRS

from survey.core.arrays import Bounds, FloatArray
from survey.core.crs.agreement import equal_crs
from survey.core.crs.transformation import transformed
from survey.core.errors import InputError
from survey.data.dem import Dem
from survey.reconstruction.gp.config import SatelliteErrors
from survey.reconstruction.gp.engines.fourier_basis import FourierBasis

# Beyond these many cells their covariance is no longer a detail.
_MOST_CELLS = 4000
# Between these an unstated error is looked for [m].
_SIGMAS_M = (0.05, 20.0)


@dataclass(frozen=True)
class SatelliteCells:
    r"""Means of the terrain over parallelograms, each with noise.

    .. math::  S_c = \frac{1}{|c|} \int_c f + \beta + \eta_c, \qquad \eta \sim N(0, R),
               \qquad \beta \sim N(0, \sigma_\beta^2)

    A cell is no point: read at its centre it flattens crests and fills hollows.

    Parameters
    ----------
    centre : (C, 2) ndarray
        Easting and northing in the survey's CRS [m].
    sides : (C, 2, 2) ndarray
        The two sides of each cell, as vectors [m].
    height : (C,) ndarray
        Mean heights [m].
    covariance : (C, C) ndarray
        R [m²].
    datum_sigma_m : float
        σ_β: what all cells may be too high or too low by [m]; 0 when known.
    """

    centre: FloatArray
    sides: FloatArray
    height: FloatArray
    covariance: FloatArray
    datum_sigma_m: float

    @classmethod
    def of(cls, dem: Dem, crs: CRS, bounds: Bounds, errors: SatelliteErrors) -> Self:
        """Take the cells of a coarse model, in its own grid and CRS, that meet the site.

        Raises
        ------
        InputError
            None does, the model has no CRS, or more than 4,000 do.
        """
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
        covariance = np.zeros((len(centre), len(centre)))
        if errors.correlated_sigma_m > 0.0:
            distance = np.hypot(*(centre[:, None] - centre[None]).transpose(2, 0, 1))
            covariance += errors.correlated_sigma_m**2 * np.exp(-distance / errors.correlation_m)
        cells = cls(centre, sides[kept], height[kept], covariance, errors.datum_sigma_m)
        return cells if errors.sigma_m is None else cells.with_sigma(errors.sigma_m)

    def with_sigma(self, sigma_m: float) -> Self:
        """Return the cells with an independent error of their own beside what they share."""
        return replace(self, covariance=self.covariance + sigma_m**2 * np.eye(len(self)))

    def likeliest_sigma_m(self, expected: FloatArray, covariance: FloatArray) -> float:
        r"""Return the independent error that is likeliest, given what landmarks alone say of the cells' means.

        .. math::  S - \mu \sim N(0, \Sigma + R + \sigma_\beta^2 1 1^T + \sigma^2 I)

        Parameters
        ----------
        expected, covariance : (C,) and (C, C) ndarray
            μ [m] and Σ [m²].
        """
        innovation = self.height - expected
        rest = covariance + self.covariance + self.datum_sigma_m**2
        value, vector = np.linalg.eigh(0.5 * (rest + rest.T))
        squared = (vector.T @ innovation) ** 2
        tried = np.geomspace(*_SIGMAS_M, 200)
        total = np.maximum(value, 0.0)[:, None] + tried**2
        misfit = np.sum(np.log(total) + squared[:, None] / total, axis=0)
        return float(tried[np.argmin(misfit)])

    def __len__(self) -> int:
        return len(self.height)

    def features(self, basis: FourierBasis, amplitudes: FloatArray) -> FloatArray:
        r"""Means of the whitened waves over the cells (C, m).

        Over a parallelogram with sides u and v the mean of a wave is exactly
        ``sinc(ω·u/2) sinc(ω·v/2)`` of its value at the centre.
        """
        omega = basis.omega
        phase = (self.centre - basis.box.centre_m) @ omega.T
        damped = amplitudes * np.ones_like(phase)
        for side in (self.sides[:, 0], self.sides[:, 1]):
            damped *= np.sinc((side @ omega.T) / (2.0 * np.pi))
        return np.concatenate([damped * np.cos(phase), (damped * np.sin(phase))[:, 1:]], axis=1)


def _placed(dem: Dem, crs: CRS, column: FloatArray, row: FloatArray) -> FloatArray:
    """Return places (N, 2) in a CRS of fractional columns and rows of a raster."""
    a, b, c, d, e, f = tuple(dem.transform)[:6]
    places = np.column_stack([a * column + b * row + c, d * column + e * row + f])
    if equal_crs(dem.crs, crs):
        return places
    return transformed(places, dem.crs, crs, "the satellite's model")
