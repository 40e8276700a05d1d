"""Covariance of the Fourier weights after the data, and the variance of everything that is linear in them.

With whitened weights the prior is the identity, the data add ``D B D`` to it (B the Gram matrix of the waves at
the points, weighted by 1 / noise variance; D the prior standard deviations of the waves), and

    C = (I + D B D)⁻¹.

Two facts make this cheap.  Products of waves are waves of the sums and differences of their frequencies, so that
B is looked up in *one* transform of the points, however many they are; and so that the variance ``φᵀ D C D φ`` of
the whole map is one trigonometric polynomial, whose coefficients are sums over the entries of C.
"""

import mmap
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numba
import numpy as np
from scipy.linalg import blas, lapack, solve_triangular

from survey.core.arrays import FloatArray, IntArray
from survey.core.errors import InputError
from survey.reconstruction.gp.engines.fourier_basis import ComplexArray, FourierBasis

# Nothing calls these loops from C, and Python does not call the inner one.
_LOOP: dict[str, Any] = {"cache": True, "fastmath": True, "no_cfunc_wrapper": True}
_INNER_LOOP = _LOOP | {"no_cpython_wrapper": True}


@dataclass(frozen=True)
class WeightPosterior:
    """Covariance of the whitened weights, as one matrix less a few outer products.

    Parameters
    ----------
    basis : FourierBasis
        The K waves, with m = 2 K - 1 weights: K cosines, then the K - 1 sines.
    amplitudes : (K,) ndarray
        Prior standard deviation d of the waves [m].
    covariance : (m, m) ndarray
        C, of which only the lower triangle is meant.
    log_determinant : float
        Logarithm of the determinant of the inverse of C.
    downdates : (m, R) ndarray
        Columns G of later points: the covariance is ``C - G Gᵀ``.
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
