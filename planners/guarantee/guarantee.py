r"""A promise before the survey: this map class, with this probability, or a refusal.

A prior's cells leave open how rough the terrain is between them. So the promise rests on the roughest family
of covariances that they do not exclude (`cautious_belief`), or on one that is known and named: it gives the
chance that a pattern keeps the limit; the shortest pattern that is sure enough is then tried on terrain drawn from
that belief so that it agrees with the cells: sampled with the sensor's errors, mapped by a Gaussian process fitted
anew, and judged. Only what also passes there is promised.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache

import numpy as np
from threadpoolctl import threadpool_limits

from planners.config import LawnmowerConfig, WavyConfig
from planners.ground.transit import FreeGround
from planners.guarantee.assurance import (
    LEARNED,
    Assurance,
    Assured,
    Believed,
    KernelPosterior,
    belief_from_prior,
    cautious_belief,
    fewest,
)
from planners.planning import plan
from planners.prediction.predict import places
from planners.swaths.heading import across_marked_grain
from survey.core.arrays import FloatArray
from survey.core.errors import ConfigError, InputError
from survey.core.streams import stream
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.data.route import Route
from survey.reconstruction.gp.selection.kernel_search import ALL, KernelSearch, SearchedFamily, mapped
from survey.scoring.standards.standards import map_classes
from survey.terrain.conditional import CoarseCells, ConditionalTerrain

_MOST_SWATHS = 30
_STEP_M = 10.0
_NODES_ALONG = 30

LinePattern = LawnmowerConfig | WavyConfig


@dataclass(frozen=True)
class MapRequirement:
    """What is to be promised, and what the samples will err.

    Parameters
    ----------
    limit_m : float
        Largest root mean square error of the map [m].
    probability : float
        How sure it is to be, above 0 and below 1.
    noise_m, localization_m : float
        Standard deviation of a sample's height, and of the rover's place east and north [m].
    sample_step_m : float
        Distance between samples [m].
    prior_sigma_m : float
        Standard deviation of a cell of the prior [m].
    n_simulations : int
        Surveys that are tried on simulated terrain.
    seed : int
        Of the simulated terrain.
    assumed : str, optional
        Family of the terrain's covariance, where it is known; else the roughest that the prior does not exclude.

    Raises
    ------
    ConfigError
        A number out of its range.
    """

    limit_m: float
    probability: float = 0.9
    noise_m: float = 0.1
    localization_m: float = 0.0
    sample_step_m: float = 10.0
    prior_sigma_m: float = 1.0
    n_simulations: int = 100
    seed: int = 0
    assumed: SearchedFamily | None = None

    def __post_init__(self) -> None:
        if not 0.0 < self.probability < 1.0:
            raise ConfigError(
                f"the probability is {self.probability}; give a number between 0 and 1, e.g. 0.9."
            )
        for name in ("limit_m", "sample_step_m"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0.0):
                raise ConfigError(f"{name} is {getattr(self, name)}; it must be greater than 0.")
        for name in ("noise_m", "localization_m", "prior_sigma_m"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) >= 0.0):
                raise ConfigError(f"{name} is {getattr(self, name)}; it must be 0 or greater.")
        if self.assumed is not None and self.assumed not in ALL:
            raise ConfigError(
                f"{self.assumed} is no family of covariances that can be assumed; take {', '.join(ALL)}."
            )
        if self.n_simulations < 10:
            raise ConfigError(f"{self.n_simulations} simulations cannot tell a probability; take 10 or more.")


@dataclass(frozen=True)
class Promise:
    """A route, and what it promises as far as the belief is right.

    ``predicted`` follows from the covariances alone; ``simulated_share`` of the simulated surveys met the limit, with
    errors of ``simulated_rmse_m``. ``likely`` is what is predicted where the terrain is no rougher than the prior makes
    likeliest. A promise that does not hold carries the densest pattern tried.
    """

    route: Route
    config: LinePattern
    wanted: MapRequirement
    belief: KernelPosterior
    predicted: Assured
    likely: Assured
    simulated_share: float
    simulated_rmse_m: FloatArray = field(repr=False)

    @property
    def holds(self) -> bool:
        """Whether prediction and simulation both are as sure as was wanted."""
        return min(self.predicted.probability, self.simulated_share) >= self.wanted.probability

    @property
    def reachable_m(self) -> float:
        """The error that this route keeps with the wanted probability in the simulated surveys [m]."""
        return float(np.quantile(self.simulated_rmse_m, self.wanted.probability, method="higher"))

    @property
    def assumptions(self) -> str:
        """What was assumed of the terrain, in one line."""
        best = self.belief.likeliest
        why = "as stated" if self.wanted.assumed else "the roughest family that the prior does not exclude"
        return (
            f"covariance {best.cell.family}, {why}; learned from the prior: length scale {best.cell.length_scale_m:.0f} m, "
            f"standard deviation {np.sqrt(best.variance_m2):.1f} m; a sample errs by {best.noise_m:.2f} m"
        )


def promise(area: SurveyArea, prior: Dem, wanted: MapRequirement) -> Promise:
    """Find the shortest survey that promises a map error, by prediction and by simulation.

    Parameters
    ----------
    area : SurveyArea
        What is to be mapped.
    prior : Dem
        Coarse elevations over the area, in its CRS.
    wanted : Wanted
        What is to be promised.

    Returns
    -------
    Promise
        Ask whether it `holds`; one that does not tells what is reachable.

    Raises
    ------
    InputError
        A prior in another CRS, or with too few or too many cells on the area; an area that no swath meets.

    Notes
    -----
    The map is a Gaussian process fitted to the survey alone. Relief finer than the prior's
    cells is extrapolated through the roughest of four families of covariance that the cells do not exclude: on smooth
    terrain that is more swaths than it takes. A survey that plans itself while it is driven (`planners.guarantee.adaptive`) learns
    the family from the first swaths instead. Small relief upon a smooth surface, which no cell shows, and errors that
    samples share are not in it. Swaths run across a marked grain of the prior.
    """
    with threadpool_limits(1):
        cells = _cells(area, prior, wanted)
        errors = {"noise_m": wanted.noise_m, "localization_m": wanted.localization_m}
        belief = cautious_belief(cells, **errors, assumed=wanted.assumed)
        likely = (
            belief if wanted.assumed else KernelPosterior.of([belief_from_prior(cells, **errors).likeliest])
        )
        proving_ground = _ProvingGround(area, cells, belief, wanted)
        assurance = Assurance(area, wanted.limit_m, wanted.sample_step_m, LEARNED)
        best: Promise | None = None
        # A covariance that is alike in all directions is blind to ridges that run beside the swaths.
        heading_deg = across_marked_grain(FreeGround(area.free), prior)
        for shape in _patterns(belief, heading_deg):
            tried = _proven(shape, assurance, (belief, likely), proving_ground, wanted)
            if best is None or _is_better(tried, best):
                best = tried
    if best is None:
        raise InputError("no swath meets the free ground of the area; give another area.")
    return best


def reachable_class(rmse_m: float) -> str | None:
    """Return the strictest row of the paper's tables that an error meets, in words; None where it meets none."""
    met = [row for row in map_classes() if rmse_m <= row.limit_m]
    return (
        f"{met[-1].map_class} at a {met[-1].interval_m:.4g} m interval ({met[-1].limit_m:.4f} m)"
        if met
        else None
    )


def belief_of(area: SurveyArea, prior: Dem, wanted: MapRequirement) -> KernelPosterior:
    """Return what the cells of a prior tell of the terrain of an area."""
    cells = _cells(area, prior, wanted)
    return belief_from_prior(cells, noise_m=wanted.noise_m, localization_m=wanted.localization_m)


def _cells(area: SurveyArea, prior: Dem, wanted: MapRequirement) -> CoarseCells:
    area.require_crs(prior.crs, "the prior")
    half = 0.5 * prior.step_m
    xmin, ymin, xmax, ymax = area.bounds
    return CoarseCells(
        prior.window((xmin - half, ymin - half, xmax + half, ymax + half)), wanted.prior_sigma_m
    )


def _is_better(one: Promise, other: Promise) -> bool:
    """Tell the better promise: one that holds, then the shorter; of two that fail, the surer."""
    if one.holds != other.holds:
        return one.holds
    if one.holds:
        return one.route.length_m < other.route.length_m
    return one.predicted.probability > other.predicted.probability


def _patterns(belief: KernelPosterior, heading_deg: float) -> Iterator[LinePattern]:
    """Wavy swaths, and straight ones that end before the border."""
    wavelength_m = WavyConfig(swaths=1).wavelength_scales * belief.slope_length_m
    yield WavyConfig(swaths=1, wavelength_m=wavelength_m, heading_deg=heading_deg)
    yield LawnmowerConfig(swaths=1, inset_share=0.5, heading_deg=heading_deg)


def _proven(
    shape: LinePattern,
    assurance: Assurance,
    beliefs: tuple[KernelPosterior, KernelPosterior],
    ground: "_ProvingGround",
    wanted: MapRequirement,
) -> Promise:
    """Return the fewest swaths of a shape that are predicted to do, and more where the simulation wants more."""
    belief, likely = beliefs

    @cache
    def predicted(n: int) -> tuple[LinePattern, Route, Assured]:
        sized = shape.model_copy(update={"swaths": n})
        route = plan(assurance.area, None, sized)
        return sized, route, assurance.of(places(route, wanted.sample_step_m), belief)

    n = (
        fewest(lambda n: predicted(n)[2].probability >= wanted.probability, first=4, most=_MOST_SWATHS)
        or _MOST_SWATHS
    )
    while True:
        sized, route, assured = predicted(n)
        errors = ground.errors(route)
        result = Promise(
            route,
            sized,
            wanted,
            belief,
            assured,
            assurance.of(places(route, wanted.sample_step_m), likely),
            float(np.mean(errors <= wanted.limit_m)),
            errors,
        )
        if result.holds or n >= _MOST_SWATHS:
            return result
        n = min(n + max(n // 8, 1), _MOST_SWATHS)


class _ProvingGround:
    """Terrain drawn from a belief so that it agrees with the prior's cells, on which routes are tried."""

    def __init__(
        self, area: SurveyArea, cells: CoarseCells, belief: KernelPosterior, wanted: MapRequirement
    ) -> None:
        self.wanted = wanted
        xmin, ymin, xmax, ymax = area.bounds
        self.nodes = self._nodes(area)
        grid = Grid.over((xmin, ymin, xmax, ymax), min(_STEP_M, (xmax - xmin) / 20.0), area.crs)
        worlds: dict[Believed, ConditionalTerrain] = {}
        self.believed, self.terrains = [], []
        for index in range(wanted.n_simulations):
            rng = stream(wanted.seed, "promise", index)
            one = belief.draw(rng)
            world = worlds.setdefault(one, ConditionalTerrain(cells, one.kernel, grid))
            self.believed.append(one)
            self.terrains.append(world.draw(rng))
        self.actual = np.column_stack([terrain.at(self.nodes) for terrain in self.terrains])

    def errors(self, route: Route) -> FloatArray:
        """Return the root mean square error (n_simulations,) of the map of each simulated survey [m]."""
        xy = places(route, self.wanted.sample_step_m)
        heights = np.column_stack([terrain.at(xy) for terrain in self.terrains])
        for column, one in enumerate(self.believed):
            rng = stream(self.wanted.seed, "promise", column, "samples", len(xy))
            heights[:, column] += one.noise_m * rng.standard_normal(len(xy))
        found = KernelSearch(
            xy, heights, float(np.median([one.noise_m for one in self.believed])), ALL
        ).found()
        mean, _ = mapped(xy, heights, found, self.nodes)
        errors: FloatArray = np.sqrt(np.mean((mean - self.actual) ** 2, axis=0))
        return errors

    def _nodes(self, area: SurveyArea) -> FloatArray:
        """Centres (M, 2) of thirty cells along the longer side, as far as they lie on the free ground."""
        xmin, ymin, xmax, ymax = area.bounds
        cell = max(xmax - xmin, ymax - ymin) / _NODES_ALONG
        x, y = np.arange(xmin + 0.5 * cell, xmax, cell), np.arange(ymin + 0.5 * cell, ymax, cell)
        nodes = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        inside: FloatArray = nodes[area.contains(nodes)]
        return inside
