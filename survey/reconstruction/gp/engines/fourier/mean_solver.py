"""Posterior mean over many more waves than the covariance can hold, by conjugate gradients.

The mean costs one linear system, not an inverse: the Gram matrix is Toeplitz, so that a product with it is a fast
Fourier transform of a few hundred squared, and the covariance of the fewer waves (`WeightPosterior`) is a
preconditioner that leaves next to nothing to do.  The error of the mean is then that of the kernel's whole
spectrum, while the inverse is only as large as the standard deviation needs.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy import fft

from survey.core.arrays import FloatArray, IntArray
from survey.core.errors import CapacityError
from survey.reconstruction.gp.engines.fourier.weight_posterior import WeightPosterior
from survey.reconstruction.gp.engines.fourier_basis import ComplexArray, FourierBasis
from survey.reconstruction.gp.engines.noisy_values import NoisyValues

MAX_ITERATIONS = 200
TOLERABLE = 0.05
"""Error of a mean that has not settled, in posterior standard deviations, above which it is refused."""


@dataclass(frozen=True)
class MeanSystem:
    """The normal equations ``(I + D B D) z = D b`` of the weights in transform order (p >= 0; q wrapped).

    Parameters
    ----------
    half : (int, int)
        Largest |p| and |q| of the waves.
    amplitudes : (nP, nQ) ndarray
        Prior standard deviation of each complex weight; 0 where there is no wave.
    noise_field : (n, n) ndarray
        The inverse transform of the Gram's Toeplitz vector: the information density on a grid.
    """

    half: tuple[int, int]
    amplitudes: FloatArray
    noise_field: FloatArray

    @classmethod
    def of(cls, basis: FourierBasis, line_variance: FloatArray, gram: ComplexArray) -> Self:
        """Return the system of the waves of `basis`, whose lattice points have the prior variances `line_variance`."""
        half_p, half_q = basis.half
        n_p, n_q = (fft.next_fast_len(4 * n + 1, real=True) for n in (half_p, half_q))
        amplitudes = np.zeros((n_p // 2 + 1, n_q))
        _place(amplitudes, basis.lattice, np.sqrt(line_variance))
        wrapped = np.zeros((n_p // 2 + 1, n_q), dtype=complex)
        wrapped[: 2 * half_p + 1, np.arange(-2 * half_q, 2 * half_q + 1) % n_q] = np.conj(gram[2 * half_p :])
        field = fft.irfft2(wrapped, s=(n_q, n_p), axes=(1, 0), norm="forward")
        return cls((half_p, half_q), amplitudes, field)

    def product(self, z: ComplexArray) -> ComplexArray:
        """Return the product of the system's matrix with a vector."""
        n_p, n_q = self.noise_field.shape
        waves = fft.irfft2(self.amplitudes * z, s=(n_q, n_p), axes=(1, 0), norm="forward")
        waves *= self.noise_field
        product: ComplexArray = z + self.amplitudes * fft.rfft2(waves, axes=(1, 0), norm="forward")
        return product

    def right_hand_side(self, moment: ComplexArray) -> ComplexArray:
        """Return the data side ``D b``, from the centred transform of noise-weighted data."""
        side = np.zeros(self.amplitudes.shape, dtype=complex)
        half_p, half_q = self.half
        columns = np.arange(-half_q, half_q + 1) % self.amplitudes.shape[1]
        side[: half_p + 1, columns] = np.conj(moment[half_p:])
        side *= self.amplitudes
        return side

    def coefficients(self, z: ComplexArray) -> ComplexArray:
        """Return the centred coefficients for `FourierBox.evaluate` of the field with these weights."""
        half_p, half_q = self.half
        columns = np.arange(-half_q, half_q + 1) % z.shape[1]
        half_plane = np.conj(self.amplitudes * z)[: half_p + 1, columns]
        centred = np.zeros((2 * half_p + 1, 2 * half_q + 1), dtype=complex)
        centred[half_p:] = half_plane
        centred[half_p + 1 :] *= 2
        return centred

    def solve_all(
        self,
        sums: "PointSums",
        posterior: WeightPosterior,
        accuracy: float,
        starts: tuple[ComplexArray, ...] | None = None,
    ) -> tuple[ComplexArray, ...]:
        """Return the weights for every data column, starting from given ones or from the fewer waves' own answer."""
        preconditioner = FourierPreconditioner(posterior)
        sides = [self.right_hand_side(moment) for moment in sums.moments]
        if starts is None:
            starts = tuple(preconditioner.alone(side) for side in sides)
        pairs = zip(sides, starts, strict=True)
        return tuple(self.solve(side, preconditioner, accuracy, start) for side, start in pairs)

    def solve(
        self,
        side: ComplexArray,
        preconditioner: "FourierPreconditioner",
        accuracy: float,
        start: ComplexArray,
    ) -> ComplexArray:
        """Solve by conjugate gradients until the error of the weights is below `accuracy`.

        The measure is the energy norm, which bounds the error of the mean anywhere by `accuracy` times the
        posterior standard deviation there.

        Raises
        ------
        CapacityError
            When it has not settled to a twentieth of a standard deviation.
        """
        z = start
        residual = side - self.product(z)
        direction = np.zeros_like(z)
        previous = energy = 1.0
        for iteration in range(MAX_ITERATIONS):
            step = preconditioner(residual)
            energy = inner(residual, step)
            if energy <= accuracy**2:
                return z + step
            direction = step + (energy / previous if iteration else 0.0) * direction
            image = self.product(direction)
            stride = energy / inner(direction, image)
            z = z + stride * direction
            residual = residual - stride * image
            previous = energy
        if energy > TOLERABLE**2:
            raise CapacityError(
                f"the map's mean did not settle within {MAX_ITERATIONS} iterations (it may be off by {energy**0.5:.2g} "
                "standard deviations): the length scale is too long or the noise too small for so many waves; map a "
                "smaller area, or state larger errors."
            )
        return z


@dataclass(frozen=True)
class FourierPreconditioner:
    """Covariance of the fewer waves on their weights, the identity on the others."""

    posterior: WeightPosterior

    def __call__(self, residual: ComplexArray) -> ComplexArray:
        """Apply to a residual in transform order."""
        return self._put(residual.copy(), residual)

    def alone(self, side: ComplexArray) -> ComplexArray:
        """Return the weights of the fewer waves alone; 0 for the others."""
        return self._put(np.zeros_like(side), side)

    def _put(self, target: ComplexArray, residual: ComplexArray) -> ComplexArray:
        lattice = self.posterior.basis.lattice
        solved = self.posterior.times(real_weights(residual, lattice))
        return put_real_weights(target, lattice, solved)


@dataclass(frozen=True)
class PointSums:
    """Sums over points in the normal equations of the waves; the sums of two surveys add.

    Parameters
    ----------
    gram : (4 P + 1, 4 Q + 1) ndarray of complex
        Transform of 1 / noise variance, out to twice the largest frequencies.
    moments : tuple of (2 P + 1, 2 Q + 1) ndarray of complex
        Transforms of each data column over the noise variance.
    cross : (K, K) ndarray
        Products of the columns, weighted by 1 / noise variance.
    """

    gram: ComplexArray
    moments: tuple[ComplexArray, ...]
    cross: FloatArray

    @classmethod
    def of(cls, basis: FourierBasis, data: NoisyValues, tail_m2: float) -> Self:
        """Sum over points whose noise is theirs and that of the discarded waves."""
        weights = 1 / (data.noise_m2 + tail_m2)
        columns, (half_p, half_q) = data.columns, basis.half
        gram = basis.box.transform(data.xy, weights, (2 * half_p, 2 * half_q))
        moments = tuple(basis.box.transform(data.xy, weights * column, basis.half) for column in columns.T)
        return cls(gram, moments, columns.T @ (columns * weights[:, None]))

    def __add__(self, other: "PointSums") -> "PointSums":
        moments = tuple(a + b for a, b in zip(self.moments, other.moments, strict=True))
        return PointSums(self.gram + other.gram, moments, self.cross + other.cross)


def real_weights(z: ComplexArray, lattice: IntArray) -> FloatArray:
    """Return the cosine and sine weights (m,) of complex ones in transform order."""
    picked = z[lattice[:, 0], lattice[:, 1]]
    cosines = np.sqrt(2) * picked.real
    cosines[0] = picked[0].real
    return np.concatenate([cosines, -np.sqrt(2) * picked[1:].imag])


def put_real_weights(z: ComplexArray, lattice: IntArray, weights: FloatArray) -> ComplexArray:
    """Write cosine and sine weights into complex ones in transform order, in place."""
    n = len(lattice)
    picked = np.sqrt(0.5) * weights[:n] * (1 + 0j)
    picked[0] = weights[0]
    picked[1:] -= 1j * np.sqrt(0.5) * weights[n:]
    _place(z, lattice, picked)
    return z


def _place(target: FloatArray | ComplexArray, lattice: IntArray, values: FloatArray | ComplexArray) -> None:
    """Write values at lattice points, and their mirror images in the row p = 0."""
    target[lattice[:, 0], lattice[:, 1]] = values
    zero = lattice[:, 0] == 0
    target[0, -lattice[zero, 1]] = np.conj(values[zero])


def inner(a: ComplexArray, b: ComplexArray) -> float:
    """Return the inner product over the whole plane of two vectors given on half of it."""
    products = a.real * b.real + a.imag * b.imag
    return float(2 * products.sum() - products[0].sum())
