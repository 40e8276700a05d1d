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

`SimulatedSurveys` draws ground that agrees with the cells of the prior and is not drawn from the posterior, and maps it
from the samples of a route with errors. Three kinds are drawn:

- heavy tails: a field of the covariance times a Student factor of four degrees of freedom, one for each surface;
- changing roughness: a field of the covariance whose amplitude changes from place to place by a factor of about 1.5;
- resampled relief: the prior's own relief, shrunk to half, a quarter, … of its size and laid over itself, which has
  ridges, gullies and flats where a Gaussian field has none.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
import shapely
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.spatial.distance import cdist
from scipy.stats import beta
from threadpoolctl import threadpool_limits

from planners.config import settings_factor
from planners.guarantee.requirement import MapRequirement
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
from planners.prediction.places import places, spread_places
from planners.prediction.prior_cells import PriorCells, mean_of_four
from planners.routes.traversability import Drivable, drivable
from survey import Dem, Grid, Route, SurveyArea
from survey.core import FloatArray, Progress, stream
from survey.reconstruction.gp.kernel_search import ALL, Cell, FoundKernel, KernelSearch
from survey.reconstruction.gp.kernels import SquaredExponential, Stationary
from survey.terrain.random_fields import CoarseCells, ConditionalTerrain, kernel_field

_FREEDOM = 4.0
_LOG_AMPLITUDE = 0.4
_N_OCTAVES = 4

Ground = Callable[[ConditionalTerrain, Stationary, np.random.Generator], Dem]
"""Draws one surface on the nodes of a conditional terrain."""


def heavy_tailed(world: ConditionalTerrain, kernel: Stationary, rng: np.random.Generator) -> Dem:
    """Draw a field of the covariance times a Student factor."""
    factor = np.sqrt((_FREEDOM - 2.0) / rng.chisquare(_FREEDOM))
    return world.conditioned(Dem.on(world.wide, factor * kernel_field(world.wide, rng, kernel)), rng)


def changing_roughness(world: ConditionalTerrain, kernel: Stationary, rng: np.random.Generator) -> Dem:
    """Draw a field of the covariance whose amplitude changes from place to place."""
    xmin, ymin, xmax, ymax = world.wide.bounds
    slow = SquaredExponential(_LOG_AMPLITUDE**2, 0.25 * max(xmax - xmin, ymax - ymin))
    amplitude = np.exp(kernel_field(world.wide, rng, slow) - _LOG_AMPLITUDE**2)
    return world.conditioned(Dem.on(world.wide, amplitude * kernel_field(world.wide, rng, kernel)), rng)


def resampled(world: ConditionalTerrain, kernel: Stationary, rng: np.random.Generator) -> Dem:
    """Lay shrunk copies of the prior's relief over one another, as rough as the covariance over half a cell."""
    relief = _relief(world.cells)
    heights = np.zeros(world.wide.shape)
    # Copies of half the size have the amplitude that the smoothness of the covariance asks for.
    smoothness = 0.5 * ((kernel.error_growth or 3.0) - 1.0)
    for octave in range(1, _N_OCTAVES + 1):
        heights += 2.0 ** (-smoothness * octave) * _shrunk(relief, world, 2.0**octave, rng)
    lag_m = 0.5 * world.cells.prior.step_m
    n = max(round(lag_m / world.wide.step_m), 1)
    found = np.mean(np.square(heights[n:] - heights[:-n]))
    lag = np.array([n * world.wide.step_m, 0.0])
    wanted = 2.0 * (kernel.variance_m2 - float(kernel.covariance_of_lag(lag)))
    factor = np.sqrt(wanted / found) if found > 0.0 else 0.0
    return world.conditioned(Dem.on(world.wide, factor * heights), rng)


RESAMPLED = "resampled relief"
"""Name of the ground that repeats the relief of the prior."""

GROUNDS: dict[str, Ground] = {
    "heavy tails": heavy_tailed,
    "changing roughness": changing_roughness,
    RESAMPLED: resampled,
}
"""Kinds of simulated ground by name."""


def _relief(cells: CoarseCells) -> FloatArray:
    """Return the smoothed heights (R, C) of the prior about their plane [m]; unknown cells lie on the plane."""
    prior = cells.prior
    row, column = np.indices(prior.shape)
    known = np.isfinite(prior.elevation)
    basis = np.stack([np.ones(prior.shape), row, column], axis=-1)
    plane = np.linalg.lstsq(basis[known], prior.elevation[known], rcond=None)[0]
    relief = np.where(known, prior.elevation - basis @ plane, 0.0)
    # Errors of single cells are no relief.
    smoothed: FloatArray = gaussian_filter(relief, 1.0, mode="nearest")
    return smoothed


def _shrunk(
    relief: FloatArray, world: ConditionalTerrain, times: float, rng: np.random.Generator
) -> FloatArray:
    """Return relief at the nodes, shrunk so many times, mirrored at its borders, turned and moved by chance."""
    turned = np.rot90(relief, int(rng.integers(4)))
    start = rng.uniform(0.0, 2.0, 2) * turned.shape
    per_node = times * _node_cells(world.wide, world.cells.prior)
    rows, columns = np.indices(world.wide.shape) * per_node
    shrunk: FloatArray = map_coordinates(
        turned, [rows + start[0], columns + start[1]], order=3, mode="mirror"
    )
    return shrunk


def _node_cells(grid: Grid, prior: Dem) -> float:
    """Return the distance of neighbouring nodes in cells of the prior."""
    return grid.step_m / prior.step_m


_N_NODES = 256
_STEPS_ALONG = 60
_CELLS_ALONG = 16
_MOST_SAMPLES = 900
_LEARNED = 80
_CONFIDENCE = 0.9
_MOST_BATCHES = 4
# The highest probability that is asked of simulated surveys: 230 of them show it where none misses.
_MOST_SHOWN = 0.99


class SimulatedErrors(NamedTuple):
    """Error of the map of each simulated survey (S,) [m], and the kind of ground (S,) of each."""

    rmse_m: FloatArray
    grounds: tuple[str, ...]

    def share(self, limit_m: float, ground: str | None = None) -> float:
        """Return the share of the surveys, of all or of one kind of ground, whose map met a limit."""
        chosen = [
            error
            for error, name in zip(self.rmse_m, self.grounds, strict=True)
            if ground is None or name == ground
        ]
        return float(np.mean(np.array(chosen) <= limit_m))

    def median_m(self, ground: str) -> float:
        """Return the median error of the surveys of one kind of ground [m]."""
        chosen = [one for one, name in zip(self.rmse_m, self.grounds, strict=True) if name == ground]
        return float(np.median(chosen))

    def bounds(self, limit_m: float) -> tuple[float, float]:
        """Return the one-sided confidence limits of 90 % of the share that meets a limit (Clopper and Pearson 1934)."""
        n = len(self.rmse_m)
        n_met = int(np.sum(self.rmse_m <= limit_m))
        low = float(beta.ppf(1.0 - _CONFIDENCE, n_met, n - n_met + 1)) if n_met else 0.0
        high = float(beta.ppf(_CONFIDENCE, n_met + 1, n - n_met)) if n_met < n else 1.0
        return low, high

    def prove(self, limit_m: float, probability: float) -> bool:
        """Return whether the lower confidence limit of the share is the probability or more.

        Of a probability above 99 % they have to show 99 %.
        """
        return self.bounds(limit_m)[0] >= min(probability, _MOST_SHOWN)

    def and_more(self, others: "SimulatedErrors") -> "SimulatedErrors":
        """Return these surveys and others."""
        return SimulatedErrors(np.append(self.rmse_m, others.rmse_m), self.grounds + others.grounds)


class _Drawn(NamedTuple):
    """One surface: its kind, the terrain, and its heights at the nodes (M,) [m]."""

    name: str
    terrain: Dem
    actual: FloatArray


class SimulatedSurveys:
    """Ground of three kinds on which routes are tried; of a large area, on a square of 16 cells at its centre.

    It is as rough as the likeliest covariance of the posterior: how much rougher it may be is a part of the prediction.
    What these surveys show is whether ground of another kind is mapped as well as predicted.
    """

    def __init__(self, model: ErrorModel, prior: Dem, requirement: MapRequirement) -> None:
        self.requirement = requirement
        self.part = _part(model.area, prior)
        xmin, ymin, xmax, ymax = self.part.bounds
        self.nodes = spread_places(self.part, _N_NODES)
        step_m = max(xmax - xmin, ymax - ymin) / _STEPS_ALONG
        shown = _cells_on(self.part, prior)
        cells = CoarseCells(shown, requirement.prior_sigma_m)
        self._cells = PriorCells.of(shown, self.part, requirement.prior_sigma_m)
        self._weighted = model.posterior.likeliest
        grid = Grid.over((xmin, ymin, xmax, ymax), step_m, model.area.crs)
        self._world = ConditionalTerrain(cells, self._weighted.kernel, grid)
        self._drawn: list[_Drawn] = []

    def errors(self, route: Route) -> SimulatedErrors:
        """Return the error of the map of simulated surveys: of more of them until they show whether it is met.

        There are `n_simulations` of them, and as many again while the confidence limits of their share lie on both sides
        of the required probability: up to four times as many, or as many as show it where none misses.
        """
        limit_m, probability = self.requirement.limit_m, self.requirement.probability
        n = self.requirement.n_simulations
        xy = self._near(places(route, self.requirement.sample_step_m))
        found = self._surveyed(xy, 0, n)
        needed = np.log(1.0 - _CONFIDENCE) / np.log(min(probability, _MOST_SHOWN))
        most = max(_MOST_BATCHES * n, int(np.ceil(needed)))
        while len(found.rmse_m) < most and not found.prove(limit_m, probability):
            if found.bounds(limit_m)[1] < probability:
                break
            found = found.and_more(self._surveyed(xy, len(found.rmse_m), n))
        return found

    def _surveyed(self, xy: FloatArray, first: int, n: int) -> SimulatedErrors:
        """Return the errors of some surveys, of samples at places (N, 2) [m]."""
        drawn = [self._ground(index) for index in range(first, first + n)]
        heights = np.column_stack([one.terrain.at(xy) for one in drawn])
        actual = np.column_stack([one.actual for one in drawn])
        one = self._weighted
        for column in range(n):
            rng = stream(self.requirement.seed, "promise", first + column, "samples", len(xy))
            heights[:, column] += one.noise_m * rng.standard_normal(len(xy))
            heights[:, column] += self.requirement.shared_m * rng.standard_normal()
            actual[:, column] += np.sqrt(one.unseen_m2) * rng.standard_normal(len(actual))
        found = KernelSearch(xy, heights, one.noise_m, ALL, most=_LEARNED).search()
        mean = self._mapped(xy, heights, found)
        rmse_m = np.sqrt(np.mean(np.square(mean - actual), axis=0))
        return SimulatedErrors(rmse_m, tuple(one.name for one in drawn))

    def _mapped(self, xy: FloatArray, heights: FloatArray, found: list[FoundKernel]) -> FloatArray:
        """Return the maps (M, B) of B surveys of the same places, each with its kernel and with the cells of the prior."""
        mean = np.empty((len(self.nodes), heights.shape[1]))
        level_m = np.broadcast_to(self._world.cells.height_m[:, None], (len(self._cells), heights.shape[1]))
        for cell in dict.fromkeys(one.cell for one in found):
            mine = [b for b, one in enumerate(found) if one.cell == cell]
            errors = self._cells.covariance / float(np.mean([found[b].variance_m2 for b in mine]))
            mean[:, mine] = self._mapped_alike(xy, np.vstack([heights, level_m])[:, mine], cell, errors)
        return mean

    def _mapped_alike(self, xy: FloatArray, values: FloatArray, cell: Cell, errors: FloatArray) -> FloatArray:
        """Return the maps (M, B) from heights of samples and cells (N + C, B), whose errors are in variances of the terrain."""

        def between(a: FloatArray, b: FloatArray) -> FloatArray:
            return cell.correlation(cdist(a, b, "sqeuclidean"))

        within, n = self._cells.nodes, len(xy)
        with_xy, with_cells = mean_of_four(between(within, xy)), mean_of_four(between(within, within))
        matrix = np.block([[between(xy, xy), with_xy.T], [with_xy, mean_of_four(with_cells.T) + errors]])
        matrix[np.arange(n), np.arange(n)] += 2.0**cell.ratio
        solved = np.linalg.solve(matrix, np.column_stack([np.ones(len(matrix)), values]))
        centre = solved[:, 1:].sum(axis=0) / solved[:, 0].sum()
        weights = solved[:, 1:] - np.outer(solved[:, 0], centre)
        across = np.hstack([between(self.nodes, xy), mean_of_four(between(within, self.nodes)).T])
        mapped: FloatArray = centre + across @ weights
        return mapped

    def _ground(self, index: int) -> "_Drawn":
        """Return the surface of a survey; drawn once for all routes."""
        names = list(GROUNDS)
        while len(self._drawn) <= index:
            rng = stream(self.requirement.seed, "promise", len(self._drawn))
            name = names[len(self._drawn) % len(names)]
            one = self._weighted
            terrain = GROUNDS[name](self._world, one.cell.kernel(one.variance_m2), rng)
            self._drawn.append(_Drawn(name, terrain, terrain.at(self.nodes)))
        return self._drawn[index]

    def _near(self, xy: FloatArray) -> FloatArray:
        """Return the samples on the part of the area that is simulated, every k-th where there are many."""
        xmin, ymin, xmax, ymax = self.part.bounds
        inside = (xy >= [xmin, ymin]).all(axis=1) & (xy <= [xmax, ymax]).all(axis=1)
        near = xy[inside]
        every: FloatArray = near[:: max(int(np.ceil(len(near) / _MOST_SAMPLES)), 1)]
        return every


def _part(area: SurveyArea, prior: Dem) -> SurveyArea:
    """Return the area, or of a large one the part in a square of 16 cells about a place well inside."""
    xmin, ymin, xmax, ymax = area.bounds
    side_m = _CELLS_ALONG * prior.step_m
    if max(xmax - xmin, ymax - ymin) <= 1.5 * side_m:
        return area
    place = shapely.maximum_inscribed_circle(area.free, 0.02 * max(xmax - xmin, ymax - ymin)).coords[0]
    half = 0.5 * side_m
    square = shapely.box(place[0] - half, place[1] - half, place[0] + half, place[1] + half)
    parts = shapely.get_parts(area.free.intersection(square))
    largest = max(parts, key=lambda part: float(part.area))
    return SurveyArea(largest, area.crs)


def _cells_on(area: SurveyArea, prior: Dem) -> Dem:
    """Return the cells of the prior on an area."""
    half = 0.5 * prior.step_m
    xmin, ymin, xmax, ymax = area.bounds
    return prior.window((xmin - half, ymin - half, xmax + half, ymax + half))


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
    [m]; it does not depend on the limit. `stakes`: stakes that save swaths, where errors that samples share
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
            swath_counts(width_m, prior.step_m, requirement),
        )

    def fewest(self, shape: LinePattern) -> int | None:
        """Return the fewest swaths of a pattern that are predicted to be enough; None where none are."""
        wanted, limit_m = self.requirement.probability, self.requirement.limit_m

        def is_enough(index: int) -> bool:
            return self._distribution(shape, self.counts[index - 1]).probability(limit_m) >= wanted

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
                progress("predicting patterns", done, len(shapes) + 1)
            n = self.fewest(shape)
            route = self._route(shape, n or self.counts[-1])[1]
            reached_m = 0.0 if n else self._reachable_m(shape)
            tried.append((n is None, reached_m, n or self.counts[-1], route.length_m, shape))
        if progress is not None:
            progress("simulating surveys", len(shapes), len(shapes) + 1)
        is_missed, _, n, _, shape = min(tried, key=lambda one: one[:4])
        simulated = SimulatedSurveys(self.model, self.prior, self.requirement)
        found = self._proven(shape, n, simulated, may_grow=not is_missed)
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
            stakes,
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
        posterior = self.model.posterior
        key = shape.pattern, n, posterior.kernels
        if key not in self._known:
            xy = places(self._route(shape, n)[1], self.requirement.sample_step_m)
            self._known[key] = self.model.predictor.distribution(xy, posterior)
        known = replace(self._known[key], spread=posterior.spread, open_spread=posterior.open_spread)
        return known.with_shared(self.requirement.shared_m)

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
