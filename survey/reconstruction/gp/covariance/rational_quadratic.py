"""Rational quadratic covariance function."""

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np
import numpy.typing as npt
from scipy.special import gammaln, kve

from survey.core.arrays import FloatArray
from survey.core.errors import ConfigError
from survey.reconstruction.gp.covariance.stationary import Stationary


@dataclass(frozen=True)
class RationalQuadratic(Stationary):
    r"""Rational quadratic covariance: squared exponentials of a gamma-distributed range of scales.

    .. math::  k(h) = v \left(1 + \frac{s^2}{2 a}\right)^{-a}, \qquad
               S(\omega) = \frac{4 \pi v \, l_a l_b}{\Gamma(a)} a^a (b / a)^{(a - 1) / 2}
               K_{a - 1}(2 \sqrt{a b}), \quad b = q^2 / 2

    Parameters are those of `SquaredExponential`, and

    shape : float, optional
        The exponent a, above 1.  Below that the spectrum has no finite value at frequency 0.

    Notes
    -----
    Its covariance decays as a power of the distance.  The Fourier engine makes it periodic on a box of
    limited size, which changes the longest scales when `shape` is below about 3; compare with a `Sum` of
    squared exponentials, or use the dense engine.

    Examples
    --------
    >>> RationalQuadratic(1.0, 10.0, shape=2.0).covariance_of_lag(np.array([20.0, 0.0]))
    np.float64(0.25)
    """

    family: ClassVar = "rational-quadratic"

    shape: float = 2.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (np.isfinite(self.shape) and self.shape > 1):
            raise ConfigError(
                f"RationalQuadratic.shape is {self.shape}; a finite number above 1 was expected."
            )

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """What each entry of `log_parameters` is."""
        return (*super().parameter_names, "log(shape - 1)")

    @property
    def log_parameters(self) -> FloatArray:
        """Free parameters: logarithms, and an angle in radians."""
        return np.append(super().log_parameters, np.log(self.shape - 1))

    def with_log_parameters(self, log_parameters: npt.ArrayLike) -> Self:
        """Return the same family with other parameters."""
        theta = np.asarray(log_parameters, dtype=np.float64)
        return replace(super().with_log_parameters(theta[:-1]), shape=1 + float(np.exp(theta[-1])))

    def _correlation(self, s2: FloatArray) -> FloatArray:
        correlation: FloatArray = (1 + s2 / (2 * self.shape)) ** -self.shape
        return correlation

    def _log_spectrum(self, q2: FloatArray) -> FloatArray:
        return _log_rational_quadratic_spectrum(q2, self.shape)

    def _log_spectrum_slope(self, q2: FloatArray) -> FloatArray:
        # d/dz [z^n K_n(z)] = -z^n K_{n-1}(z) with z² = 2 a q²
        a = self.shape
        z = np.sqrt(2 * a * np.maximum(q2, _Q2_FLOOR))
        slope: FloatArray = -a / z * kve(a - 2, z) / kve(a - 1, z)
        return slope

    def log_spectral_gradient(self, omega: FloatArray) -> FloatArray:
        """Return the gradient (P, ...) of the log spectral density with respect to `log_parameters`."""
        q_a, q_b = self._scaled_frequencies(omega)
        q2 = q_a**2 + q_b**2
        # The Bessel function has no elementary derivative in its order: a central difference, good to 1e-8.
        step = 1e-4
        above, below = (1 + (self.shape - 1) * np.exp(sign * step) for sign in (1, -1))
        of_shape = _log_rational_quadratic_spectrum(q2, above) - _log_rational_quadratic_spectrum(q2, below)
        return np.concatenate([super().log_spectral_gradient(omega), of_shape[None] / (2 * step)])


# The spectrum at frequency 0 is the limit of a product 0 · ∞; this close to it the limit is reached.
_Q2_FLOOR = 1e-12


def _log_rational_quadratic_spectrum(q2: FloatArray, shape: float) -> FloatArray:
    """Return the logarithm of σ of the rational quadratic, by the scaled Bessel function."""
    b = 0.5 * np.maximum(q2, _Q2_FLOOR)
    z = 2 * np.sqrt(shape * b)
    log_bessel = np.log(kve(shape - 1, z)) - z
    result: FloatArray = (
        np.log(4 * np.pi)
        - gammaln(shape)
        + shape * np.log(shape)
        + 0.5 * (shape - 1) * np.log(b / shape)
        + log_bessel
    )
    return result
