"""Posterior of the Fourier weights: their covariance, the variance of all that is linear in them, and their mean.

With whitened weights the prior is the identity, the data add ``D B D`` to it (B the Gram matrix of the waves at
the points, weighted by 1 / noise variance; D the prior standard deviations of the waves), and

    C = (I + D B D)⁻¹.

Two facts make this cheap.  Products of waves are waves of the sums and differences of their frequencies, so that
B is looked up in *one* transform of the points, however many they are; and so that the variance ``φᵀ D C D φ`` of
the complete map is one trigonometric polynomial, whose coefficients are sums over the entries of C.

The mean takes many more waves than the covariance can hold, by conjugate gradients (`MeanSystem`). The Gram matrix is
Toeplitz, so that a product with it is a fast Fourier transform of a few hundred squared, and the covariance of the fewer
waves is the preconditioner.
"""

import mmap
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, Self

import numba
import numpy as np
from scipy import fft
from scipy.linalg import blas, lapack, solve_triangular

from survey.core import FloatArray, InputError, IntArray
from survey.reconstruction.gp.engines.fourier_basis import (
    MAX_ITERATIONS,
    TOLERABLE,
    ComplexArray,
    FourierBasis,
)
from survey.reconstruction.gp.engines.regression import NoisyValues

# Nothing calls these loops from C, and Python does not call the inner one.
_LOOP: dict[str, Any] = {"cache": True, "no_cfunc_wrapper": True}
_INNER_LOOP = _LOOP | {"no_cpython_wrapper": True}


@dataclass(frozen=True)
class WeightPosterior:
    """Covariance of the whitened weights, as one matrix less a few outer products.

    `basis`: the K waves, with m = 2 K - 1 weights: K cosines, then the K - 1 sines. `amplitudes` (K,): prior
    standard deviation d of the waves [m]. `covariance` (m, m): C, of which only the lower triangle is meant.
    `log_determinant`: logarithm of the determinant of the inverse of C. `downdates` (m, R): columns G of
    later points: the covariance is ``C - G Gᵀ``.
    """

    basis: FourierBasis
    amplitudes: FloatArray
    covariance: FloatArray
    log_determinant: float
    downdates: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))

    @classmethod
    def given(cls, basis: FourierBasis, amplitudes: FloatArray, gram: ComplexArray) -> Self:
        """Factorize and invert ``I + D B D``, both in place of the one matrix."""
        return cls.inverted(basis, amplitudes, precision(basis, amplitudes, gram))

    @classmethod
    def inverted(cls, basis: FourierBasis, amplitudes: FloatArray, matrix: FloatArray) -> Self:
        """Factorize and invert a precision (m, m), of which the lower triangle is meant, in its own place."""
        factor, failed = lapack.dpotrf(matrix, lower=1, overwrite_a=1, clean=0)
        if failed:
            raise InputError(
                f"The {basis.n_modes} weights could not be solved for (pivot {failed} is not positive): "
                "standard deviations below a millionth of the terrain's were probably given; raise them."
            )
        log_determinant = 2 * float(np.log(factor.diagonal()).sum())
        covariance, _ = lapack.dpotri(factor, lower=1, overwrite_c=1)
        return cls(basis, amplitudes, covariance, log_determinant, np.zeros((basis.n_modes, 0)))

    @property
    def diagonal(self) -> FloatArray:
        """Posterior variances (m,) of the whitened weights, between 0 and 1."""
        variances: FloatArray = self.covariance.diagonal() - np.sum(self.downdates**2, axis=1)
        return variances

    def times(self, vector: FloatArray) -> FloatArray:
        """Return the product of the covariance with one vector (m,)."""
        product: FloatArray = blas.dsymv(1.0, self.covariance, vector, lower=1)
        if self.downdates.size:
            product -= self.downdates @ (self.downdates.T @ vector)
        return product

    def times_each(self, vectors: FloatArray) -> FloatArray:
        """Return the products (m, M) of the covariance with the rows (M, m)."""
        products: FloatArray = blas.dsymm(1.0, self.covariance, np.asfortranarray(vectors.T), lower=1)
        if self.downdates.size:
            products -= self.downdates @ (self.downdates.T @ vectors.T)
        return products

    def features(self, xy: FloatArray) -> FloatArray:
        """Return the whitened features ``D φ`` (N, m) at points, for few points."""
        x, y = self.basis.box.phases(xy)
        p, q = self.basis.lattice.T
        half_p, half_q = self.basis.half
        turn_x = np.exp(1j * np.outer(x, np.arange(half_p + 1)))
        turn_y = np.exp(1j * np.outer(y, np.arange(-half_q, half_q + 1)))
        waves = turn_x[:, p] * turn_y[:, q + half_q] * self.amplitudes
        return np.concatenate([waves.real, waves.imag[:, 1:]], axis=1)

    def updated(self, xy: FloatArray, noise_variance: FloatArray) -> Self:
        """Return the posterior after more points (Woodbury); for many fewer points than weights."""
        features = np.asfortranarray(self.features(xy).T)
        seen = blas.dsymm(1.0, self.covariance, features, lower=1)
        if self.downdates.size:
            seen -= self.downdates @ (self.downdates.T @ features)
        innovation = features.T @ seen
        innovation[np.diag_indices_from(innovation)] += noise_variance
        factor = np.linalg.cholesky(innovation)
        columns = solve_triangular(factor, seen.T, lower=True).T
        # log det(N + F C Fᵀ) - log det N is what the new points add to the determinant
        added = 2 * float(np.log(np.diag(factor)).sum()) - float(np.log(noise_variance).sum())
        return replace(
            self,
            downdates=np.concatenate([self.downdates, columns], axis=1),
            log_determinant=self.log_determinant + added,
        )

    def variance_coefficients(self, direction: FloatArray | None = None) -> ComplexArray:
        """Return the coefficients of the map of the variance, for `FourierBox.evaluate_on_axes`.

        With a `direction` (2,), those of the variance of the derivative along it.
        """
        weights = self.amplitudes
        if direction is not None:
            weights = weights * (self.basis.omega @ direction)
        cosines, sines = np.zeros(self._doubled_shape), np.zeros(self._doubled_shape)
        sign = 1.0 if direction is None else -1.0
        scatter_covariance(
            self.covariance.T, cosines, sines, self.basis.lattice, self.basis.runs, weights, sign
        )
        coefficients: ComplexArray = cosines + 1j * sines
        if self.downdates.size:
            coefficients -= self._downdate_coefficients(weights, derivative=direction is not None)
        return coefficients

    @property
    def _doubled_shape(self) -> tuple[int, int]:
        half_p, half_q = self.basis.half
        return 4 * half_p + 1, 4 * half_q + 1

    def _downdate_coefficients(self, weights: FloatArray, *, derivative: bool) -> ComplexArray:
        """Coefficients of ``Σ_r (g_r · φ)²``: square each column's map on a grid fine enough for its square."""
        half_p = self.basis.half[0]
        n_p, n_q = self._doubled_shape
        p, q = self.basis.lattice.T
        n_waves = len(self.basis.lattice)
        total = np.zeros((n_p, n_q))
        for column in self.downdates.T:
            spectrum = np.zeros((2 * half_p + 1, n_q), dtype=complex)
            waves = weights * column[:n_waves] * (1 + 0j)
            waves[1:] -= 1j * weights[1:] * column[n_waves:]
            if derivative:
                waves = waves * 1j
            spectrum[p, q % n_q] = 0.5 * waves
            zero = p == 0
            spectrum[0, (-q[zero]) % n_q] += 0.5 * np.conj(waves[zero])
            total += np.fft.irfft2(spectrum, s=(n_q, n_p), axes=(1, 0), norm="forward").real ** 2
        doubled: ComplexArray = np.fft.fftshift(np.conj(np.fft.fft2(total, norm="forward")))
        return doubled


def precision(basis: FourierBasis, amplitudes: FloatArray, gram: ComplexArray) -> FloatArray:
    """Return ``I + D B D`` (m, m), its lower triangle, from the transform of the noise weights."""
    matrix = _half_used_matrix(basis.n_modes)
    cosines, sines = np.ascontiguousarray(gram.real), np.ascontiguousarray(gram.imag)
    fill_precision(matrix.T, cosines, sines, basis.lattice, basis.runs, amplitudes)
    return matrix


def _half_used_matrix(size: int) -> FloatArray:
    """Return the square matrix in column order of which only the lower triangle will be touched.

    It is mapped in ordinary pages, so that the other half takes no memory; NumPy would ask for huge ones.
    """
    return np.ndarray((size, size), order="F", buffer=mmap.mmap(-1, 8 * size**2))


@numba.njit(**_LOOP)
def fill_precision(  # noqa: PLR0917 - compiled functions take no keywords
    rows: FloatArray, gram_c: FloatArray, gram_s: FloatArray, lattice: IntArray, runs: IntArray, d: FloatArray
) -> None:
    """Write the upper triangle of ``I + D B D`` by rows, looked up in the transform of the noise weights."""
    n = lattice.shape[0]
    c_p, c_q = gram_c.shape[0] // 2, gram_c.shape[1] // 2
    for b in range(n):
        p_b, q_b, half = lattice[b, 0], lattice[b, 1], 0.5 * d[b]
        cosine_row, sine_row = rows[b], rows[n + b - 1]
        for r in range(runs.shape[0]):
            start, stop = runs[r, 0], runs[r, 1]
            p, q, size = lattice[start, 0], lattice[start, 1], stop - start
            q_minus, q_plus = q - q_b + c_q, q + q_b + c_q
            weights = d[start:stop]
            skip = 1 if start == 0 else 0  # the constant has no sine
            minus = gram_s[p - p_b + c_p, q_minus : q_minus + size]
            plus = gram_s[p + p_b + c_p, q_plus : q_plus + size]
            out = cosine_row[n + start + skip - 1 : n + stop - 1]
            for k in range(skip, size):
                out[k - skip] = half * weights[k] * (minus[k] + plus[k])
            if stop <= b:
                continue
            minus = gram_c[p - p_b + c_p, q_minus : q_minus + size]
            plus = gram_c[p + p_b + c_p, q_plus : q_plus + size]
            out = cosine_row[start:stop]
            for k in range(size):
                out[k] = half * weights[k] * (minus[k] + plus[k])
            if b > 0:
                out = sine_row[n + start + skip - 1 : n + stop - 1]
                for k in range(skip, size):
                    out[k - skip] = half * weights[k] * (minus[k] - plus[k])
        cosine_row[b] += 1.0
        if b > 0:
            sine_row[n + b - 1] += 1.0


@numba.njit(**_LOOP)
def scatter_covariance(  # noqa: PLR0917
    rows: FloatArray,
    cosines: FloatArray,
    sines: FloatArray,
    lattice: IntArray,
    runs: IntArray,
    d: FloatArray,
    sign: float,
) -> None:
    """Add each entry of ``D C D`` to the sum and the difference of its two frequencies.

    `sign` is +1 for the field and -1 for a derivative of it, whose waves are a quarter turn on.
    """
    n = lattice.shape[0]
    c_p, c_q = cosines.shape[0] // 2, cosines.shape[1] // 2
    for b in range(n):
        p_b, q_b, d_b = lattice[b, 0], lattice[b, 1], d[b]
        for r in range(runs.shape[0]):
            first, stop = runs[r, 0], runs[r, 1]
            p, q, size = lattice[first, 0], lattice[first, 1], stop - first
            q_minus, q_plus = q - q_b + c_q, q + q_b + c_q
            weights = d[first:stop]
            skip = 1 if first == 0 else 0
            _add(sines[p - p_b + c_p, q_minus : q_minus + size], rows[b], weights, n + first - 1, skip, d_b)
            _add(
                sines[p + p_b + c_p, q_plus : q_plus + size],
                rows[b],
                weights,
                n + first - 1,
                skip,
                sign * d_b,
            )
            if stop <= b + 1:
                continue
            above = max(b + 1 - first, 0)
            minus = cosines[p - p_b + c_p, q_minus : q_minus + size]
            plus = cosines[p + p_b + c_p, q_plus : q_plus + size]
            _add(minus, rows[b], weights, first, above, d_b)
            _add(plus, rows[b], weights, first, above, sign * d_b)
            if b > 0:
                _add(minus, rows[n + b - 1], weights, n + first - 1, above, d_b)
                _add(plus, rows[n + b - 1], weights, n + first - 1, above, -sign * d_b)
        cosine = 0.5 * rows[b, b] * d_b * d_b
        sine = 0.5 * rows[n + b - 1, n + b - 1] * d_b * d_b if b > 0 else 0.0
        cosines[c_p, c_q] += cosine + sine
        cosines[2 * p_b + c_p, 2 * q_b + c_q] += sign * (cosine - sine)


@numba.njit(**_INNER_LOOP)
def _add(  # noqa: PLR0917
    out: FloatArray, row: FloatArray, weights: FloatArray, first: int, skip: int, factor: float
) -> None:
    """Add ``factor * row * weights`` to one run."""
    entries = row[first + skip : first + weights.size]
    kept = weights[skip:]
    target = out[skip:]
    for k in range(entries.size):
        target[k] += factor * kept[k] * entries[k]


@dataclass(frozen=True)
class MeanSystem:
    """The normal equations ``(I + D B D) z = D b`` of the weights in transform order (p >= 0; q wrapped).

    `half` (int, int): largest |p| and |q| of the waves. `amplitudes` (nP, nQ): prior standard deviation of
    each complex weight; 0 where there is no wave. `noise_field` (n, n): the inverse transform of the Gram's
    Toeplitz vector: the information density on a grid.
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
    ) -> "MeanWeights":
        """Return the weights for every data column, starting from given ones or from the fewer waves' own answer."""
        preconditioner = FourierPreconditioner(posterior)
        sides = [self.right_hand_side(moment) for moment in sums.moments]
        if starts is None:
            starts = tuple(preconditioner.alone(side) for side in sides)
        columns, error = list(starts), 0.0
        for k, (side, start) in enumerate(zip(sides, starts, strict=True)):
            columns[k], of_column = self.solve(side, preconditioner, accuracy, start)
            error = max(error, of_column)
            if error > TOLERABLE:
                break  # such a process is refused or replaced, whatever the other columns are
        return MeanWeights(tuple(columns), error)

    def solve(
        self,
        side: ComplexArray,
        preconditioner: "FourierPreconditioner",
        accuracy: float,
        start: ComplexArray,
    ) -> tuple[ComplexArray, float]:
        """Solve by conjugate gradients until the error of the weights is below `accuracy`; return weights and error.

        The measure is the energy norm, which bounds the error of the mean anywhere by `accuracy` times the
        posterior standard deviation there. It is infinite where the preconditioner is not positive definite to working
        precision, which stops the iteration; an energy at the level of rounding may have either sign. The iteration also
        stops where it would not end in time at `_FASTER` times the rate of the last iterations.
        """
        z, looked_at = start, np.inf
        residual = side - self.product(z)
        direction = np.zeros_like(z)
        previous = energy = 1.0
        for iteration in range(MAX_ITERATIONS):
            step = preconditioner(residual)
            energy = inner(residual, step)
            if abs(energy) <= accuracy**2:
                return z + step, float(np.sqrt(abs(energy)))
            if energy < 0.0:
                return z, np.inf
            if iteration % _LOOKED_EVERY == 0:
                if _would_be_left(energy, looked_at, MAX_ITERATIONS - iteration) > TOLERABLE:
                    break
                looked_at = energy
            direction = step + (energy / previous if iteration else 0.0) * direction
            image = self.product(direction)
            stride = energy / inner(direction, image)
            z = z + stride * direction
            residual = residual - stride * image
            previous = energy
        return z, float(np.sqrt(energy))


# Convergence is looked at after so many iterations; its rate rarely grows, and falls in those that do not end in time.
_LOOKED_EVERY, _FASTER = 25, 1.5


def _would_be_left(energy: float, before: float, n_more: int) -> float:
    """Return the error after more iterations, from its square now and `_LOOKED_EVERY` iterations before; 0 where that is not known."""
    if not np.isfinite(before):
        return 0.0
    rate = 0.5 * _FASTER * np.log(before / energy) / _LOOKED_EVERY
    return float(np.sqrt(energy) * np.exp(-rate * n_more))


class MeanWeights(NamedTuple):
    """Weights of the mean for every data column, and the largest of their errors [posterior standard deviations]."""

    columns: tuple[ComplexArray, ...]
    error: float


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

    `gram` (4 P + 1, 4 Q + 1) complex: transform of 1 / noise variance, out to twice the largest frequencies.
    `moments`: transforms of each data column over the noise variance. `cross` (K, K): products of the
    columns, weighted by 1 / noise variance.
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
