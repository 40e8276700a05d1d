"""Search for the fewest swaths whose map meets a limit with a probability."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

from planners.config_lawnmower import LawnmowerConfig
from planners.config_wavy import WavyConfig
from planners.ground.drivable_area import Drivable
from planners.ground.transit import FreeGround
from planners.ground.traversability import drivable
from planners.ground_metres import settings_factor
from planners.guarantee.error_distribution import ErrorDistribution
from planners.guarantee.posterior.kernel_posterior import KernelPosterior, WeightedKernel
from planners.guarantee.prediction import FITTED_KERNEL_INFLATION, LimitPredictor, MapPrediction
from planners.guarantee.proof.simulation import SimulatedErrors, SimulatedSurveys
from planners.guarantee.requirement import MapRequirement
from planners.guarantee.result import Guarantee, LinePattern
from planners.guarantee.search import fewest as first_enough
from planners.guarantee.search import swath_counts
from planners.guarantee.site_posterior import posterior_in_grid
from planners.guarantee.stakes import STAKED_M, StakePlan
from planners.guarantee.survey_lines import SurveyLines
from planners.planning import planned_on
from planners.prediction.error_model import places
from planners.swaths.heading import across_marked_grain
from survey.core.arrays import Progress
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.route import Route

# Numbers of swaths up to this are tried one by one, larger ones by bisection.
_EACH_TRIED = 12
# Denser surveys that are tried where simulated ones contradict the prediction.
_MOST_TRIALS = 4


@dataclass(frozen=True, eq=False)
class SwathSearch:
    """Search for the fewest swaths that meet a requirement, whose lengths are grid metres.

    Parameters
    ----------
    requirement : MapRequirement
        What the map has to meet.
    prior : Dem
        Coarse elevations.
    site : Drivable
        Where the rover may be.
    predictor : LimitPredictor
        Predicts the error of a route's map.
    posterior : KernelPosterior
        Covariances that the terrain may have.
    heading_deg : float
        Of the swaths [deg].
    counts : tuple of int
        Numbers of swaths that are considered.
    """

    requirement: MapRequirement
    prior: Dem
    site: Drivable
    predictor: LimitPredictor
    posterior: KernelPosterior
    heading_deg: float
    counts: tuple[int, ...]
    _routes: dict[tuple[str, int], Route] = field(default_factory=dict)
    _known: dict[tuple[str, int, tuple[WeightedKernel, ...]], ErrorDistribution] = field(default_factory=dict)

    @classmethod
    def of(cls, area: SurveyArea, prior: Dem, requirement: MapRequirement) -> "SwathSearch":
        """Fit the covariances to the prior, and set the numbers of swaths that are considered.

        Parameters
        ----------
        area : SurveyArea
            What is to be mapped.
        prior : Dem
            Coarse elevations over the area.
        requirement : MapRequirement
            What the map has to meet, with lengths in grid metres.

        Returns
        -------
        SwathSearch
            With nothing predicted yet.
        """
        # A covariance that is alike in all directions does not show ridges that run beside the swaths.
        heading_deg = across_marked_grain(FreeGround(area.free), prior)
        width_m = SurveyLines(area, heading_deg).width_m
        return cls(
            requirement,
            prior,
            drivable(area),
            LimitPredictor(
                area,
                requirement.limit_m,
                requirement.sample_step_m,
                FITTED_KERNEL_INFLATION,
                requirement.shared_m,
            ),
            posterior_in_grid(area, prior, requirement),
            heading_deg,
            swath_counts(width_m, prior.step_m, requirement),
        )

    def fewest(self, shape: LinePattern) -> int | None:
        """Return the fewest swaths of a pattern that are predicted to be enough; None where none are.

        Parameters
        ----------
        shape : LawnmowerConfig or WavyConfig
            The pattern.

        Returns
        -------
        int or None
            One of the numbers that are considered.
        """
        wanted, limit_m = self.requirement.probability, self.requirement.limit_m

        def is_enough(index: int) -> bool:
            return self._distribution(shape, self.counts[index - 1]).probability(limit_m) >= wanted

        few = sum(n <= _EACH_TRIED for n in self.counts)
        found = next((index for index in range(1, few + 1) if is_enough(index)), None)
        if found is None and few < len(self.counts):
            found = first_enough(lambda i: is_enough(few + i), first=2, most=len(self.counts) - few)
            found = None if found is None else few + found
        return None if found is None else self.counts[found - 1]

    def best(self, progress: Progress | None = None) -> Guarantee:
        """Return the guarantee with the fewest swaths, of two alike the shorter; what reaches the least error where none holds.

        Parameters
        ----------
        progress : callable, optional
            Called with what is done, how much of it, and of how much.

        Returns
        -------
        Guarantee
            With the error that the densest survey of either pattern reaches.
        """
        tried = []
        shapes = list(self.patterns())
        for done, shape in enumerate(shapes):
            if progress is not None:
                progress("predicting patterns", done, len(shapes) + 1)
            n = self.fewest(shape)
            route = self._route(shape, n or self.counts[-1])[1]
            reached_m = 0.0 if n else self._reachable_m(shape)
            tried.append((n is None, reached_m, n or self.counts[-1], route.length_m, shape))
        if progress is not None:
            progress("simulating surveys", len(shapes), len(shapes) + 1)
        is_missed, _, n, _, shape = min(tried, key=lambda one: one[:4])
        simulated = SimulatedSurveys(self.predictor.area, self.prior, self.posterior, self.requirement)
        found = self._proven(shape, n, simulated, may_grow=not is_missed)
        is_refuted = found.is_contradicted and not found.holds
        return replace(found, unstated_m=self._unstated_m()) if is_refuted else found

    def patterns(self) -> Iterator[LinePattern]:
        """Yield wavy swaths, and straight ones that end before the border.

        Yields
        ------
        LawnmowerConfig or WavyConfig
            With one swath.
        """
        # Settings are metres on the ground, the posterior's lengths grid metres.
        slope_length_m = self.posterior.slope_length_m / settings_factor(self.predictor.area)
        wavelength_m = WavyConfig(swaths=1).wavelength_scales * slope_length_m
        yield WavyConfig(swaths=1, wavelength_m=wavelength_m, heading_deg=self.heading_deg)
        yield LawnmowerConfig(swaths=1, inset_share=0.5, heading_deg=self.heading_deg)

    def _proven(
        self, shape: LinePattern, n: int, simulated: SimulatedSurveys, *, may_grow: bool
    ) -> Guarantee:
        """Try a survey in simulation, and denser ones where it contradicts the prediction."""
        rest = [count for count in self.counts if count >= n][: _MOST_TRIALS if may_grow else 1]
        for count in rest:
            errors = simulated.errors(self._route(shape, count)[1])
            result = self._guarantee(shape, count, errors)
            if result.holds:
                break
        return result

    def _guarantee(self, shape: LinePattern, n: int, errors: SimulatedErrors) -> Guarantee:
        """Return what is predicted and simulated for so many swaths of a pattern."""
        config, route = self._route(shape, n)
        requirement, likely = self.requirement, replace(self, posterior=self._likely)
        predicted = self._predicted(self._distribution(shape, n))
        fewer = likely.fewest(shape) or n
        stakes = self._stakes(shape, n, route) if predicted.probability >= requirement.probability else None
        return Guarantee(
            route,
            config,
            requirement,
            self.posterior,
            predicted,
            self._predicted(likely._distribution(shape, n)),
            min(fewer, n),
            errors,
            self._least_reachable_m,
            stakes,
        )

    def _unstated_m(self) -> float:
        """Return the error that the densest survey reaches on ground of no stated class [m]."""
        unstated = replace(self.requirement, surface="unknown")
        posterior = posterior_in_grid(self.predictor.area, self.prior, unstated)
        return replace(self, requirement=unstated, posterior=posterior)._least_reachable_m

    @property
    def _least_reachable_m(self) -> float:
        """Least error that the densest survey of a pattern stays within with the required probability [m]."""
        return min(self._reachable_m(one) for one in self.patterns())

    def _reachable_m(self, shape: LinePattern) -> float:
        """Return the error that the densest survey of a pattern stays within with the required probability [m]."""
        return self._distribution(shape, self.counts[-1]).quantile_m(self.requirement.probability)

    @property
    def _likely(self) -> KernelPosterior:
        """The likeliest covariance alone."""
        return KernelPosterior.of([self.posterior.likeliest])

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
        key = shape.pattern, n, self.posterior.kernels
        if key not in self._known:
            xy = places(self._route(shape, n)[1], self.requirement.sample_step_m)
            self._known[key] = self.predictor.distribution(xy, self.posterior)
        known = replace(
            self._known[key], spread=self.posterior.spread, open_spread=self.posterior.open_spread
        )
        return known.with_shared(self.requirement.shared_m)

    def _route(self, shape: LinePattern, n: int) -> tuple[LinePattern, Route]:
        config = shape.model_copy(update={"swaths": n})
        if (shape.pattern, n) not in self._routes:
            self._routes[shape.pattern, n] = planned_on(self.site, self.predictor.area, config)
        return config, self._routes[shape.pattern, n]
