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
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.special import k1

from survey.core.arrays import FloatArray
from survey.reconstruction.gp.covariance.rational_quadratic import RationalQuadratic
from survey.reconstruction.gp.covariance.stationary import Kernel, Stationary

__all__ = [
    "KINDS",
    "Kernel",
    "Matern32",
    "Matern52",
    "SquaredExponential",
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
        """Return the distance [m] beyond which the covariance is below `ratio` times the variance."""
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


KINDS: dict[str, type[Stationary]] = {
    kind.family: kind for kind in (SquaredExponential, Matern52, Matern32, Whittle, RationalQuadratic)
}
"""Covariance functions by the name of their family, the smoothest first; a new one is a class and its name here."""
