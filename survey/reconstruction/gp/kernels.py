r"""Stationary covariance functions of the terrain, with their spectra.

`Kernel` is the interface of all covariance functions, `Stationary` the base of those of one scaled distance and one scaled
frequency,

.. math::  k(h) = v \, \rho(s^2), \qquad S(\omega) = v \, l_a l_b \, \sigma(q^2),

with ``s² = (h_a / l_a)² + (h_b / l_b)²`` and ``q² = (l_a ω_a)² + (l_b ω_b)²``; the axis *a* points at
`angle_deg` (counter-clockwise from east), ``l_a`` is `length_scale_m` and ``l_b = length_scale_m /
anisotropy``.  The spectral density is that of two dimensions and of the angular frequency,
``k(h) = (2π)⁻² ∫ S(ω) cos(ωᵀh) d²ω``, so that its integral over the plane is ``(2π)² v`` [m⁴].

The functions are the rational quadratic, the squared exponential and four of Matérn's class; `KINDS` lists them by the
name of their family.

Formulae: Rasmussen and Williams, *Gaussian Processes for Machine Learning* (2006), section 4.2.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np
import numpy.typing as npt
from scipy.special import gammaln, k1, kve

from survey.core import ConfigError, FloatArray

_ALMOST_ISOTROPIC = float(np.nextafter(1.0, 2.0))
# Pairs of points at once: their lags and covariances stay in the cache of a core.
_IN_CACHE = 2**16


class Kernel(ABC):
    """What the engines ask of a covariance function."""

    variance_m2: float

    @property
    @abstractmethod
    def length_scales_m(self) -> tuple[float, float]:
        """Shortest and longest length scale in any direction [m]."""

    @property
    @abstractmethod
    def parameter_names(self) -> tuple[str, ...]:
        """What each entry of `log_parameters` is."""

    @property
    @abstractmethod
    def log_parameters(self) -> FloatArray:
        """Free parameters as unconstrained numbers: logarithms, and an angle in radians."""

    def parameters(self) -> dict[str, float]:
        """Return the parameters by name, in metres, square metres or radians.

        Returns
        -------
        dict of str to float
            Names with underscores, in the order of `parameter_names`.

        Examples
        --------
        >>> from survey.reconstruction.gp.kernels import SquaredExponential
        >>> SquaredExponential(4.0, 10.0).parameters()
        {'variance_m2': 4.0, 'length_scale_m': 10.0}
        """
        logarithms = zip(self.parameter_names, self.log_parameters, strict=True)
        return {
            name.removeprefix("log ").replace(" ", "_"): float(
                np.exp(value) if name.startswith("log ") else value
            )
            for name, value in logarithms
        }

    @property
    @abstractmethod
    def variance_gradient(self) -> FloatArray:
        """Derivative (P,) of `variance_m2` with respect to `log_parameters`."""

    @abstractmethod
    def with_log_parameters(self, log_parameters: npt.ArrayLike) -> Self:
        """Return the same family with other parameters.

        Parameters
        ----------
        log_parameters : (P,) array_like
            Logarithms of the parameters, in the order of `log_parameters`.

        Returns
        -------
        Kernel
            Of the same family.
        """

    @abstractmethod
    def covariance_of_lag(self, lag_m: FloatArray) -> FloatArray:
        """Return the covariance [m²] at the lags (..., 2) [m].

        Parameters
        ----------
        lag_m : (..., 2) ndarray
            Differences of easting and northing [m].

        Returns
        -------
        (...) ndarray
            Covariance [m²].
        """

    def covariance(self, xy_a: FloatArray, xy_b: FloatArray) -> FloatArray:
        """Return the covariance [m²] between the points (A, 2) and (B, 2), as (A, B).

        Parameters
        ----------
        xy_a, xy_b : (A, 2) and (B, 2) ndarray
            Easting and northing [m].

        Returns
        -------
        (A, B) ndarray
            Covariance [m²].
        """
        return self.covariance_of_lag(xy_a[:, None, :] - xy_b[None, :, :])

    @abstractmethod
    def spectral_density(self, omega: FloatArray) -> FloatArray:
        """Return the spectral density [m⁴] at the angular frequencies (..., 2) [rad/m].

        Parameters
        ----------
        omega : (..., 2) ndarray
            Angular frequencies [rad/m].

        Returns
        -------
        (...) ndarray
            Spectral density [m⁴].
        """

    @abstractmethod
    def log_spectral_gradient(self, omega: FloatArray) -> FloatArray:
        """Return the gradient (P, ...) of the log spectral density with respect to `log_parameters`.

        Parameters
        ----------
        omega : (..., 2) ndarray
            Angular frequencies [rad/m].

        Returns
        -------
        (P, ...) ndarray
            One entry for each of the P parameters.
        """

    @abstractmethod
    def decay_m(self, ratio: float) -> float:
        """Return the distance [m] beyond which the covariance is below `ratio` times the variance.

        Parameters
        ----------
        ratio : float
            Covariance over variance, between 0 and 1.

        Returns
        -------
        float
            Distance [m].
        """


@dataclass(frozen=True)
class Stationary(Kernel):
    """One covariance function of one scaled distance.

    A subclass that is listed in `kernels.KINDS` can be named by its `family` in every setting.
    """

    family: ClassVar[str]
    """Name of the family, e.g. ``matern-3/2``."""
    error_growth: ClassVar[float | None] = None
    """Exponent with which the squared error between two swaths grows with their distance, 2 ν + 1 for a smoothness ν;
    None for families that the planner's predictions and the kernel search leave out."""

    variance_m2: float
    length_scale_m: float
    anisotropy: float = 1.0
    angle_deg: float = 0.0

    def __post_init__(self) -> None:
        for name in ("variance_m2", "length_scale_m", "anisotropy"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise ConfigError(
                    f"{type(self).__name__}.{name} is {value}; a finite number above 0 was expected."
                )
        if not np.isfinite(self.angle_deg):
            raise ConfigError(f"{type(self).__name__}.angle_deg is {self.angle_deg}; give degrees.")

    @abstractmethod
    def _correlation(self, s2: FloatArray) -> FloatArray:
        """Return the correlation at the squared scaled distance."""

    @abstractmethod
    def _log_spectrum(self, q2: FloatArray) -> FloatArray:
        """Return the logarithm of σ at the squared scaled frequency."""

    @abstractmethod
    def _log_spectrum_slope(self, q2: FloatArray) -> FloatArray:
        """Return the derivative of `_log_spectrum` with respect to q²."""

    @property
    def length_scales_m(self) -> tuple[float, float]:
        """Shortest and longest length scale in any direction [m]."""
        across = self.length_scale_m / self.anisotropy
        return min(self.length_scale_m, across), max(self.length_scale_m, across)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """What each entry of `log_parameters` is."""
        isotropic = ("log variance_m2", "log length_scale_m")
        return isotropic if self.anisotropy == 1.0 else (*isotropic, "log anisotropy", "angle_rad")

    @property
    def log_parameters(self) -> FloatArray:
        """Free parameters: logarithms, and an angle in radians."""
        isotropic = [np.log(self.variance_m2), np.log(self.length_scale_m)]
        if self.anisotropy == 1.0:
            return np.array(isotropic)
        return np.array([*isotropic, np.log(self.anisotropy), np.radians(self.angle_deg)])

    def with_log_parameters(self, log_parameters: npt.ArrayLike) -> Self:
        """Return the same family with other parameters."""
        theta = np.asarray(log_parameters, dtype=np.float64)
        changed = replace(self, variance_m2=float(np.exp(theta[0])), length_scale_m=float(np.exp(theta[1])))
        if self.anisotropy == 1.0:
            return changed
        stretch = float(np.exp(theta[2]))
        # At exactly 1 the kernel would be isotropic, and lose two of its parameters in the middle of a fit.
        stretch = _ALMOST_ISOTROPIC if stretch == 1.0 else stretch
        return replace(changed, anisotropy=stretch, angle_deg=float(np.degrees(theta[3])))

    @property
    def variance_gradient(self) -> FloatArray:
        """Derivative (P,) of `variance_m2` with respect to `log_parameters`."""
        gradient = np.zeros(len(self.parameter_names))
        gradient[0] = self.variance_m2
        return gradient

    def _along_and_across(self, vectors: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rotate (..., 2) vectors to the axes of the anisotropy."""
        if self.angle_deg == 0.0:
            return vectors[..., 0], vectors[..., 1]
        cosine, sine = np.cos(np.radians(self.angle_deg)), np.sin(np.radians(self.angle_deg))
        x, y = vectors[..., 0], vectors[..., 1]
        return cosine * x + sine * y, cosine * y - sine * x

    def _scaled_frequencies(self, omega: FloatArray) -> tuple[FloatArray, FloatArray]:
        along, across = self._along_and_across(omega)
        return along * self.length_scale_m, across * self.length_scale_m / self.anisotropy

    def squared_along(self, lag_m: FloatArray) -> FloatArray:
        """Return the squared lengths (...) of lags (..., 2), those across stretched by the anisotropy [m²]."""
        squared: FloatArray = np.sum(self.stretched(lag_m) ** 2, axis=-1)
        return squared

    def stretched(self, vectors: FloatArray) -> FloatArray:
        """Return vectors (..., 2) along and across the axis of the anisotropy, those across stretched by it [m]."""
        along, across = self._along_and_across(vectors)
        return np.stack([along, across * self.anisotropy], axis=-1)

    def covariance_of_squared(self, squared_m2: FloatArray) -> FloatArray:
        """Return the covariance [m²] at squared lengths (...) as `squared_along` gives them [m²]."""
        return self.variance_m2 * self._correlation(squared_m2 / self.length_scale_m**2)

    def covariance_of_lag(self, lag_m: FloatArray) -> FloatArray:
        """Return the covariance [m²] at the lags (..., 2) [m]."""
        return self.covariance_of_squared(self.squared_along(lag_m))

    def covariance(self, xy_a: FloatArray, xy_b: FloatArray) -> FloatArray:
        """Return the covariance [m²] between the points (A, 2) and (B, 2), as (A, B)."""
        (along_a, across_a), (along_b, across_b) = (self._along_and_across(xy) for xy in (xy_a, xy_b))
        covariance = np.empty((len(along_a), len(along_b)))
        rows = max(_IN_CACHE // max(len(along_b), 1), 1)
        for start in range(0, len(along_a), rows):
            block = slice(start, start + rows)
            s2 = np.square(along_a[block, None] - along_b)
            s2 += np.square(self.anisotropy * (across_a[block, None] - across_b))
            s2 /= self.length_scale_m**2
            np.multiply(self._correlation(s2), self.variance_m2, out=covariance[block])
        return covariance

    def spectral_density(self, omega: FloatArray) -> FloatArray:
        """Return the spectral density [m⁴] at the angular frequencies (..., 2) [rad/m]."""
        q_a, q_b = self._scaled_frequencies(omega)
        area = self.length_scale_m**2 / self.anisotropy
        density: FloatArray = self.variance_m2 * area * np.exp(self._log_spectrum(q_a**2 + q_b**2))
        return density

    def log_spectral_gradient(self, omega: FloatArray) -> FloatArray:
        """Return the gradient (P, ...) of the log spectral density with respect to `log_parameters`."""
        q_a, q_b = self._scaled_frequencies(omega)
        q2 = q_a**2 + q_b**2
        slope = self._log_spectrum_slope(q2)
        rows = [np.ones_like(q2), 2 + 2 * slope * q2]
        if self.anisotropy != 1.0:
            # d(ω_a)/dφ = ω_b and d(ω_b)/dφ = -ω_a for the rotated frequencies
            turn = 2 * q_a * q_b * (self.anisotropy - 1 / self.anisotropy)
            rows += [-1 - 2 * slope * q_b**2, slope * turn]
        return np.stack(rows)

    def decay_m(self, ratio: float) -> float:
        """Return the distance [m] beyond which the covariance is below `ratio` times the variance."""
        s = np.geomspace(1e-2, 1e3, 2001)
        beyond = s[self._correlation(s**2) < ratio]
        return self.length_scales_m[1] * float(beyond[0] if beyond.size else s[-1])


@dataclass(frozen=True)
class RationalQuadratic(Stationary):
    r"""Rational quadratic covariance: squared exponentials of a gamma-distributed range of scales.

    .. math::  k(h) = v \left(1 + \frac{s^2}{2 a}\right)^{-a}, \qquad
               S(\omega) = \frac{4 \pi v \, l_a l_b}{\Gamma(a)} a^a (b / a)^{(a - 1) / 2}
               K_{a - 1}(2 \sqrt{a b}), \quad b = q^2 / 2

    Parameters are those of `SquaredExponential`, and

    shape : float, optional
        The exponent a, above 1.  Below that the spectrum has no finite value at frequency 0.

    Its covariance decays as a power of the distance.  The Fourier engine makes it periodic on a box of
    limited size, which changes the longest scales when `shape` is below about 3; compare with a `Sum` of
    squared exponentials, or use the dense engine.

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


@dataclass(frozen=True)
class SquaredExponential(Stationary):
    r"""Squared exponential covariance, the kernel of the glacier paper (Eq. 1).

    .. math::  k(h) = v \exp(-s^2 / 2), \qquad S(\omega) = 2 \pi v \, l_a l_b \exp(-q^2 / 2)

    `variance_m2`: prior variance v [m²]. `length_scale_m`: length scale along `angle_deg` [m]. `anisotropy`:
    length scale along divided by length scale across; 1 is isotropic, and stays so in a fit. `angle_deg`:
    direction of `length_scale_m`, counter-clockwise from east [degrees].

    Fields drawn from it are infinitely smooth.  Real ice is rougher below its shortest length scale: add a
    second scale (`Sum`) or take a Matérn kernel, or the standard deviation far from points is too small.

    >>> kernel = SquaredExponential(variance_m2=10.0, length_scale_m=17.75)
    >>> kernel.covariance_of_lag(np.array([[0.0, 0.0], [17.75, 0.0]]))
    array([10.     ,  6.06530])
    """

    family: ClassVar = "squared-exponential"
    error_growth: ClassVar = 8.0

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
class Matern(Stationary):
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
class Matern32(Matern):
    r"""Matérn covariance with ν = 3/2: fields with one derivative, like rough ice.

    .. math::  k(h) = v (1 + \sqrt3 s) \exp(-\sqrt3 s), \qquad
               S(\omega) = 6 \pi v \, l_a l_b \, 3^{3/2} (3 + q^2)^{-5/2}

    Parameters are those of `SquaredExponential`.

    >>> Matern32(4.0, 25.0).covariance_of_lag(np.array([0.0, 0.0]))
    np.float64(4.0)
    """

    family: ClassVar = "matern-3/2"
    error_growth: ClassVar = 4.0

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
class Matern52(Matern):
    r"""Matérn covariance with ν = 5/2: fields with two derivatives.

    .. math::  k(h) = v (1 + \sqrt5 s + 5 s^2 / 3) \exp(-\sqrt5 s), \qquad
               S(\omega) = 10 \pi v \, l_a l_b \, 5^{5/2} (5 + q^2)^{-7/2}

    Parameters are those of `SquaredExponential`.

    >>> Matern52(4.0, 25.0).covariance_of_lag(np.array([0.0, 0.0]))
    np.float64(4.0)
    """

    family: ClassVar = "matern-5/2"
    error_growth: ClassVar = 6.0

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
class Whittle(Matern):
    r"""Matérn covariance with ν = 1, the elementary one of the plane (Whittle 1954): between smooth and jagged.

    .. math::  k(h) = v \, \sqrt2 s \, K_1(\sqrt2 s), \qquad S(\omega) = 8 \pi v \, l_a l_b \, (2 + q^2)^{-2}

    Parameters are those of `SquaredExponential`.

    Fields drawn from it have no derivative, but only just: heights differ by about their distance. Self-similar
    terrain of Hurst exponent near 1 looks like this over the distances of a survey.

    >>> Whittle(4.0, 25.0).covariance_of_lag(np.array([[0.0, 0.0], [25.0, 0.0]]))
    array([4.     , 1.77737])
    """

    family: ClassVar = "whittle"
    error_growth: ClassVar = 3.0

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
class Exponential(Matern):
    r"""Matérn covariance with ν = 1/2: fields without a derivative, like blocks and broken ice.

    .. math::  k(h) = v \exp(-s), \qquad S(\omega) = 2 \pi v \, l_a l_b (1 + q^2)^{-3/2}

    Parameters are those of `SquaredExponential`.

    Its spectrum decays slowly: waves that the Fourier engine leaves out count as noise. Neither planner nor kernel search
    take it.

    >>> Exponential(4.0, 25.0).covariance_of_lag(np.array([[0.0, 0.0], [25.0, 0.0]]))
    array([4.     , 1.47152])
    """

    family: ClassVar = "exponential"

    @property
    def smoothness(self) -> float:
        """The smoothness ν."""
        return 0.5

    def _correlation(self, s2: FloatArray) -> FloatArray:
        correlation: FloatArray = np.exp(-np.sqrt(s2))
        return correlation


KINDS: dict[str, type[Stationary]] = {
    kind.family: kind
    for kind in (SquaredExponential, Matern52, Matern32, Whittle, Exponential, RationalQuadratic)
}
"""Covariance functions by the name of their family, the smoothest first; a new one is a class and its name here."""
