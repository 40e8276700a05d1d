r"""Guarantee of a map class before the survey: a route with a probability, or a refusal.

A prior's cells leave open how rough the terrain is between them. The guarantee therefore rests on the roughest
family of covariances that they do not exclude (`cautious_posterior`), or on one that is stated. The probability
that a pattern meets the limit is predicted from the covariance; the shortest pattern whose probability is
sufficient is then tried in simulated surveys: terrain drawn so that it agrees with the cells, sampled with the
sensor's errors, mapped by a Gaussian process that is fitted to the samples, and scored. Prediction and simulation
both have to meet the requirement.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from threadpoolctl import threadpool_limits

from planners.config import LawnmowerConfig, WavyConfig
from planners.ground.drivable_area import Drivable
from planners.ground.transit import FreeGround
from planners.ground.traversability import drivable
from planners.ground_metres import settings_factor
from planners.guarantee.kernel_posterior import KernelPosterior, cautious_posterior, posterior_from_prior
from planners.guarantee.prediction import FITTED_KERNEL_INFLATION, LimitPredictor, MapPrediction
from planners.guarantee.requirement import MapRequirement
from planners.guarantee.search import fewest
from planners.guarantee.simulation import SimulatedSurveys
from planners.planning import planned_on
from planners.prediction.error_model import places
from planners.prediction.prior_cover import require_cover
from planners.swaths.heading import across_marked_grain
from survey.core.arrays import FloatArray
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.route import Route
from survey.terrain.conditional import CoarseCells

_MOST_SWATHS = 30

LinePattern = LawnmowerConfig | WavyConfig


@dataclass(frozen=True)
class Guarantee:
    """A route, and the probability that its map meets a requirement.

    Parameters
    ----------
    route : Route
        The shortest route found, or the densest one tried where none meets the requirement.
    config : LawnmowerConfig or WavyConfig
        Its pattern.
    requirement : MapRequirement
        What the map has to meet.
    posterior : KernelPosterior
        Covariances that the guarantee rests on.
    predicted : MapPrediction
        Probability and error from these covariances.
    likely : MapPrediction
        The same where the terrain has the likeliest covariance of the prior.
    likely_swaths : int
        Number of swaths that are enough with that covariance, at most those of the route.
    simulated_rmse_m : (S,) ndarray
        Error of the map in each simulated survey [m].
    """

    route: Route
    config: LinePattern
    requirement: MapRequirement
    posterior: KernelPosterior
    predicted: MapPrediction
    likely: MapPrediction
    likely_swaths: int
    simulated_rmse_m: FloatArray = field(repr=False)

    @property
    def simulated_share(self) -> float:
        """Share of the simulated surveys whose map met the limit."""
        return float(np.mean(self.simulated_rmse_m <= self.requirement.limit_m))

    @property
    def holds(self) -> bool:
        """Whether prediction and simulation both reach the required probability."""
        return min(self.predicted.probability, self.simulated_share) >= self.requirement.probability

    @property
    def length_m(self) -> float:
        """Distance to drive, on the ground [m]."""
        return self.route.ground_length_m

    @property
    def reachable_m(self) -> float:
        """Error that this route stays within with the required probability, in the simulated surveys [m]."""
        return float(np.quantile(self.simulated_rmse_m, self.requirement.probability, method="higher"))

    @property
    def assumptions(self) -> str:
        """Assumptions on the terrain, in one line."""
        best = self.posterior.likeliest
        why = (
            "as stated" if self.requirement.assumed else "the roughest family that the prior does not exclude"
        )
        return (
            f"covariance {best.cell.family}, {why}; fitted to the prior: length scale {best.cell.length_scale_m:.0f} m, "
            f"standard deviation {np.sqrt(best.variance_m2):.1f} m; a sample errs by {best.noise_m:.2f} m"
        )


def guarantee(area: SurveyArea, prior: Dem, requirement: MapRequirement) -> Guarantee:
    """Find the shortest survey whose map meets a requirement, by prediction and by simulation.

    Parameters
    ----------
    area : SurveyArea
        What is to be mapped.
    prior : Dem
        Coarse elevations over the area, in its CRS.
    requirement : MapRequirement
        Largest error of the map, its probability, and the errors of the samples.

    Returns
    -------
    Guarantee
        Check whether it `holds`; one that does not names the `reachable_m` error.

    Raises
    ------
    InputError
        A prior in another CRS, without a height on the area, or with too few or too many cells on it; an area
        that no swath meets.
    CapacityError
        More samples or a larger area than can be simulated.

    Notes
    -----
    The map is a Gaussian process fitted to the survey alone. Relief finer than the prior's cells is extrapolated
    through the roughest of four families of covariance that the cells do not exclude: on smooth terrain this takes
    more swaths than are needed. An adaptive survey (`planners.guarantee.adaptive`) fits the family to the first
    swaths instead. Small relief on a smooth surface, which no cell shows, and errors that samples share are not
    included. Swaths run across a marked grain of the prior. Terrain that the prior does not cover has the fitted
    covariance and no known heights.
    """
    require_cover(area, prior)
    grid_requirement = requirement.in_grid_metres(settings_factor(area))
    with threadpool_limits(1):
        search = _Search.of(area, prior, grid_requirement)
        # A covariance that is alike in all directions does not show ridges that run beside the swaths.
        heading_deg = across_marked_grain(FreeGround(area.free), prior)
        tried = [search.shortest(shape) for shape in search.patterns(heading_deg)]
    best = tried[0]
    for other in tried[1:]:
        best = other if _is_better(other, best) else best
    return replace(best, requirement=requirement)


def posterior_of(area: SurveyArea, prior: Dem, requirement: MapRequirement) -> KernelPosterior:
    """Return the covariances that the cells of a prior make likely on an area.

    Parameters
    ----------
    area : SurveyArea
        What is to be mapped.
    prior : Dem
        Coarse elevations over the area, in its CRS.
    requirement : MapRequirement
        Its errors of the samples and of the prior are used.

    Returns
    -------
    KernelPosterior
        With lengths in the metres of the CRS.

    Raises
    ------
    InputError
        As `guarantee` does.
    """
    require_cover(area, prior)
    requirement = requirement.in_grid_metres(settings_factor(area))
    cells = _cells(area, prior, requirement)
    return posterior_from_prior(cells, noise_m=requirement.noise_m, localization_m=requirement.localization_m)


def _cells(area: SurveyArea, prior: Dem, requirement: MapRequirement) -> CoarseCells:
    """Return the cells of the prior on the area."""
    half = 0.5 * prior.step_m
    xmin, ymin, xmax, ymax = area.bounds
    near = prior.window((xmin - half, ymin - half, xmax + half, ymax + half))
    return CoarseCells(near, requirement.prior_sigma_m)


def _is_better(one: Guarantee, other: Guarantee) -> bool:
    """Prefer a guarantee that holds, then the shorter; of two that fail, the more probable."""
    if one.holds != other.holds:
        return one.holds
    if one.holds:
        return one.route.length_m < other.route.length_m
    return one.predicted.probability > other.predicted.probability


@dataclass(frozen=True, eq=False)
class _Search:
    """Search for the fewest swaths of a pattern that meet a requirement, whose lengths are grid metres."""

    requirement: MapRequirement
    site: Drivable
    predictor: LimitPredictor
    simulated: SimulatedSurveys
    posterior: KernelPosterior
    likely: KernelPosterior

    @classmethod
    def of(cls, area: SurveyArea, prior: Dem, requirement: MapRequirement) -> "_Search":
        cells = _cells(area, prior, requirement)
        errors = {"noise_m": requirement.noise_m, "localization_m": requirement.localization_m}
        posterior = cautious_posterior(cells, **errors, assumed=requirement.assumed)
        likely = posterior
        if requirement.assumed is None:
            likely = KernelPosterior.of([posterior_from_prior(cells, **errors).likeliest])
        return cls(
            requirement,
            drivable(area),
            LimitPredictor(area, requirement.limit_m, requirement.sample_step_m, FITTED_KERNEL_INFLATION),
            SimulatedSurveys(area, cells, posterior, requirement),
            posterior,
            likely,
        )

    def patterns(self, heading_deg: float) -> Iterator[LinePattern]:
        """Yield wavy swaths, and straight ones that end before the border."""
        # Settings are metres on the ground, the posterior's lengths grid metres.
        slope_length_m = self.posterior.slope_length_m / settings_factor(self.predictor.area)
        wavelength_m = WavyConfig(swaths=1).wavelength_scales * slope_length_m
        yield WavyConfig(swaths=1, wavelength_m=wavelength_m, heading_deg=heading_deg)
        yield LawnmowerConfig(swaths=1, inset_share=0.5, heading_deg=heading_deg)

    def shortest(self, shape: LinePattern) -> Guarantee:
        """Return the fewest swaths that are predicted to be enough, and more where the simulation needs more."""
        n = self._fewest(shape, self.posterior, first=4, most=_MOST_SWATHS) or _MOST_SWATHS
        while True:
            result = self._tried(shape, n)
            if result.holds or n >= _MOST_SWATHS:
                break
            n = min(n + max(n // 8, 1), _MOST_SWATHS)
        fewer = None
        if self.likely is not self.posterior and n > 1:
            fewer = self._fewest(shape, self.likely, first=n - 1, most=n - 1)
        return replace(result, likely_swaths=fewer or n)

    def _tried(self, shape: LinePattern, n: int) -> Guarantee:
        """Predict and simulate a survey of so many swaths."""
        config, route = self._route(shape, n)
        xy = places(route, self.requirement.sample_step_m)
        return Guarantee(
            route,
            config,
            self.requirement,
            self.posterior,
            self.predictor.of(xy, self.posterior),
            self.predictor.of(xy, self.likely),
            n,
            self.simulated.errors(route),
        )

    def _fewest(self, shape: LinePattern, posterior: KernelPosterior, *, first: int, most: int) -> int | None:
        """Return the fewest swaths that are predicted to be enough."""

        def is_enough(n: int) -> bool:
            xy = places(self._route(shape, n)[1], self.requirement.sample_step_m)
            return self.predictor.of(xy, posterior).probability >= self.requirement.probability

        return fewest(is_enough, first=first, most=most)

    def _route(self, shape: LinePattern, n: int) -> tuple[LinePattern, Route]:
        config = shape.model_copy(update={"swaths": n})
        return config, planned_on(self.site, self.predictor.area, config)
