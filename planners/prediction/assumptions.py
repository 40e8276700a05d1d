"""What a prediction assumes: the errors of samples and prior, and the class of surface.

The class of surface states how rough the ground is below what a coarse prior resolves. A prior shows nothing finer than
two or three of its cells. Finer relief is extrapolated through covariances whose smoothness is that of measured ground
of the same class, and what samples cannot separate is added as micro-relief.

- Bare ice: drone profiles near station S5, Greenland, after a high-pass at 35 m have standard deviations of
  0.28 to 0.62 m and a free smoothness of 1.54 (van Tiggelen et al. 2021, The Cryosphere 15, 2601; see
  `survey.terrain.micro_relief`). Roughness of glacier ice depends on scale in the same way (Rees and Arnold 2006,
  Journal of Glaciology 52, 214).
- Moraine, bedrock: natural surfaces have profiles with spectra near k⁻² (Sayles and Thomas 1978, Nature 271, 431),
  and roughness exponents of 0.3 to 1 (Shepard et al. 2001, Journal of Geophysical Research 106, 32777), thus the two
  roughest families.
- Snow: wind smooths it; the smooth families, and a few centimetres of sastrugi.
- Unknown: eleven landscapes in airborne lidar, from farmland and tundra to gullies, a crater and alpine slopes. The error of
  the maps of 55 windows, surveyed along 4, 8 and 16 lines with two kinds of prior, is predicted by the geometric mean of
  Matérn 3/2 and Whittle with equal weights: the median of predicted over actual error is 1.0 at each of the three densities,
  the lower and the upper tenth 0.5 and 1.9 (``python -m benchmarks.prediction`` measures them). The means of the landscapes
  have a standard deviation of the logarithm of 0.31, so that the scale of Student's distribution for another one is 0.33.

Spreads of the other classes are smaller, as they state more.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, Self, get_args

import numpy as np

from survey import ConfigError
from survey.reconstruction.gp.families import SearchedFamily
from survey.reconstruction.gp.kernel_search import ALL

Surface = Literal["bare-ice", "snow", "moraine", "bedrock", "unknown"]


class SurfaceClass(NamedTuple):
    """How rough a class of ground is below the resolution of a prior.

    `weights`: weight of each family of covariance before the prior is looked at. `micro_relief_m`: standard
    deviation of relief so fine that every sample sees another piece of it [m]. `spread`: scale of the
    logarithm of actual over predicted roughness on ground of this class (Student's distribution).
    """

    weights: Mapping[SearchedFamily, float]
    micro_relief_m: float
    spread: float


SURFACES: dict[Surface, SurfaceClass] = {
    "bare-ice": SurfaceClass({"matern-3/2": 0.7, "whittle": 0.3}, 0.3, 0.16),
    "snow": SurfaceClass({"squared-exponential": 0.4, "matern-5/2": 0.4, "matern-3/2": 0.2}, 0.03, 0.12),
    "moraine": SurfaceClass({"matern-3/2": 0.4, "whittle": 0.6}, 0.15, 0.2),
    "bedrock": SurfaceClass({"matern-3/2": 0.3, "whittle": 0.7}, 0.15, 0.2),
    "unknown": SurfaceClass({"matern-3/2": 0.5, "whittle": 0.5}, 0.08, 0.33),
}
"""Measured or published roughness of each class of surface."""

SURFACE_NAMES: tuple[Surface, ...] = get_args(Surface)

# Roughness over 10 m on ground of slope 1, its powers of the lag and of the slope, and the spread about that.
_TYPICAL_M, _TYPICAL_LAG_M, _TYPICAL_GROWTH, _SLOPE_POWER, _TYPICAL_SPREAD = 4.2, 10.0, 0.8, 0.6, 0.5
# Slopes of the windows that the powers were measured on.
_LEAST_SLOPE, _MOST_SLOPE = 0.02, 1.0


class LogRoughness(NamedTuple):
    """Mean and variance of the logarithm of a roughness [log m]."""

    mean: float
    variance: float


def roughness_elsewhere(lag_m: float, slope: float) -> LogRoughness:
    """Return how rough ground of a slope is on other landscapes.

    The standard deviation of a difference of heights over 10 m, about the plane of a window of 150 to 300 m, grows with
    the slope of that plane: on 61 windows of the four development landscapes of the benchmark as the power 0.6, to 4.2 m
    at a slope of 1. It grows as the power 0.8 of the lag. The logarithm varies by 0.4 about that, and by 0.5 on a
    landscape that is left out; without the slope by 0.7 and 0.9.

    `lag_m`: distance between the two places [m].

    >>> round(float(np.exp(roughness_elsewhere(20.0, slope=0.2).mean)), 2)
    2.78
    """
    within = min(max(slope, _LEAST_SLOPE), _MOST_SLOPE)
    mean = (
        np.log(_TYPICAL_M) + _TYPICAL_GROWTH * np.log(lag_m / _TYPICAL_LAG_M) + _SLOPE_POWER * np.log(within)
    )
    return LogRoughness(float(mean), _TYPICAL_SPREAD**2)


# No error of a survey is larger; squares of more do not fit a number.
_LARGEST_M = 1e6


@dataclass(frozen=True, kw_only=True)
class SampleErrors:
    """Errors of the samples of a survey.

    `noise_m`, `localization_m`: standard deviation of a sample's height, and of the rover's place east and north [m].
    `sample_step_m`: distance between samples [m]. `shared_m`: standard deviation of an error of height that all samples
    share, as of the path [m].
    """

    noise_m: float = 0.1
    localization_m: float = 0.0
    sample_step_m: float = 10.0
    shared_m: float = 0.05

    def __post_init__(self) -> None:
        require_deviations(self, "noise_m", "localization_m", "shared_m")
        if not (np.isfinite(self.sample_step_m) and self.sample_step_m > 0.0):
            raise ConfigError(f"sample_step_m is {self.sample_step_m}; it must be greater than 0.")

    def in_grid_metres(self, factor: float) -> Self:
        """Return the settings with their horizontal lengths multiplied by a factor.

        Parameters
        ----------
        factor : float
            Grid metres for each metre on the ground.

        Returns
        -------
        Self
            Settings of the same kind.
        """
        step_m, localization_m = factor * self.sample_step_m, factor * self.localization_m
        return replace(self, sample_step_m=step_m, localization_m=localization_m)


@dataclass(frozen=True, kw_only=True)
class MapAssumptions(SampleErrors):
    """Errors of samples and prior, and the ground, that the predicted error of a map rests on.

    Parameters
    ----------
    noise_m, localization_m : float
        Standard deviation of a sample's height, and of the rover's place east and north [m].
    sample_step_m : float
        Distance between samples [m].
    shared_m : float
        Standard deviation of an error of height that all samples share, as of the path [m].
    prior_sigma_m : float
        Standard deviation of a cell of the prior [m].
    surface : str
        Class of the ground, which says how rough it is below the resolution of the prior.
    micro_relief_m : float, optional
        Standard deviation of relief finer than the samples [m]; that of the class by default.
    assumed : str, optional
        Covariance family of the terrain; by default those of the class of surface.

    Raises
    ------
    ConfigError
        A negative deviation, a spacing of 0, an unknown class or family.

    Examples
    --------
    >>> MapAssumptions(surface="snow", noise_m=0.05).micro_relief_m is None
    True
    """

    prior_sigma_m: float = 1.0
    surface: Surface = "unknown"
    micro_relief_m: float | None = None
    assumed: SearchedFamily | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        require_deviations(self, "prior_sigma_m", "micro_relief_m")
        if self.surface not in SURFACE_NAMES:
            raise ConfigError(f"{self.surface} is no class of surface; take {', '.join(SURFACE_NAMES)}.")
        if self.assumed is not None and self.assumed not in ALL:
            raise ConfigError(f"{self.assumed} is no family of covariances; take {', '.join(ALL)}.")


def require_deviations(settings: object, *names: str) -> None:
    """Refuse standard deviations that are negative, or larger than any error of a survey."""
    for name in names:
        value = getattr(settings, name)
        if value is not None and not (np.isfinite(value) and value >= 0.0):
            raise ConfigError(f"{name} is {value}; it must be 0 or greater.")
        if value is not None and value > _LARGEST_M:
            raise ConfigError(f"{name} is {value:g} m; {_LARGEST_M:g} m is the most.")
