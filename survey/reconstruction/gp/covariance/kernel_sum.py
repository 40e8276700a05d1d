"""Sum of covariance functions."""

from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

from survey.core.arrays import FloatArray
from survey.core.errors import ConfigError
from survey.reconstruction.gp.covariance.stationary import Kernel


@dataclass(frozen=True, init=False)
class Sum(Kernel):
    """Sum of independent kernels, such as a long and a short scale; their spectra add.

    Parameters
    ----------
    *parts : Kernel
        At least one kernel.

    Examples
    --------
    >>> from survey.reconstruction.gp.covariance.kernels import SquaredExponential
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
        """Return the covariance [m²] at the lags (..., 2) [m]."""
        total: FloatArray = np.sum([part.covariance_of_lag(lag_m) for part in self.parts], axis=0)
        return total

    def covariance(self, xy_a: FloatArray, xy_b: FloatArray) -> FloatArray:
        """Return the covariance [m²] between the points (A, 2) and (B, 2), as (A, B)."""
        total = self.parts[0].covariance(xy_a, xy_b)
        for part in self.parts[1:]:
            total += part.covariance(xy_a, xy_b)
        return total

    def spectral_density(self, omega: FloatArray) -> FloatArray:
        """Return the spectral density [m⁴] at the angular frequencies (..., 2) [rad/m]."""
        total: FloatArray = np.sum([part.spectral_density(omega) for part in self.parts], axis=0)
        return total

    def log_spectral_gradient(self, omega: FloatArray) -> FloatArray:
        """Return the gradient (P, ...) of the log spectral density with respect to `log_parameters`."""
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
        """Return the distance [m] beyond which every part is below `ratio` times the variance of the sum."""
        shares = [part.variance_m2 / self.variance_m2 for part in self.parts]
        reaches = [
            part.decay_m(ratio / share)
            for share, part in zip(shares, self.parts, strict=True)
            if share > ratio
        ]
        return max(reaches)
