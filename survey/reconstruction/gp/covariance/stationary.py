"""Interface of covariance functions, and stationary ones of one scaled distance."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np
import numpy.typing as npt

from survey.core.arrays import FloatArray
from survey.core.errors import ConfigError

_ALMOST_ISOTROPIC = float(np.nextafter(1.0, 2.0))


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
        >>> from survey.reconstruction.gp.covariance.kernels import SquaredExponential
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
    most_averaged: ClassVar[int] = 2
    """Most samples along a swath that a prediction replaces by their mean."""

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
        along, across = self._along_and_across(lag_m)
        squared: FloatArray = along**2 + (across * self.anisotropy) ** 2
        return squared

    def covariance_of_squared(self, squared_m2: FloatArray) -> FloatArray:
        """Return the covariance [m²] at squared lengths (...) as `squared_along` gives them [m²]."""
        return self.variance_m2 * self._correlation(squared_m2 / self.length_scale_m**2)

    def covariance_of_lag(self, lag_m: FloatArray) -> FloatArray:
        """Return the covariance [m²] at the lags (..., 2) [m]."""
        return self.covariance_of_squared(self.squared_along(lag_m))

    def covariance(self, xy_a: FloatArray, xy_b: FloatArray) -> FloatArray:
        """Return the covariance [m²] between the points (A, 2) and (B, 2), as (A, B)."""
        (along_a, across_a), (along_b, across_b) = (self._along_and_across(xy) for xy in (xy_a, xy_b))
        s2 = np.square(along_a[:, None] - along_b)
        s2 += np.square(self.anisotropy * (across_a[:, None] - across_b))
        s2 /= self.length_scale_m**2
        covariance = self._correlation(s2)
        covariance *= self.variance_m2
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
