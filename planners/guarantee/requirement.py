"""Requirement on a map: the largest error, its probability, the errors of the samples, and the class of surface."""

from dataclasses import dataclass

import numpy as np

from planners.prediction.assumptions import MapAssumptions, SampleErrors
from survey import ConfigError

_LEAST_PROBABILITY, _MOST_PROBABILITY = 0.5, 0.999


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
class ErrorLimit(SampleErrors):
    """Largest error of a map, with the probability and the errors of samples that a plan assumes.

    `limit_m`: largest root mean square error of the map [m]. `probability`: probability with which the limit
    has to be met, above 0.5 and at most 0.999. `max_swaths`: most swaths to consider; by default as many as are two
    samples apart, 30 or more. The errors are those of `SampleErrors`.
    """

    limit_m: float
    probability: float = 0.9
    max_swaths: int | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        require_probability(self.probability)


@dataclass(frozen=True)
class MapRequirement(ErrorLimit, MapAssumptions):
    """Requirement on a map, with the errors of samples and prior, and the ground.

    `limit_m`: largest root mean square error of the map [m]. `probability`: probability with which the limit
    has to be met, above 0.5 and at most 0.999. `max_swaths`: most swaths to consider; by default as many as are two
    samples apart, 30 or more. `n_simulations`: number of simulated surveys. `seed`: seed of the simulated terrain. The
    rest are those of `MapAssumptions`.
    """

    n_simulations: int = 60
    seed: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (np.isfinite(self.limit_m) and self.limit_m > 0.0):
            raise ConfigError(f"limit_m is {self.limit_m}; it must be greater than 0.")
        if self.max_swaths is not None and self.max_swaths < 2:
            raise ConfigError(f"at most {self.max_swaths} swaths are allowed; allow 2 or more.")
        if self.n_simulations < 10:
            raise ConfigError(
                f"{self.n_simulations} simulations are too few for a probability; take 10 or more."
            )
