"""Posterior of the terrain of a joint estimate: waves and plane, without the unknowns that landmarks share.

It takes a small part of the memory of a complete solution, and answers every question about the terrain alone.
"""

from dataclasses import dataclass
from typing import Any

import numba
import numpy as np

from survey.core.arrays import FloatArray, IntArray
from survey.data.grid import Grid
from survey.reconstruction.gp.engines.fourier.weight_posterior import WeightPosterior
from survey.reconstruction.gp.engines.fourier_basis import FourierBasis
from survey.reconstruction.gp.engines.polynomial_trend import PolynomialTrend
from survey.reconstruction.joint.satellite_cells import SatelliteCells


@dataclass(frozen=True)
class TerrainPosterior:
    """Gaussian posterior of heights, as waves and a plane.

    Parameters
    ----------
    weights : WeightPosterior
        Covariance of the whitened weights of m waves.
    mean : (m,) ndarray
        Their estimate.
    trend : PolynomialTrend
        Plane below the waves.
    plane : (3,) ndarray
        Estimate of its coefficients [m].
    plane_covariance : (3, 3) ndarray
        Their covariance [m²].
    cross : (m, 3) ndarray
        Covariance of the weights with them [m].
    datum_m : float
        Height that heights are counted from [m].
    finer_m2 : float
        Variance of the relief that the waves leave out [m²].
    """

    weights: WeightPosterior
    mean: FloatArray
    trend: PolynomialTrend
    plane: FloatArray
    plane_covariance: FloatArray
    cross: FloatArray
    datum_m: float
    finer_m2: float

    def height(self, xy: FloatArray) -> FloatArray:
        """Return the most likely height (M,) at places (M, 2) [m]."""
        return self.waves(xy) + self.trend.columns(xy) @ self.plane + self.datum_m

    def waves(self, xy: FloatArray) -> FloatArray:
        """Return the part of the waves in the most likely height (M,) at places (M, 2) [m]."""
        return self.weights.basis.box.evaluate(xy, self._coefficients(self.mean))

    def gradient(self, xy: FloatArray, highest_rad_per_m: float = np.inf) -> FloatArray:
        """Return the slope (M, 2) of the most likely surface at places (M, 2) [m/m], of waves up to an angular frequency."""
        basis = self.weights.basis
        is_long = basis.doubled(np.linalg.norm(basis.omega, axis=-1) <= highest_rad_per_m)
        box, coefficients = basis.box, self._coefficients(self.mean * is_long)
        slopes = [box.evaluate(xy, box.derivative(coefficients, axis)) for axis in (0, 1)]
        gradient: FloatArray = np.stack(slopes, axis=-1) + self.trend.gradient @ self.plane
        return gradient

    def cell_means(self, cells: SatelliteCells) -> tuple[FloatArray, FloatArray]:
        """Return the mean heights (C,) of cells [m] and their covariance (C, C) [m²]."""
        waves = cells.features(self.weights.basis, self.weights.amplitudes)
        columns = self.trend.columns(cells.centre)
        means: FloatArray = waves @ self.mean + columns @ self.plane + self.datum_m
        return means, self._covariance(waves, columns)

    def covariance(self, xy: FloatArray) -> FloatArray:
        """Return the covariance (M, M) of the heights at places (M, 2) [m²], relief finer than the map included.

        It depends on where points lie and how they err, on no height that was measured.
        """
        covariance = self._covariance(self.waves_at(xy), self.trend.columns(xy))
        covariance[np.diag_indices(len(xy))] += self.finer_m2
        return covariance

    def fields(self, grid: Grid) -> tuple[FloatArray, FloatArray]:
        """Return height and standard deviation (H, W) on a grid [m], relief finer than the map included."""
        box = self.weights.basis.box
        columns = self.trend.columns(np.stack(np.meshgrid(grid.x, grid.y), axis=-1))
        mean = box.evaluate_on_axes(grid.x, grid.y, self._coefficients(self.mean))
        mean += columns @ self.plane + self.datum_m
        variance = box.evaluate_on_axes(grid.x, grid.y, self.weights.variance_coefficients())
        fields = [box.evaluate_on_axes(grid.x, grid.y, self._coefficients(c)) for c in self.cross.T]
        variance += 2.0 * np.sum(columns * np.stack(fields, axis=-1), axis=-1)
        variance += np.einsum("hwi,ij,hwj->hw", columns, self.plane_covariance, columns)
        variance += self.finer_m2
        return mean, np.sqrt(np.maximum(variance, 0.0))

    def rises(self, steps: FloatArray, waves: list[FloatArray]) -> tuple[FloatArray, FloatArray]:
        """Return the rises (M, 2) [m] between both ends of two lines about each place, and their covariance (M, 2, 2).

        Relief that the waves leave out is no part of it. `steps` (2, 2) leads from a place to one end of each line [m],
        and `waves` are those of `waves_between` for each of them.
        """
        columns = np.array([self.trend.columns(2.0 * step[None])[0] for step in steps])
        columns -= self.trend.columns(np.zeros((1, 2)))
        rises = np.stack([w @ self.mean for w in waves], axis=1) + columns @ self.plane
        cross = self.cross @ columns.T
        covariance = np.tile(columns @ self.plane_covariance @ columns.T, (len(rises), 1, 1))
        seen = [self.weights.times_each(w) for w in waves]
        for a in (0, 1):
            for b in (0, 1):
                covariance[:, a, b] += np.einsum("mi,im->m", waves[a], seen[b])
                covariance[:, a, b] += waves[a] @ cross[:, b] + waves[b] @ cross[:, a]
        return rises, covariance

    def waves_at(self, xy: FloatArray) -> FloatArray:
        """Return the whitened waves (N, m) at places (N, 2) [m], for few places."""
        return waves_at(xy, self.weights.basis, self.weights.amplitudes)

    def waves_between(self, xy: FloatArray, step: FloatArray) -> FloatArray:
        """Return the differences (N, m) of the whitened waves a step (2,) before and behind places (N, 2) [m]."""
        return self.waves_at(xy + step) - self.waves_at(xy - step)

    def _coefficients(self, whitened: FloatArray) -> Any:
        """Return the coefficients of a field, as `FourierBox.evaluate` takes them, from whitened weights (m,)."""
        basis = self.weights.basis
        return basis.coefficients_of(basis.doubled(self.weights.amplitudes) * whitened)

    def _covariance(self, waves: FloatArray, columns: FloatArray) -> FloatArray:
        """Return the covariance of functionals of waves (M, m) and plane (M, 3)."""
        cross = waves @ self.cross @ columns.T
        plane: FloatArray = columns @ self.plane_covariance @ columns.T
        return waves @ self.weights.times_each(waves) + cross + cross.T + plane


def waves_at(xy: FloatArray, basis: FourierBasis, amplitudes: FloatArray) -> FloatArray:
    """Return the whitened waves (N, m) at places (N, 2) [m], for few places."""
    waves = np.empty((len(xy), basis.n_modes))
    fill_waves(*basis.box.phases(xy), basis.lattice, amplitudes, waves)
    return waves


@numba.njit(cache=True, fastmath=True)
def fill_waves(x: FloatArray, y: FloatArray, lattice: IntArray, d: FloatArray, out: FloatArray) -> None:
    """Write the whitened waves at points (N, m): cosines, then sines, by turning unit vectors step by step."""
    n = lattice.shape[0]
    half_p, half_q = 0, 0
    for k in range(n):
        half_p, half_q = max(half_p, lattice[k, 0]), max(half_q, abs(lattice[k, 1]))
    turn_x = np.empty(half_p + 1, dtype=np.complex128)
    turn_y = np.empty(2 * half_q + 1, dtype=np.complex128)
    for i in range(x.size):
        for p in range(half_p + 1):
            turn_x[p] = complex(np.cos(p * x[i]), np.sin(p * x[i]))
        for q in range(half_q + 1):
            turn_y[half_q + q] = complex(np.cos(q * y[i]), np.sin(q * y[i]))
            turn_y[half_q - q] = turn_y[half_q + q].conjugate()
        for k in range(n):
            a, b = turn_x[lattice[k, 0]], turn_y[lattice[k, 1] + half_q]
            out[i, k] = d[k] * (a.real * b.real - a.imag * b.imag)
            if k > 0:
                out[i, n + k - 1] = d[k] * (a.real * b.imag + a.imag * b.real)
