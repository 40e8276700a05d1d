"""Requirement on a map: the largest error, its probability, the errors of the samples, and the class of surface."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from planners.prediction.surfaces import SURFACE_NAMES, Surface
from survey import ConfigError
from survey.reconstruction.gp.families import SearchedFamily
from survey.reconstruction.gp.kernel_search import ALL
from survey.scoring.standards.map_classes import map_classes

_LEAST_PROBABILITY, _MOST_PROBABILITY = 0.5, 0.999
# No error of a survey is larger; squares of more do not fit a number.
_LARGEST_M = 1e6


def require_probability(probability: float) -> None:
    """Refuse a probability that is too low for a guarantee, or too high for a model of terrain.

    >>> require_probability(0.95)
    """
    if not _LEAST_PROBABILITY < probability <= _MOST_PROBABILITY:
        raise ConfigError(
            f"the probability is {probability}; give a number above {_LEAST_PROBABILITY:g} and at most "
            f"{_MOST_PROBABILITY:g}, e.g. 0.9."
        )


@dataclass(frozen=True)
class ErrorLimit:
    """Largest error of a map, with the probability and the errors of samples that a plan assumes.

    `limit_m`: largest root mean square error of the map [m]. `probability`: probability with which the limit
    has to be met, above 0.5 and at most 0.999. `noise_m`, `localization_m`: standard deviation of a sample's
    height, and of the rover's place east and north [m]. `sample_step_m`: distance between samples [m].
    `shared_m`: standard deviation of an error of height that all samples share, as of the path [m].
    `max_swaths`: most swaths to consider; by default as many as are two samples apart, 30 or more.
    """

    limit_m: float
    probability: float = 0.9
    noise_m: float = 0.1
    localization_m: float = 0.0
    sample_step_m: float = 10.0
    shared_m: float = 0.05
    max_swaths: int | None = None

    def __post_init__(self) -> None:
        require_probability(self.probability)

    def in_grid_metres(self, factor: float) -> Self:
        """Return the settings with their horizontal lengths multiplied by a factor."""
        step_m, localization_m = factor * self.sample_step_m, factor * self.localization_m
        return replace(self, sample_step_m=step_m, localization_m=localization_m)


@dataclass(frozen=True)
class MapRequirement(ErrorLimit):
    """Requirement on a map, with the errors of the samples it is made from.

    `limit_m`: largest root mean square error of the map [m]. `probability`: probability with which the limit
    has to be met, above 0.5 and at most 0.999. `noise_m`, `localization_m`: standard deviation of a sample's
    height, and of the rover's place east and north [m]. `sample_step_m`: distance between samples [m].
    `shared_m`: standard deviation of an error of height that all samples share, as of the path [m].
    `max_swaths`: most swaths to consider; by default as many as are two samples apart, 30 or more.
    `prior_sigma_m`: standard deviation of a cell of the prior [m]. `surface`: class of the ground, which says
    how rough it is below the resolution of the prior. `micro_relief_m`: standard deviation of relief finer
    than the samples [m]; that of the class by default. `n_simulations`: number of simulated surveys. `seed`:
    seed of the simulated terrain. `assumed`: covariance family of the terrain; by default those of the class
    of surface.
    """

    prior_sigma_m: float = 1.0
    surface: Surface = "unknown"
    micro_relief_m: float | None = None
    n_simulations: int = 60
    seed: int = 0
    assumed: SearchedFamily | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("limit_m", "sample_step_m"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0.0):
                raise ConfigError(f"{name} is {getattr(self, name)}; it must be greater than 0.")
        for name in ("noise_m", "localization_m", "shared_m", "prior_sigma_m", "micro_relief_m"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value >= 0.0):
                raise ConfigError(f"{name} is {getattr(self, name)}; it must be 0 or greater.")
            if value is not None and value > _LARGEST_M:
                raise ConfigError(f"{name} is {value:g} m; {_LARGEST_M:g} m is the most.")
        if self.surface not in SURFACE_NAMES:
            raise ConfigError(f"{self.surface} is no class of surface; take {', '.join(SURFACE_NAMES)}.")
        if self.max_swaths is not None and self.max_swaths < 2:
            raise ConfigError(f"at most {self.max_swaths} swaths are allowed; allow 2 or more.")
        if self.assumed is not None and self.assumed not in ALL:
            raise ConfigError(f"{self.assumed} is no family of covariances; take {', '.join(ALL)}.")
        if self.n_simulations < 10:
            raise ConfigError(
                f"{self.n_simulations} simulations are too few for a probability; take 10 or more."
            )


def reachable_class(rmse_m: float) -> str | None:
    """Return the strictest map class of the paper's tables that an error meets.

    `rmse_m`: root mean square error of a map [m]. Returns: class, contour interval and limit in words; None
    where it meets none.

    >>> reachable_class(0.25)
    'Class 2 at a 1.829 m interval (0.3048 m)'
    """
    met = [row for row in map_classes() if rmse_m <= row.limit_m]
    return (
        f"{met[-1].map_class} at a {met[-1].interval_m:.4g} m interval ({met[-1].limit_m:.4f} m)"
        if met
        else None
    )
