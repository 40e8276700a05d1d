"""The Fourier basis of the weight-space engine: which modes are retained, and how it is evaluated.

A stationary field on the site is written as a sum of real waves that are periodic on a box around it,

    f(x) = Σ_j d_j (a_j cos ω_j·x + b_j sin ω_j·x),     a_j, b_j ~ N(0, 1),

with ``d_j² = 2 S(ω_j) / (L_x L_y)`` (half of that for the constant), ω_j on the lattice of the box and S the
spectral density of the kernel.  The waves of one half plane suffice; they are stored as *runs* of neighbouring
lattice points, so that every loop over pairs of waves reads memory in order.
"""

from dataclasses import dataclass
from typing import Self

import finufft
import numpy as np
import numpy.typing as npt

from survey.core.arrays import FloatArray, IntArray

ComplexArray = npt.NDArray[np.complex128]

# Relative accuracy of the non-uniform transforms; the Gram matrix is scaled by up to 1e8 before it meets 1.
TRANSFORM_ACCURACY = 1e-12


@dataclass(frozen=True)
class FourierBox:
    """Rectangle on which the terrain is periodic: the site and a margin beyond which its opposite sides are uncorrelated.

    Parameters
    ----------
    centre_m : (2,) ndarray
        Centre of the site, x and y [m].
    period_m : (2,) ndarray
        Side lengths of the box [m].
    """

    centre_m: FloatArray
    period_m: FloatArray

    @classmethod
    def around(cls, bounds: tuple[float, float, float, float], halo_m: float) -> Self:
        """Return the box around (xmin, ymin, xmax, ymax) [m] whose far sides lie `halo_m` apart."""
        low, high = np.array(bounds[:2]), np.array(bounds[2:])
        return cls((low + high) / 2, high - low + halo_m)

    @property
    def area_m2(self) -> float:
        """Area of the box [m²]."""
        return float(np.prod(self.period_m))

    def phases(self, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the phases (N,) of the lowest waves along x and y [rad]."""
        scaled = (xy - self.centre_m) * (2 * np.pi / self.period_m)
        return np.ascontiguousarray(scaled[:, 0]), np.ascontiguousarray(scaled[:, 1])

    def omega(self, lattice: IntArray) -> FloatArray:
        """Return the angular frequencies (..., 2) of lattice points [rad/m]."""
        frequencies: FloatArray = lattice * (2 * np.pi / self.period_m)
        return frequencies

    def transform(self, xy: FloatArray, strengths: FloatArray, half: tuple[int, int]) -> ComplexArray:
        """Sum of ``strengths · exp(i(p·x + q·y))`` for ``|p| <= half[0]``, ``|q| <= half[1]``."""
        x, y = self.phases(xy)
        shape = (2 * half[0] + 1, 2 * half[1] + 1)
        result: ComplexArray = finufft.nufft2d1(
            x, y, strengths.astype(complex), shape, eps=TRANSFORM_ACCURACY, isign=1, nthreads=1
        )
        return result

    def evaluate(self, xy: FloatArray, coefficients: ComplexArray) -> FloatArray:
        """Return the value (N,) of ``Re Σ c exp(-i(p·x + q·y))`` at points; `coefficients` are centred on (0, 0)."""
        x, y = self.phases(xy)
        values: FloatArray = finufft.nufft2d2(
            x, y, coefficients, eps=TRANSFORM_ACCURACY, isign=-1, nthreads=1
        ).real
        return values

    def evaluate_on_axes(self, x: FloatArray, y: FloatArray, coefficients: ComplexArray) -> FloatArray:
        """Return the value (H, W) of ``Re Σ c exp(-i(p·x + q·y))`` on the nodes of two axes, by two matrix products."""
        half_p, half_q = (n // 2 for n in coefficients.shape)
        step_x, step_y = 2 * np.pi / self.period_m
        phase_x = np.outer(np.arange(-half_p, half_p + 1), (x - self.centre_m[0]) * step_x)
        phase_y = np.outer((y - self.centre_m[1]) * step_y, np.arange(-half_q, half_q + 1))
        along_x = coefficients.T @ np.exp(-1j * phase_x)
        # Only the real part of the second product is wanted, so that two real products do.
        values: FloatArray = np.cos(phase_y) @ along_x.real
        values += np.sin(phase_y) @ along_x.imag
        return values

    def derivative(self, coefficients: ComplexArray, axis: int) -> ComplexArray:
        """Return the coefficients of the derivative along x (`axis` 0) or y (1) [1/m]."""
        half = coefficients.shape[axis] // 2
        omega = np.arange(-half, half + 1) * (2 * np.pi / self.period_m[axis])
        derivative: ComplexArray = -1j * coefficients * (omega[:, None] if axis == 0 else omega)
        return derivative


@dataclass(frozen=True)
class FourierBasis:
    """Retained waves of the half plane, ordered along runs of neighbouring lattice points.

    Parameters
    ----------
    box : FourierBox
        Where the waves are periodic.
    lattice : (K, 2) ndarray of int
        Lattice points (p, q); the first is (0, 0), the constant.
    runs : (R, 2) ndarray of int
        First index of each run, and one past its last.
    """

    box: FourierBox
    lattice: IntArray
    runs: IntArray

    @classmethod
    def of(cls, box: FourierBox, lattice: IntArray) -> Self:
        """Return the basis of the lattice points of a half plane, given in the order of p, then q, from (0, 0)."""
        return cls(box, lattice, _runs(lattice))

    @property
    def n_modes(self) -> int:
        """Number of weights: a cosine and a sine per lattice point, and the constant."""
        return 2 * len(self.lattice) - 1

    @property
    def half(self) -> tuple[int, int]:
        """Largest |p| and |q|."""
        largest = np.abs(self.lattice).max(axis=0)
        return int(largest[0]), int(largest[1])

    @property
    def omega(self) -> FloatArray:
        """Angular frequencies (K, 2) [rad/m]."""
        return self.box.omega(self.lattice)

    def weights_of(self, transform: ComplexArray) -> FloatArray:
        """Return the cosine and sine sums (m,) from a centred transform of points that reaches this basis or further."""
        centre_p, centre_q = (n // 2 for n in transform.shape)
        sums = transform[self.lattice[:, 0] + centre_p, self.lattice[:, 1] + centre_q]
        return np.concatenate([sums.real, sums.imag[1:]])

    def coefficients_of(self, weights: FloatArray) -> ComplexArray:
        """Return the centred coefficients for `FourierBox.evaluate` from cosine and sine weights (m,)."""
        (half_p, half_q), n = self.half, len(self.lattice)
        coefficients = np.zeros((2 * half_p + 1, 2 * half_q + 1), dtype=complex)
        waves = weights[:n] + 1j * np.concatenate([[0.0], weights[n:]])
        coefficients[self.lattice[:, 0] + half_p, self.lattice[:, 1] + half_q] = waves
        return coefficients

    def doubled(self, per_wave: FloatArray) -> FloatArray:
        """Repeat a value per wave (K,) for its cosine and its sine (m,)."""
        return np.concatenate([per_wave, per_wave[1:]])


def _runs(lattice: IntArray) -> IntArray:
    """Return the bounds (R, 2) of the stretches in which q rises by one at constant p."""
    steps = np.diff(lattice, axis=0)
    breaks = np.flatnonzero((steps[:, 0] != 0) | (steps[:, 1] != 1)) + 1
    starts = np.concatenate([[0], breaks])
    return np.stack([starts, np.append(breaks, len(lattice))], axis=-1).astype(np.int64)
