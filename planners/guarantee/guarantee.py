"""Guarantee of a map class before the survey: a route with a probability, or a refusal.

A prior shows nothing finer than two or three of its cells. The guarantee therefore rests on the class of surface: how
rough measured ground of this class is below that (`planners.guarantee.requirement`). The probability that a pattern of so
many swaths meets the limit is predicted; the fewest swaths whose probability is sufficient are then tried on simulated
ground. More swaths follow until the lower confidence limit of the share of these surveys that meet the limit is the
probability, too.

The number of swaths never falls with a stricter limit, a higher probability, more noise or a prior of larger standard
deviation: the covariances depend on none of them, and all numbers of swaths are tried from the fewest on.
`SwathSearch` is this search. `Guarantee` is its result, with the stakes that save swaths by taking away the error that
all samples of a survey share.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from planners.config import settings_factor
from planners.guarantee.requirement import MapRequirement
from planners.guarantee.simulated_surveys import RESAMPLED, SimulatedErrors, SimulatedSurveys
from planners.guarantee.survey_lines import heading_and_width, smallest_sufficient, swath_counts
from planners.patterns.lawnmower import LawnmowerConfig
from planners.patterns.wavy import LinePattern, WavyConfig
from planners.planning import planned_on, require_cover
from planners.prediction.error_distribution import (
    ErrorDistribution,
    MapPrediction,
)
from planners.prediction.error_model import ErrorModel, model_in_grid
from planners.prediction.kernel_posterior import KernelPosterior, WeightedKernel, posterior_in_grid
from planners.prediction.places import places
from planners.routes.traversability import Drivable, drivable
from survey import Dem, Route, SurveyArea
from survey.core import FloatArray, Progress, length_text

STAKED_M = 0.02
"""Shared error that is left after two stakes, each measured to 3 cm [m]."""


class StakePlan(NamedTuple):
    """Places of stakes (K, 2) [m], and the swaths that they save."""

    xy: FloatArray
    saved_swaths: int

    @classmethod
    def at_ends(cls, route: Route, saved_swaths: int) -> "StakePlan":
        """Place a stake at the beginning of the first swath and one at the end of the last."""
        return cls(np.array([route.swaths[0].xy[0], route.swaths[-1].xy[-1]]), saved_swaths)

    def __str__(self) -> str:
        """Return number, places and what they save."""
        at = " and ".join(f"({x:.0f}, {y:.0f})" for x, y in self.xy)
        return f"{len(self.xy)} stakes at {at} save {self.saved_swaths} swaths"


class SurveyOption(NamedTuple):
    """A number of swaths: what it takes and what its map is predicted to err.

    `length_m`: distance to drive on the ground [m]. `rmse_m`, `low_m`, `high_m`: expected error, and the bounds that the
    error lies between with 80 % [m]. `probability`, `with_stakes`: probability that the limit is met, without stakes and
    with two of them. `prior_level_share`: share of the level in the squared error of a map whose level the prior alone
    holds. `by_level`: error [m] and probability where the prior alone holds the level of the map ("prior"), and
    with one tie more (`survey.reconstruction.level.TIES`).
    """

    swaths: int
    length_m: float
    rmse_m: float
    low_m: float
    high_m: float
    probability: float
    with_stakes: float
    prior_level_share: float
    by_level: Mapping[str, MapPrediction]

    def facts(self) -> dict[str, object]:
        """Return the fields, for programs."""
        levels = {name: one._asdict() for name, one in self.by_level.items()}
        return {**self._asdict(), "by_level": levels}

    def __str__(self) -> str:
        """Return one line."""
        return (
            f"{self.swaths} lines, {length_text(self.length_m)}: {self.rmse_m:.2g} m ({self.low_m:.2g} to {self.high_m:.2g} m "
            f"with 80 %), within the limit with {self.probability:.0%}, with two stakes {self.with_stakes:.0%}, with the "
            f"level of the prior alone {self.by_level['prior'].probability:.0%}"
        )


# Ratio of errors above which they contradict a class; on rough sites without a stated class it was 1.0 to 1.9.
_CONTRADICTED = 2.0


@dataclass(frozen=True)
class Guarantee:
    """A route, and the probability that its map meets a requirement.

    `route`: the shortest route found, or the densest one tried where none meets the requirement. `config`:
    its pattern. `requirement`: what the map has to meet. `posterior`: covariances that the guarantee rests
    on. `predicted`: probability and error from these covariances. `likely`: the same where the terrain has
    the likeliest covariance of the prior. `likely_swaths`: number of swaths that are enough with that
    covariance, at most those of the route. `simulated`: error of the map in each simulated survey, by kind of
    ground. `reachable_m`: error that the densest survey considered stays within with the required probability
    [m]; it does not depend on the limit. `options`: what other numbers of swaths of this pattern reach. `level_m`: standard
    deviation of the level of a map that the prior alone holds [m]. `stakes`: stakes that save swaths, where errors that samples share
    cost some. `unstated_m`: error that the densest survey reaches where no class of surface is stated [m],
    for a guarantee that does not hold and a class that the relief of the prior contradicts.
    """

    route: Route
    config: LinePattern
    requirement: MapRequirement
    posterior: KernelPosterior
    predicted: MapPrediction
    likely: MapPrediction
    likely_swaths: int
    simulated: SimulatedErrors = field(repr=False)
    reachable_m: float
    options: tuple[SurveyOption, ...]
    level_m: float
    stakes: StakePlan | None = None
    unstated_m: float | None = None

    @property
    def simulated_share(self) -> float:
        """Share of the simulated surveys whose map met the limit."""
        return self.simulated.share(self.requirement.limit_m)

    @property
    def simulated_bound(self) -> float:
        """Lower confidence limit of that share, with a confidence of 90 %."""
        return self.simulated.bounds(self.requirement.limit_m)[0]

    @property
    def resampled_ratio(self) -> float:
        """Median error on ground that repeats the relief of the prior at a smaller scale, over the predicted error."""
        return self.simulated.median_m(RESAMPLED) / self.predicted.rmse_m

    @property
    def is_contradicted(self) -> bool:
        """Whether a class of surface is stated and the relief of the prior gives twice its errors, or more."""
        return self.requirement.surface != "unknown" and self.resampled_ratio >= _CONTRADICTED

    @property
    def holds(self) -> bool:
        """Whether the predicted probability is sufficient, and so is the lower confidence limit of the simulated share."""
        limit_m, probability = self.requirement.limit_m, self.requirement.probability
        return self.predicted.probability >= probability and self.simulated.prove(limit_m, probability)

    @property
    def length_m(self) -> float:
        """Distance to drive, on the ground [m]."""
        return self.route.ground_length_m

    @property
    def assumptions(self) -> str:
        """Assumptions on the terrain, in one line."""
        best = self.posterior.likeliest
        families = " or ".join(one.cell.family for one in self.posterior.kernels)
        roughness = np.hypot(self.posterior.spread, self.posterior.open_spread)
        why = "as stated" if self.requirement.assumed else f"surface {self.requirement.surface}"
        return (
            f"covariance {families}, {why}; fitted to the prior: length scale {best.cell.length_scale_m:.0f} m, "
            f"standard deviation {np.sqrt(best.variance_m2):.1f} m, relief finer than samples {np.sqrt(best.unseen_m2):.2f} m; "
            f"the roughness differs from that by a factor of {np.exp(roughness):.2f} (standard deviation); a sample "
            f"errs by {best.noise_m:.2f} m, all together by {self.requirement.shared_m:.2f} m"
        )


# Numbers of swaths up to this are tried one by one, larger ones by bisection.
_EACH_TRIED = 12
# Denser surveys that are tried where simulated ones contradict the prediction.
_MOST_TRIALS = 4
# Numbers of swaths whose error is listed beside a guarantee.
_N_OPTIONS = 6


@dataclass(frozen=True, eq=False)
class SwathSearch:
    """Search for the fewest swaths that meet a requirement, whose lengths are grid metres.

    `requirement`: what the map has to meet. `prior`: coarse elevations. `site`: where the rover may be.
    `model`: predicts the error of a route's map. `heading_deg`: of the swaths [deg]. `counts`: numbers of swaths that are
    considered.
    """

    requirement: MapRequirement
    prior: Dem
    site: Drivable
    model: ErrorModel
    heading_deg: float
    counts: tuple[int, ...]
    _routes: dict[tuple[str, int], Route] = field(default_factory=dict)
    _known: dict[tuple[str, int, tuple[WeightedKernel, ...]], ErrorDistribution] = field(default_factory=dict)

    @classmethod
    def of(cls, area: SurveyArea, prior: Dem, requirement: MapRequirement) -> "SwathSearch":
        """Fit the covariances to the prior, and set the numbers of swaths that are considered."""
        heading_deg, width_m = heading_and_width(area, prior)
        return cls(
            requirement,
            prior,
            drivable(area),
            model_in_grid(area, prior, requirement),
            heading_deg,
            swath_counts(width_m, prior.step_m, requirement, float(area.free.area)),
        )

    def fewest(self, shape: LinePattern) -> int | None:
        """Return the fewest swaths of a pattern that are predicted to be enough; None where none are."""
        wanted, limit_m = self.requirement.probability, self.requirement.limit_m

        def is_enough(index: int) -> bool:
            return self._distribution(shape, self.counts[index - 1]).probability(limit_m) >= wanted

        # Where the densest survey is not enough, sparser ones are not predicted.
        if not is_enough(len(self.counts)):
            return None
        few = sum(n <= _EACH_TRIED for n in self.counts)
        found = next((index for index in range(1, few + 1) if is_enough(index)), None)
        if found is None and few < len(self.counts):
            found = smallest_sufficient(lambda i: is_enough(few + i), first=2, most=len(self.counts) - few)
            found = None if found is None else few + found
        return None if found is None else self.counts[found - 1]

    def best(self, progress: Progress | None = None) -> Guarantee:
        """Return the guarantee with the fewest swaths, of two alike the shorter; what reaches the least error where none holds."""
        tried = []
        shapes = list(self.patterns())
        for done, shape in enumerate(shapes):
            if progress is not None:
                progress("predicting patterns", done, len(shapes))
            n = self.fewest(shape)
            route = self._route(shape, n or self.counts[-1])[1]
            reached_m = 0.0 if n else self._reachable_m(shape)
            tried.append((n is None, reached_m, n or self.counts[-1], route.length_m, shape))
        is_missed, _, n, _, shape = min(tried, key=lambda one: one[:4])
        simulated = SimulatedSurveys(self.model, self.prior, self.requirement)
        found = self._proven(shape, n, simulated, may_grow=not is_missed, progress=progress)
        is_refuted = found.is_contradicted and not found.holds
        return replace(found, unstated_m=self._unstated_m()) if is_refuted else found

    def patterns(self) -> Iterator[LinePattern]:
        """Yield wavy swaths, and straight ones that end before the border."""
        # Settings are metres on the ground, the posterior's lengths grid metres.
        slope_length_m = self.model.slope_length_m / settings_factor(self.model.area)
        wavelength_m = WavyConfig(swaths=1).wavelength_scales * slope_length_m
        yield WavyConfig(swaths=1, wavelength_m=wavelength_m, heading_deg=self.heading_deg)
        yield LawnmowerConfig(swaths=1, inset_share=0.5, heading_deg=self.heading_deg)

    def _proven(
        self,
        shape: LinePattern,
        n: int,
        simulated: SimulatedSurveys,
        *,
        may_grow: bool,
        progress: Progress | None,
    ) -> Guarantee:
        """Try a survey in simulation, and denser ones where it contradicts the prediction."""
        rest = [count for count in self.counts if count >= n][: _MOST_TRIALS if may_grow else 1]
        for count in rest:
            errors = simulated.errors(self._route(shape, count)[1], progress)
            result = self._guarantee(shape, count, errors)
            if result.holds:
                break
        return result

    def _guarantee(self, shape: LinePattern, n: int, errors: SimulatedErrors) -> Guarantee:
        """Return what is predicted and simulated for so many swaths of a pattern."""
        config, route = self._route(shape, n)
        requirement, likely = self.requirement, self._likely
        predicted = self._predicted(self._distribution(shape, n))
        fewer = likely.fewest(shape) or n
        stakes = self._stakes(shape, n, route) if predicted.probability >= requirement.probability else None
        return Guarantee(
            route,
            config,
            requirement,
            self.model.posterior,
            predicted,
            self._predicted(likely._distribution(shape, n)),
            min(fewer, n),
            errors,
            self._least_reachable_m,
            self._options(shape, n),
            self.model.level_m or 0.0,
            stakes,
        )

    def _options(self, shape: LinePattern, n: int) -> tuple[SurveyOption, ...]:
        """Return what some numbers of swaths of a pattern reach, n among them."""
        at = np.unique(np.linspace(0, len(self.counts) - 1, _N_OPTIONS).round().astype(int))
        return tuple(self._option(shape, count) for count in sorted({n, *(self.counts[k] for k in at)}))

    def _option(self, shape: LinePattern, n: int) -> SurveyOption:
        beside, limit_m = self._beside_level(shape, n), self.requirement.limit_m
        found = beside.with_shared(self.requirement.shared_m)
        staked = beside.with_shared(min(STAKED_M, self.requirement.shared_m))
        levels = beside.by_level(self.model.level_m or 0.0)
        return SurveyOption(
            n,
            self._route(shape, n)[1].ground_length_m,
            found.rmse_m,
            found.quantile_m(0.1),
            found.quantile_m(0.9),
            found.probability(limit_m),
            staked.probability(limit_m),
            levels["prior"].shared_share,
            {name: MapPrediction(one.probability(limit_m), one.rmse_m) for name, one in levels.items()},
        )

    def _unstated_m(self) -> float:
        """Return the error that the densest survey reaches on ground of no stated class [m]."""
        unstated = replace(self.requirement, surface="unknown")
        model = model_in_grid(self.model.area, self.prior, unstated)
        return replace(self, requirement=unstated, model=model)._least_reachable_m

    @property
    def _least_reachable_m(self) -> float:
        """Least error that the densest survey of a pattern stays within with the required probability [m]."""
        return min(self._reachable_m(one) for one in self.patterns())

    def _reachable_m(self, shape: LinePattern) -> float:
        """Return the error that the densest survey of a pattern stays within with the required probability [m]."""
        return self._distribution(shape, self.counts[-1]).quantile_m(self.requirement.probability)

    @property
    def _likely(self) -> "SwathSearch":
        """The search with the likeliest covariance alone."""
        alone = KernelPosterior.of([self.model.posterior.likeliest])
        return replace(self, model=replace(self.model, posterior=alone))

    def _stakes(self, shape: LinePattern, n: int, route: Route) -> StakePlan | None:
        """Return the stakes that save swaths, or None."""
        requirement = replace(self.requirement, shared_m=min(STAKED_M, self.requirement.shared_m))
        with_stakes = replace(self, requirement=requirement).fewest(shape)
        saved = (self.fewest(shape) or n) - (with_stakes or n)
        return StakePlan.at_ends(route, saved) if saved > 0 else None

    def _predicted(self, distribution: ErrorDistribution) -> MapPrediction:
        return MapPrediction(distribution.probability(self.requirement.limit_m), distribution.rmse_m)

    def _distribution(self, shape: LinePattern, n: int) -> ErrorDistribution:
        """Return the distribution of the error of so many swaths."""
        return self._beside_level(shape, n).with_shared(self.requirement.shared_m)

    def _beside_level(self, shape: LinePattern, n: int) -> ErrorDistribution:
        """Return the distribution of the error of so many swaths, without what all samples share."""
        posterior = self.model.posterior
        key = shape.pattern, n, posterior.kernels
        if key not in self._known:
            xy = places(self._route(shape, n)[1], self.requirement.sample_step_m)
            self._known[key] = self.model.predictor.distribution(xy, posterior)
        return replace(self._known[key], spread=posterior.spread, open_spread=posterior.open_spread)

    def _route(self, shape: LinePattern, n: int) -> tuple[LinePattern, Route]:
        config = shape.model_copy(update={"swaths": n})
        if (shape.pattern, n) not in self._routes:
            self._routes[shape.pattern, n] = planned_on(self.site, self.model.area, config)
        return config, self._routes[shape.pattern, n]


def guarantee(
    area: SurveyArea, prior: Dem, requirement: MapRequirement, *, progress: Progress | None = None
) -> Guarantee:
    """Find the shortest survey whose map meets a requirement, by prediction and by simulation.

    The map is a Gaussian process of the samples and of the cells of the prior, as `reconstruct` makes it with the prior. Relief finer than the prior resolves is extrapolated
    with the roughness of the class of surface; an adaptive survey (`planners.guarantee.adaptive`) learns it from the
    first swaths instead. Swaths run across a marked grain of the prior, at most five of its cells apart. Terrain that
    the prior does not cover has the fitted covariance and no known heights. On an area of more than sixteen cells along
    a side the simulated surveys cover a square at its centre.
    """
    require_cover(area, prior)
    grid_requirement = requirement.in_grid_metres(settings_factor(area))
    with threadpool_limits(1):
        search = SwathSearch.of(area, prior, grid_requirement)
        best = search.best(progress)
    return replace(best, requirement=requirement)


def posterior_of(area: SurveyArea, prior: Dem, requirement: MapRequirement) -> KernelPosterior:
    """Return the covariances that the cells of a prior make likely on an area."""
    require_cover(area, prior)
    requirement = requirement.in_grid_metres(settings_factor(area))
    return posterior_in_grid(area, prior, requirement)
