r"""Stationary covariance functions of the terrain, with their spectra.

Every kernel is written by one scaled distance and one scaled frequency,

.. math::  k(h) = v \, \rho(s^2), \qquad S(\omega) = v \, l_a l_b \, \sigma(q^2),

with ``s² = (h_a / l_a)² + (h_b / l_b)²`` and ``q² = (l_a ω_a)² + (l_b ω_b)²``; the axis *a* points at
`angle_deg` (counter-clockwise from east), ``l_a`` is `length_scale_m` and ``l_b = length_scale_m /
anisotropy``.  The spectral density is that of two dimensions and of the angular frequency,
``k(h) = (2π)⁻² ∫ S(ω) cos(ωᵀh) d²ω``, so that its integral over the plane is ``(2π)² v`` [m⁴].

Formulae: Rasmussen and Williams, *Gaussian Processes for Machine Learning* (2006), section 4.2.
"""

from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np
import numpy.typing as npt
from scipy.special import gammaln, k1, kve

from survey.core.arrays import FloatArray
from survey.core.errors import ConfigError
from survey.reconstruction.gp.covariance.stationary import Kernel, Stationary

__all__ = [
    "KINDS",
    "Kernel",
    "Matern32",
    "Matern52",
    "RationalQuadratic",
    "SquaredExponential",
    "Sum",
    "Whittle",
]


@dataclass(frozen=True)
class SquaredExponential(Stationary):
    r"""Squared exponential covariance, the kernel of the glacier paper (Eq. 1).

    .. math::  k(h) = v \exp(-s^2 / 2), \qquad S(\omega) = 2 \pi v \, l_a l_b \exp(-q^2 / 2)

    Parameters
    ----------
    variance_m2 : float
        Prior variance v [m²].
    length_scale_m : float
        Length scale along `angle_deg` [m].
    anisotropy : float, optional
        Length scale along divided by length scale across; 1 is isotropic, and stays so in a fit.
    angle_deg : float, optional
        Direction of `length_scale_m`, counter-clockwise from east [degrees].

    Raises
    ------
    ConfigError
        If a parameter is not a finite positive number.

    Notes
    -----
    Fields drawn from it are infinitely smooth.  Real ice is rougher below its shortest length scale: add a
    second scale (`Sum`) or take a Matérn kernel, or the standard deviation far from points is too small.

    Examples
    --------
    >>> kernel = SquaredExponential(variance_m2=10.0, length_scale_m=17.75)
    >>> kernel.covariance_of_lag(np.array([[0.0, 0.0], [17.75, 0.0]]))
    array([10.     ,  6.06530])
    """

    family: ClassVar = "squared-exponential"
    error_growth: ClassVar = 8.0
    most_averaged: ClassVar = 6

    def _correlation(self, s2: FloatArray) -> FloatArray:
        correlation: FloatArray = np.exp(-0.5 * s2)
        return correlation

    def _log_spectrum(self, q2: FloatArray) -> FloatArray:
        log_sigma: FloatArray = np.log(2 * np.pi) - 0.5 * q2
        return log_sigma

    def _log_spectrum_slope(self, q2: FloatArray) -> FloatArray:
        return np.full_like(q2, -0.5)

    def decay_m(self, ratio: float) -> float:
        """Distance [m] beyond which the covariance is below `ratio` times the variance."""
        return self.length_scales_m[1] * float(np.sqrt(-2 * np.log(ratio)))


@dataclass(frozen=True)
class _Matern(Stationary):
    """Matérn covariance of a half-integer smoothness ν."""

    @property
    @abstractmethod
    def smoothness(self) -> float:
        """The smoothness ν."""

    def _log_spectrum(self, q2: FloatArray) -> FloatArray:
        nu = self.smoothness
        log_sigma: FloatArray = np.log(4 * np.pi * nu) + nu * np.log(2 * nu) - (nu + 1) * np.log(2 * nu + q2)
        return log_sigma

    def _log_spectrum_slope(self, q2: FloatArray) -> FloatArray:
        return -(self.smoothness + 1) / (2 * self.smoothness + q2)


@dataclass(frozen=True)
class Matern32(_Matern):
    r"""Matérn covariance with ν = 3/2: fields with one derivative, like rough ice.

    .. math::  k(h) = v (1 + \sqrt3 s) \exp(-\sqrt3 s), \qquad
               S(\omega) = 6 \pi v \, l_a l_b \, 3^{3/2} (3 + q^2)^{-5/2}

    Parameters are those of `SquaredExponential`.

    Examples
    --------
    >>> Matern32(4.0, 25.0).covariance_of_lag(np.array([0.0, 0.0]))
    np.float64(4.0)
    """

    family: ClassVar = "matern-3/2"
    error_growth: ClassVar = 4.0
    most_averaged: ClassVar = 2

    @property
    def smoothness(self) -> float:
        """The smoothness ν."""
        return 1.5

    def _correlation(self, s2: FloatArray) -> FloatArray:
        s = np.sqrt(3 * s2)
        correlation: FloatArray = np.exp(-s)
        correlation *= 1 + s
        return correlation


@dataclass(frozen=True)
class Matern52(_Matern):
    r"""Matérn covariance with ν = 5/2: fields with two derivatives.

    .. math::  k(h) = v (1 + \sqrt5 s + 5 s^2 / 3) \exp(-\sqrt5 s), \qquad
               S(\omega) = 10 \pi v \, l_a l_b \, 5^{5/2} (5 + q^2)^{-7/2}

    Parameters are those of `SquaredExponential`.

    Examples
    --------
    >>> Matern52(4.0, 25.0).covariance_of_lag(np.array([0.0, 0.0]))
    np.float64(4.0)
    """

    family: ClassVar = "matern-5/2"
    error_growth: ClassVar = 6.0
    most_averaged: ClassVar = 4

    @property
    def smoothness(self) -> float:
        """The smoothness ν."""
        return 2.5

    def _correlation(self, s2: FloatArray) -> FloatArray:
        s = np.sqrt(5 * s2)
        correlation: FloatArray = np.exp(-s)
        correlation *= 1 + s + s * s / 3
        return correlation


@dataclass(frozen=True)
class Whittle(_Matern):
    r"""Matérn covariance with ν = 1, the elementary one of the plane (Whittle 1954): between smooth and jagged.

    .. math::  k(h) = v \, \sqrt2 s \, K_1(\sqrt2 s), \qquad S(\omega) = 8 \pi v \, l_a l_b \, (2 + q^2)^{-2}

    Parameters are those of `SquaredExponential`.

    Notes
    -----
    Fields drawn from it have no derivative, but only just: heights differ by about their distance. Self-similar
    terrain of Hurst exponent near 1 looks like this over the distances of a survey.

    Examples
    --------
    >>> Whittle(4.0, 25.0).covariance_of_lag(np.array([[0.0, 0.0], [25.0, 0.0]]))
    array([4.     , 1.77737])
    """

    family: ClassVar = "whittle"
    error_growth: ClassVar = 3.0
    most_averaged: ClassVar = 2

    @property
    def smoothness(self) -> float:
        """The smoothness ν."""
        return 1.0

    def _correlation(self, s2: FloatArray) -> FloatArray:
        # s K₁(s) tends to 1; below 1e-8 it is 1 in double precision.
        s = np.maximum(np.sqrt(2 * s2), 1e-8)
        correlation: FloatArray = s * k1(s)
        return correlation


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
        """Gradient (P, ...) of the log spectral density with respect to `log_parameters`."""
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
    """Logarithm of σ of the rational quadratic, by the scaled Bessel function."""
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


@dataclass(frozen=True, init=False)
class Sum(Kernel):
    """Sum of independent kernels, such as a long and a short scale; their spectra add.

    Parameters
    ----------
    *parts : Kernel
        At least one kernel.

    Examples
    --------
    >>> kernel = Sum(SquaredExponential(11.6, 39.9), SquaredExponential(0.18, 13.0))
    >>> kernel.variance_m2
    11.78
    >>> kernel.length_scales_m
    (13.0, 39.9)
    """

    parts: tuple[Kernel, ...]
    variance_m2: float

    def __init__(self, *parts: Kernel) -> None:
        if not parts:
            raise ConfigError("A Sum of no kernels was given; at least one kernel was expected.")
        object.__setattr__(self, "parts", tuple(parts))
        object.__setattr__(self, "variance_m2", float(sum(part.variance_m2 for part in parts)))

    @property
    def length_scales_m(self) -> tuple[float, float]:
        """Shortest and longest length scale in any direction [m]."""
        scales = [scale for part in self.parts for scale in part.length_scales_m]
        return min(scales), max(scales)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """What each entry of `log_parameters` is."""
        return tuple(
            f"{name} {k}" for k, part in enumerate(self.parts, start=1) for name in part.parameter_names
        )

    @property
    def log_parameters(self) -> FloatArray:
        """Free parameters: logarithms, and an angle in radians."""
        return np.concatenate([part.log_parameters for part in self.parts])

    @property
    def variance_gradient(self) -> FloatArray:
        """Derivative (P,) of `variance_m2` with respect to `log_parameters`."""
        return np.concatenate([part.variance_gradient for part in self.parts])

    def with_log_parameters(self, log_parameters: npt.ArrayLike) -> Self:
        """Return the same family with other parameters."""
        theta = np.asarray(log_parameters, dtype=np.float64)
        sizes = [len(part.parameter_names) for part in self.parts]
        pieces = np.split(theta, np.cumsum(sizes)[:-1])
        changed = (part.with_log_parameters(piece) for part, piece in zip(self.parts, pieces, strict=True))
        return type(self)(*changed)

    def covariance_of_lag(self, lag_m: FloatArray) -> FloatArray:
        """Covariance [m²] at the lags (..., 2) [m]."""
        total: FloatArray = np.sum([part.covariance_of_lag(lag_m) for part in self.parts], axis=0)
        return total

    def covariance(self, xy_a: FloatArray, xy_b: FloatArray) -> FloatArray:
        """Covariance [m²] between the points (A, 2) and (B, 2), as (A, B)."""
        total = self.parts[0].covariance(xy_a, xy_b)
        for part in self.parts[1:]:
            total += part.covariance(xy_a, xy_b)
        return total

    def spectral_density(self, omega: FloatArray) -> FloatArray:
        """Spectral density [m⁴] at the angular frequencies (..., 2) [rad/m]."""
        total: FloatArray = np.sum([part.spectral_density(omega) for part in self.parts], axis=0)
        return total

    def log_spectral_gradient(self, omega: FloatArray) -> FloatArray:
        """Gradient (P, ...) of the log spectral density with respect to `log_parameters`."""
        densities = [part.spectral_density(omega) for part in self.parts]
        total = np.sum(densities, axis=0)
        # Where the whole spectrum has underflowed no part matters, and 0 / 0 must not appear.
        shares = [np.divide(d, total, out=np.zeros_like(d), where=total > 0) for d in densities]
        return np.concatenate(
            [
                share * part.log_spectral_gradient(omega)
                for share, part in zip(shares, self.parts, strict=True)
            ]
        )

    def decay_m(self, ratio: float) -> float:
        """Distance [m] beyond which every part is below `ratio` times the variance of the sum."""
        shares = [part.variance_m2 / self.variance_m2 for part in self.parts]
        reaches = [
            part.decay_m(ratio / share)
            for share, part in zip(shares, self.parts, strict=True)
            if share > ratio
        ]
        return max(reaches)


KINDS: dict[str, type[Stationary]] = {
    kind.family: kind for kind in (SquaredExponential, Matern52, Matern32, Whittle, RationalQuadratic)
}
"""Covariance functions by the name of their family, the smoothest first; a new one is a class and its name here."""
