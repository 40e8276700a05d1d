"""Design of a season: the swaths, stakes and days with which two surveys give a wanted error."""

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import date, timedelta
from typing import NamedTuple

from threadpoolctl import threadpool_limits

from planners.config_wavy import WavyConfig
from planners.ground.transit import FreeGround
from planners.ground.traversability import drivable
from planners.ground_metres import settings_factor
from planners.guarantee.guarantee import posterior_of
from planners.guarantee.prediction import LimitPredictor
from planners.guarantee.requirement import MapRequirement
from planners.guarantee.search import swath_counts
from planners.guarantee.survey_lines import SurveyLines
from planners.planning import planned_on
from planners.prediction.error_model import places
from planners.season.budget import ErrorBudget, budget_of, mean_error_m
from planners.season.config import SeasonConfig
from planners.swaths.heading import across_marked_grain
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.route import Route

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

    Parameters
    ----------
    config : SeasonConfig
        What is wanted.
    options : tuple of SeasonOption
        All designs, by stakes and swaths.
    route : Route
        Route of one survey of the best design.
    best : SeasonOption
        The design of the fewest days that gives the wanted error, or the one with the least error where none does.
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
        """Return first and last day of each survey, about the wanted days.

        Parameters
        ----------
        option : SeasonOption
            One of the designs.

        Returns
        -------
        tuple
            Of the first and of the second survey.
        """
        before = timedelta(days=(option.n_days - 1) // 2)
        length = timedelta(days=option.n_days - 1)
        first, last = (day - before for day in (self.config.first_day, self.config.last_day))
        return (first, first + length), (last, last + length)


def design_season(area: SurveyArea, prior: Dem, config: SeasonConfig) -> SeasonDesign:
    """Find the swaths, stakes and days with which two surveys give a wanted error.

    Parameters
    ----------
    area : SurveyArea
        The glacier, or a part of it.
    prior : Dem
        Coarse elevations over the area, in its CRS.
    config : SeasonConfig
        Wanted error, dates, melt, flow, and errors of the samples.

    Returns
    -------
    SeasonDesign
        Check whether it `holds`.

    Raises
    ------
    InputError
        As `planners.guarantee.guarantee.guarantee` does.

    Notes
    -----
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
    nodes = LimitPredictor(area, 1.0, step_m).nodes
    heading_deg = across_marked_grain(FreeGround(area.free), prior)
    width_m, site = SurveyLines(area, heading_deg).width_m, drivable(area)
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
