r"""Design of a season: the swaths, stakes and days with which two surveys give a wanted error of the mass balance.

`design_season` compares numbers of swaths and stakes by the standard deviation of the mean change of height, which
has these parts, each of both surveys:

- interpolation: what the maps between the swaths leave open of the area's mean height,

  .. math::  \bar v = \overline{k} - \bar k^T K^{-1} \bar k + (1 - 1^T K^{-1} \bar k)^2 / (1^T K^{-1} 1)

  with the means of the covariance k over the area (block kriging; Journel and Huijbregts 1978). Relief is taken to be
  another one at the second date, as on ice that has flowed and melted;
- shared: the error that all samples of a survey share, or what two stakes leave of it;
- duration: melt while a survey lasts T days, :math:`0.3 \, \dot h \, T / \sqrt{12}`, its rate known to 30 %;
- flow: the mean vertical motion of the ice.

Each of K stakes measures melt and flow by itself, which divides their errors by :math:`\sqrt{1 + K}`; five to ten stakes
are found to be enough on small glaciers (Fountain and Vecchia 1999, Geografiska Annaler A 81, 563). The error of the
density is added for a mass balance. Basal and internal melt are not included.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import date, timedelta
from typing import Literal, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from planners.config import settings_factor
from planners.guarantee.guarantee import STAKED_M, posterior_of
from planners.guarantee.requirement import MapRequirement
from planners.guarantee.survey_lines import heading_and_width, swath_counts
from planners.patterns.wavy import WavyConfig
from planners.planning import planned_on
from planners.prediction.assumptions import Surface
from planners.prediction.error_distribution import MapPredictor
from planners.prediction.kernel_posterior import KernelPosterior, WeightedKernel
from planners.prediction.places import places
from planners.routes.traversability import drivable
from survey import ConfigError, Dem, Route, SurveyArea
from survey.core import FloatArray

Unit = Literal["m w.e.", "%"]

_MEAN_TEMPERATURE_C = 5.0


class SeasonSurface(NamedTuple):
    """Melt [m w.e. per °C and day], and density of what melts with its standard deviation [kg m⁻³]."""

    degree_day_m: float
    density_kg_m3: float
    density_std_kg_m3: float

    @property
    def melt_m_we_day(self) -> float:
        """Melt of a day at the mean temperature of the season [m w.e.]."""
        return self.degree_day_m * _MEAN_TEMPERATURE_C


SEASON_SURFACES: dict[Surface, SeasonSurface] = {
    "bare-ice": SeasonSurface(0.008, 900.0, 20.0),
    "snow": SeasonSurface(0.0045, 850.0, 60.0),
}
"""Surfaces of glaciers."""


@dataclass(frozen=True)
class SeasonConfig:
    """Settings of a season's design.

    `wanted`: half the width of the 95 % interval of the mass balance [m w.e.] or of the change of volume [%].
    `unit`: unit of `wanted`. `first_day`, `last_day`: days that the two surveys are about. `surface`: class
    of the ground. `melt_m_we_day`: mean melt of a day [m w.e.]; that of the surface by default.
    `emergence_m_year`: standard deviation of the mean vertical motion of the ice over the area [m per year];
    0 for a complete glacier. `noise_m`, `shared_m`: standard deviation of a sample's height, and of an error
    that all samples of a survey share [m]. `sample_step_m`: distance between samples [m]. `km_a_day`:
    distance that is driven in a day [km]. `max_swaths`: most swaths to consider.
    """

    wanted: float
    unit: Unit
    first_day: date
    last_day: date
    surface: Surface = "bare-ice"
    melt_m_we_day: float | None = None
    emergence_m_year: float = 0.0
    noise_m: float = 0.1
    shared_m: float = 0.05
    sample_step_m: float = 10.0
    km_a_day: float = 10.0
    max_swaths: int | None = None

    def __post_init__(self) -> None:
        if self.surface not in SEASON_SURFACES:
            raise ConfigError(
                f"the surface of a season is {self.surface}; take {' or '.join(SEASON_SURFACES)}, the surfaces of glaciers."
            )
        if self.last_day <= self.first_day:
            raise ConfigError(
                f"the season ends on {self.last_day}, not after {self.first_day}; give a later day."
            )
        for name in ("wanted", "km_a_day"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0.0):
                raise ConfigError(f"{name} is {getattr(self, name)}; it must be greater than 0.")
        for name in ("melt_m_we_day", "emergence_m_year"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value >= 0.0):
                raise ConfigError(f"{name} is {value}; it must be 0 or greater.")
        if self.unit == "%" and self.melt_m_we_day == 0.0:
            raise ConfigError("a change of 0 m has no error in percent; state the wanted error in m w.e.")

    @property
    def n_days(self) -> int:
        """Days between the surveys."""
        return (self.last_day - self.first_day).days

    @property
    def density_kg_m3(self) -> float:
        """Density of what melts [kg m⁻³]."""
        return SEASON_SURFACES[self.surface].density_kg_m3

    @property
    def melt_m_day(self) -> float:
        """Lowering of the surface in a day [m]."""
        stated = self.melt_m_we_day
        melt = SEASON_SURFACES[self.surface].melt_m_we_day if stated is None else stated
        return 1000.0 * melt / self.density_kg_m3

    @property
    def change_m(self) -> float:
        """Expected lowering of the surface between the surveys [m]."""
        return self.n_days * self.melt_m_day


CONFIDENCE = 1.96
"""Standard deviations in half of a 95 % interval."""

_MOST_SAMPLES = 1000
_RATE_SHARE = 0.3
_DAYS_OF_YEAR = 365.25


class ErrorBudget(NamedTuple):
    """Standard deviations of the mean change of height by cause, and of its mass by density [m, m w.e.]."""

    interpolation_m: float
    shared_m: float
    duration_m: float
    flow_m: float
    density_m_we: float

    @property
    def height_m(self) -> float:
        """Standard deviation of the mean change of height [m]."""
        return float(np.sqrt(sum(part**2 for part in self[:4])))

    def error(self, config: SeasonConfig) -> float:
        """Return half the 95 % interval, in the unit of what is wanted."""
        if config.unit == "%":
            return 100.0 * CONFIDENCE * self.height_m / config.change_m
        water_m = self.height_m * config.density_kg_m3 / 1000.0
        return CONFIDENCE * float(np.hypot(water_m, self.density_m_we))


def budget_of(config: SeasonConfig, mean_error_m: float, n_stakes: int, n_days: float) -> ErrorBudget:
    """Return the error budget of two surveys of a design.

    `mean_error_m`: standard deviation of the area's mean height in one survey [m].
    """
    surface = SEASON_SURFACES[config.surface]
    both, known = np.sqrt(2.0), np.sqrt(1.0 + n_stakes)
    shared_m = min(config.shared_m, STAKED_M) if n_stakes >= 2 else config.shared_m
    return ErrorBudget(
        float(both * mean_error_m),
        float(both * shared_m),
        float(both * _RATE_SHARE * config.melt_m_day * n_days / np.sqrt(12.0) / known),
        float(config.emergence_m_year * config.n_days / _DAYS_OF_YEAR / known),
        surface.density_std_kg_m3 / 1000.0 * config.change_m,
    )


def mean_error_m(xy: FloatArray, nodes: FloatArray, posterior: KernelPosterior) -> float:
    """Return the standard deviation of the mean height over nodes, from samples at places [m].

    `xy` (N, 2): places of the samples [m]; where there are more than 1000, fewer stand for all, with less
    noise. `nodes` (M, 2): places that are spread evenly over the area [m].
    """
    every = max(int(np.ceil(len(xy) / _MOST_SAMPLES)), 1)
    parts = [one.weight * _mean_variance_m2(xy[::every], nodes, one, every) for one in posterior.kernels]
    return float(np.sqrt(sum(parts)) * np.exp(posterior.spread**2))


def _mean_variance_m2(xy: FloatArray, nodes: FloatArray, one: WeightedKernel, every: int) -> float:
    """Return the variance of the mean height over nodes under one covariance [m²]."""
    kernel = one.kernel
    matrix = kernel.covariance(xy, xy)
    noise_m2 = max(one.noise_m**2 / every, 1e-8 * one.variance_m2)
    matrix[np.diag_indices(len(matrix))] += noise_m2
    mean = kernel.covariance(xy, nodes).mean(axis=1)
    solved = np.linalg.solve(matrix, np.column_stack([np.ones(len(xy)), mean]))
    gap = 1.0 - float(mean @ solved[:, 0])
    left = float(kernel.covariance(nodes, nodes).mean()) - float(mean @ solved[:, 1])
    # Relief finer than samples is another at each node.
    unseen = one.unseen_m2 / len(nodes)
    return max(left, 0.0) + gap**2 / float(solved[:, 0].sum()) + unseen


STAKES = (0, 2, 5, 10, 20)
"""Numbers of stakes that are compared."""
_STAKES_A_DAY = 10.0
# More swaths are not tried where they lower the error by less than this share.
_WORTHWHILE = 0.02


class SeasonOption(NamedTuple):
    """One design: numbers of stakes and swaths, distance and days of one survey, and its errors."""

    n_stakes: int
    n_swaths: int
    length_m: float
    n_days: int
    budget: ErrorBudget
    error: float


@dataclass(frozen=True)
class SeasonDesign:
    """Designs of a season that were compared.

    `config`: what is wanted. `options`: all designs, by stakes and swaths. `route`: route of one survey of
    the best design. `best`: the design of the fewest days that gives the wanted error, or the one with the
    least error where none does.
    """

    config: SeasonConfig
    options: tuple[SeasonOption, ...]
    route: Route
    best: SeasonOption

    @property
    def holds(self) -> bool:
        """Whether the best design gives the wanted error."""
        return self.best.error <= self.config.wanted

    def dates(self, option: SeasonOption) -> tuple[tuple[date, date], tuple[date, date]]:
        """Return first and last day of each survey, about the wanted days."""
        before = timedelta(days=(option.n_days - 1) // 2)
        length = timedelta(days=option.n_days - 1)
        first, last = (day - before for day in (self.config.first_day, self.config.last_day))
        return (first, first + length), (last, last + length)


def design_season(area: SurveyArea, prior: Dem, config: SeasonConfig) -> SeasonDesign:
    """Find the swaths, stakes and days with which two surveys give a wanted error.

    The error is that of the mean over the area, not of the map. Melt is taken to be alike all season; systematic
    errors of the receiver that both surveys share cancel and are not included, and neither are basal or internal
    melt.
    """
    routes: dict[int, Route] = {}
    with threadpool_limits(1):
        options = tuple(_options(area, prior, config, routes))
    enough = [one for one in options if one.error <= config.wanted]
    if enough:
        best = min(enough, key=lambda one: (one.n_days, one.n_stakes, one.length_m))
    else:
        best = min(options, key=lambda one: one.error)
    return SeasonDesign(config, options, routes[best.n_swaths], best)


def _options(
    area: SurveyArea, prior: Dem, config: SeasonConfig, routes: dict[int, Route]
) -> Iterator[SeasonOption]:
    """Yield designs of more and more swaths, until they lower no error by much; store their routes."""
    last = float("inf")
    for n_swaths, route, error_m in _surveys(area, prior, config):
        routes[n_swaths] = route
        found = [_option(config, route, n_swaths, n_stakes, error_m) for n_stakes in STAKES]
        yield from found
        least = min(one.error for one in found)
        if least > (1.0 - _WORTHWHILE) * last:
            return
        last = least


def _surveys(area: SurveyArea, prior: Dem, config: SeasonConfig) -> Iterator[tuple[int, Route, float]]:
    """Yield numbers of swaths, routes, and the standard deviations of the area's mean height [m]."""
    requirement = MapRequirement(
        1.0,
        noise_m=config.noise_m,
        shared_m=config.shared_m,
        sample_step_m=config.sample_step_m,
        surface=config.surface,
        max_swaths=config.max_swaths,
    )
    posterior = posterior_of(area, prior, requirement)
    factor = settings_factor(area)
    step_m = factor * config.sample_step_m
    nodes = MapPredictor(area, step_m).nodes
    heading_deg, width_m = heading_and_width(area, prior)
    site = drivable(area)
    wavelength_m = WavyConfig(swaths=1).wavelength_scales * posterior.slope_length_m / factor
    for n in swath_counts(width_m, prior.step_m, requirement.in_grid_metres(factor)):
        shape = WavyConfig(swaths=n, wavelength_m=wavelength_m, heading_deg=heading_deg)
        route = planned_on(site, area, shape)
        yield n, route, mean_error_m(places(route, step_m), nodes, posterior)


def _option(config: SeasonConfig, route: Route, n_swaths: int, n_stakes: int, error_m: float) -> SeasonOption:
    """Return the design of so many swaths and stakes."""
    length_m = route.ground_length_m
    n_days = max(-int(-(length_m / 1000.0 / config.km_a_day + n_stakes / _STAKES_A_DAY) // 1), 1)
    budget = budget_of(config, error_m, n_stakes, n_days)
    return SeasonOption(n_stakes, n_swaths, length_m, n_days, budget, budget.error(config))
