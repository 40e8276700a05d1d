r"""Design of a season: the swaths, stakes and days with which two surveys give a wanted error of the mass balance.

`design_season` compares numbers of swaths and stakes by the standard deviation of the mean change of height. Both
surveys drive the same lines. The relief that persists is alike in both and cancels; what is left of their difference is the
change: a mean, a gradient with height and a smooth rest (`SurfaceChange`). The error has these parts:

- interpolation: what the lines leave open of the mean of the smooth rest,

  .. math::  w^T K w - 2 \, w^T \bar k + \overline{k}, \qquad
             w = K_n^{-1} \left( \bar k + 1 \, (1 - 1^T K_n^{-1} \bar k) / (1^T K_n^{-1} 1) \right)

  with the covariance K of the rest at the samples, :math:`K_n = K + \sigma^2 I` with their errors, and the means of the
  covariance over the area (block kriging; Journel and Huijbregts 1978);
- gradient: how far the lines' weighted mean height is from that of the area, times the gradient;
- samples: :math:`\sigma \sqrt{w^T w}` with the errors of a difference: receiver and relief finer than the samples, both
  drawn anew at each date, and errors of place on slopes of the prior;
- shared: the error that all samples of a survey share, or what two stakes leave of it;
- duration: melt while a survey lasts T days, :math:`0.3 \, \dot h \, T / \sqrt{12}`, its rate known to 30 %;
- flow: the mean vertical motion of the ice.

Each of K stakes measures melt and flow by itself, which divides their errors by :math:`\sqrt{1 + K}`; five to ten stakes
are found to be enough on small glaciers (Fountain and Vecchia 1999, Geografiska Annaler A 81, 563). The error of the
density is added for a mass balance. Basal and internal melt are not included.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import date, timedelta
from typing import Literal, NamedTuple

import numpy as np
from scipy.optimize import brentq
from threadpoolctl import threadpool_limits

from planners.config import settings_factor
from planners.guarantee.guarantee import STAKED_M
from planners.guarantee.requirement import MapRequirement
from planners.guarantee.survey_lines import heading_and_width, swath_counts
from planners.patterns.lawnmower import LawnmowerConfig
from planners.planning import planned_on, require_cover
from planners.prediction.assumptions import SURFACES, Surface
from planners.prediction.error_distribution import MapPredictor
from planners.prediction.kernel_posterior import PriorBlocks
from planners.prediction.places import places
from planners.routes.traversability import drivable
from survey import ConfigError, Dem, Route, SurveyArea
from survey.core import FloatArray
from survey.reconstruction.gp.kernels import KINDS, Stationary

Unit = Literal["m w.e.", "%"]

_MEAN_TEMPERATURE_C = 5.0
_LAPSE_C_M = 0.0065


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

# Melt differs by a tenth between stakes that stand near one another, by albedo (Braithwaite and others 1998, Journal of
# Glaciology 44, 583), and from slope to slope with the sun (Vincent and Six 2013, Annals of Glaciology 54(63), 11). The
# pattern of albedo is alike at all scales up to 100 m (Arnold and Rees 2003, Journal of Glaciology 49, 547), that of the
# sun follows the relief. Both numbers are own choice between these.
_CHANGE_SHARE = 0.15
_CHANGE_HALF_M = 150.0
CHANGE_FAMILIES: Mapping[str, float] = {"matern-3/2": 0.5, "whittle": 0.5}
"""Weights of the families of covariance that a change may have, measured on repeated elevation models
(``python -m benchmarks.season``); relief of unknown ground has the same."""


class SurfaceChange(NamedTuple):
    """Change of a surface between two surveys: a mean, a gradient with height, a smooth rest, and relief drawn anew.

    `std_m`: standard deviation of the smooth rest [m]. `half_m`: distance at which its correlation is a half [m].
    `gradient`: metres for each metre of height. `redrawn_m`: standard deviation of relief finer than the samples, which is
    another one at each date [m]. `families`: weights of the families of covariance.
    """

    std_m: float
    half_m: float
    gradient: float = 0.0
    redrawn_m: float = 0.0
    families: Mapping[str, float] = CHANGE_FAMILIES

    def kernel(self, family: str) -> Stationary:
        """Return the covariance of the smooth rest in one family [m²]."""
        unit = KINDS[family](1.0, 1.0)
        half = brentq(lambda lag: float(unit.covariance_of_lag(np.array([lag, 0.0]))) - 0.5, 0.01, 10.0)
        return replace(unit, variance_m2=max(self.std_m, 1e-6) ** 2, length_scale_m=self.half_m / half)


@dataclass(frozen=True)
class SeasonConfig:
    """Settings of a season's design.

    `wanted`: half the width of the 95 % interval of the mass balance [m w.e.] or of the change of volume [%].
    `unit`: unit of `wanted`. `first_day`, `last_day`: days that the two surveys are about. `surface`: class
    of the ground. `melt_m_we_day`: mean melt of a day [m w.e.]; that of the surface by default.
    `emergence_m_year`: standard deviation of the mean vertical motion of the ice over the area [m per year];
    0 for a complete glacier. `noise_m`, `shared_m`: standard deviation of a sample's height, and of an error
    that all samples of a survey share [m]. `sample_step_m`: distance between samples [m]. `km_a_day`:
    distance that is driven in a day [km]. `max_swaths`: most swaths to consider. `localization_m`: standard
    deviation of the rover's place, east and north each [m]. `micro_relief_m`: standard deviation of relief finer
    than the samples [m]; that of the surface by default. `change_std_m`, `change_half_m`: standard deviation of
    the change about its gradient with height, 15 % of the melt by default, and the distance at which its
    correlation is a half [m].
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
    localization_m: float = 0.0
    micro_relief_m: float | None = None
    change_std_m: float | None = None
    change_half_m: float = _CHANGE_HALF_M

    def __post_init__(self) -> None:
        if self.surface not in SEASON_SURFACES:
            raise ConfigError(
                f"the surface of a season is {self.surface}; take {' or '.join(SEASON_SURFACES)}, the surfaces of glaciers."
            )
        if self.last_day <= self.first_day:
            raise ConfigError(
                f"the season ends on {self.last_day}, not after {self.first_day}; give a later day."
            )
        for name in ("wanted", "km_a_day", "change_half_m"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0.0):
                raise ConfigError(f"{name} is {getattr(self, name)}; it must be greater than 0.")
        for name in ("melt_m_we_day", "emergence_m_year", "change_std_m"):
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

    @property
    def change(self) -> SurfaceChange:
        """What the change is taken to be like: melt falls with height as degree-days do, by 6.5 °C for each kilometre."""
        micro_m = (
            SURFACES[self.surface].micro_relief_m if self.micro_relief_m is None else self.micro_relief_m
        )
        std_m = _CHANGE_SHARE * self.change_m if self.change_std_m is None else self.change_std_m
        gradient = self.change_m * _LAPSE_C_M / _MEAN_TEMPERATURE_C
        return SurfaceChange(std_m, self.change_half_m, gradient, micro_m)


CONFIDENCE = 1.96
"""Standard deviations in half of a 95 % interval."""

_MOST_SAMPLES = 1000
_RATE_SHARE = 0.3
_DAYS_OF_YEAR = 365.25


class MeanError(NamedTuple):
    """Standard deviations of the mean change over an area by cause [m], and that of interpolation in each family [m]."""

    interpolation_m: float
    gradient_m: float
    samples_m: float
    families: Mapping[str, float]


class ErrorBudget(NamedTuple):
    """Standard deviations of the mean change of height by cause, and of its mass by density [m, m w.e.]."""

    interpolation_m: float
    gradient_m: float
    samples_m: float
    shared_m: float
    duration_m: float
    flow_m: float
    density_m_we: float

    @property
    def height_m(self) -> float:
        """Standard deviation of the mean change of height [m]."""
        return float(np.sqrt(sum(part**2 for part in self[:-1])))

    def error(self, config: SeasonConfig) -> float:
        """Return half the 95 % interval, in the unit of what is wanted."""
        if config.unit == "%":
            return 100.0 * CONFIDENCE * self.height_m / config.change_m
        water_m = self.height_m * config.density_kg_m3 / 1000.0
        return CONFIDENCE * float(np.hypot(water_m, self.density_m_we))


def budget_of(config: SeasonConfig, mean: MeanError, n_stakes: int, n_days: float) -> ErrorBudget:
    """Return the error budget of two surveys of a design."""
    surface = SEASON_SURFACES[config.surface]
    both, known = np.sqrt(2.0), np.sqrt(1.0 + n_stakes)
    shared_m = min(config.shared_m, STAKED_M) if n_stakes >= 2 else config.shared_m
    return ErrorBudget(
        *mean[:3],
        float(both * shared_m),
        float(both * _RATE_SHARE * config.melt_m_day * n_days / np.sqrt(12.0) / known),
        float(config.emergence_m_year * config.n_days / _DAYS_OF_YEAR / known),
        surface.density_std_kg_m3 / 1000.0 * config.change_m,
    )


def mean_error(
    xy: FloatArray, nodes: FloatArray, change: SurfaceChange, noise_m: float, prior: Dem | None = None
) -> MeanError:
    """Return the error of the mean change over nodes, from samples of two surveys at the same places.

    Of the families of covariance the weighted geometric mean counts, so that the roughest does not decide alone.

    `xy` (N, 2): places of the samples [m]; where there are more than 1000, fewer stand for all, with less
    noise. `nodes` (M, 2): places that are spread evenly over the area [m]. `noise_m`: standard deviation of one
    sample of the difference [m]. `prior`: heights that the gradient goes with.
    """
    every = max(int(np.ceil(len(xy) / _MOST_SAMPLES)), 1)
    used = xy[::every]
    # Heights above the mean of the area; 0 where the prior has none.
    uneven = (
        0.0 * used[:, 0] if prior is None else np.nan_to_num(prior.at(used) - np.nanmean(prior.at(nodes)))
    )
    parts = []
    for family in change.families:
        weights, between_m2 = kriged_mean(used, nodes, change.kernel(family), noise_m / np.sqrt(every))
        off_m = change.gradient * float(weights @ uneven)
        parts.append((between_m2, off_m**2, noise_m**2 / every * float(weights @ weights)))
    shares = np.array(list(change.families.values()))
    logs = shares / shares.sum() @ np.log(np.maximum(parts, 1e-12))
    families = {name: float(np.sqrt(part[0])) for name, part in zip(change.families, parts, strict=True)}
    interpolation_m, gradient_m, samples_m = np.exp(0.5 * logs).tolist()
    return MeanError(interpolation_m, gradient_m, samples_m, families)


def kriged_mean(
    xy: FloatArray, nodes: FloatArray, kernel: Stationary, noise_m: float
) -> tuple[FloatArray, float]:
    """Return the weights (N,) of the samples in the mean over nodes, and what they leave open of it [m²]."""
    open_m2 = kernel.covariance(xy, xy)
    noisy = open_m2 + max(noise_m**2, 1e-8 * kernel.variance_m2) * np.eye(len(xy))
    mean = kernel.covariance(xy, nodes).mean(axis=1)
    ones, own = np.linalg.solve(noisy, np.column_stack([np.ones(len(xy)), mean])).T
    weights: FloatArray = own + ones * (1.0 - own.sum()) / ones.sum()
    between = weights @ open_m2 @ weights - 2.0 * weights @ mean + kernel.covariance(nodes, nodes).mean()
    return weights, max(float(between), 0.0)


STAKES = (0, 2, 5, 10, 20)
"""Numbers of stakes that are compared."""
_STAKES_A_DAY = 10.0
# More swaths are not tried where they lower the error by less than this share.
_WORTHWHILE = 0.02


class SeasonOption(NamedTuple):
    """One design: numbers of stakes and swaths, distance and days of one survey, and its errors.

    `families`: standard deviation of the interpolated change in each family of covariance [m].
    """

    n_stakes: int
    n_swaths: int
    length_m: float
    n_days: int
    budget: ErrorBudget
    error: float
    families: Mapping[str, float]


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
    for n_swaths, route, error in _surveys(area, prior, config):
        routes[n_swaths] = route
        found = [_option(config, route, n_swaths, n_stakes, error) for n_stakes in STAKES]
        yield from found
        least = min(one.error for one in found)
        if least > (1.0 - _WORTHWHILE) * last:
            return
        last = least


def _surveys(area: SurveyArea, prior: Dem, config: SeasonConfig) -> Iterator[tuple[int, Route, MeanError]]:
    """Yield numbers of swaths, routes, and the errors of the mean change that surveys along them leave."""
    require_cover(area, prior)
    factor = settings_factor(area)
    requirement = MapRequirement(
        1.0,
        noise_m=config.noise_m,
        localization_m=config.localization_m,
        shared_m=config.shared_m,
        sample_step_m=config.sample_step_m,
        micro_relief_m=config.micro_relief_m,
        max_swaths=config.max_swaths,
    ).in_grid_metres(factor)
    change = config.change
    tilted_m = (
        config.localization_m * PriorBlocks.of(area, prior).slope * factor if config.localization_m else 0.0
    )
    noise_m = float(np.sqrt(2.0 * (config.noise_m**2 + change.redrawn_m**2 + tilted_m**2)))
    change = change._replace(half_m=factor * change.half_m)
    nodes = MapPredictor(area, requirement.sample_step_m).nodes
    heading_deg, width_m = heading_and_width(area, prior)
    site = drivable(area)
    for n in swath_counts(width_m, change.half_m, requirement):
        route = planned_on(site, area, LawnmowerConfig(swaths=n, heading_deg=heading_deg))
        yield n, route, mean_error(places(route, requirement.sample_step_m), nodes, change, noise_m, prior)


def _option(
    config: SeasonConfig, route: Route, n_swaths: int, n_stakes: int, error: MeanError
) -> SeasonOption:
    """Return the design of so many swaths and stakes."""
    length_m = route.ground_length_m
    n_days = max(-int(-(length_m / 1000.0 / config.km_a_day + n_stakes / _STAKES_A_DAY) // 1), 1)
    budget = budget_of(config, error, n_stakes, n_days)
    return SeasonOption(n_stakes, n_swaths, length_m, n_days, budget, budget.error(config), error.families)
