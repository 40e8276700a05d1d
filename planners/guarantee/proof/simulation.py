"""Simulated surveys of ground that agrees with the cells of a prior and is not drawn from the belief about it."""

from typing import NamedTuple

import numpy as np
import shapely
from scipy.stats import binom

from planners.guarantee.belief.kernel_posterior import KernelPosterior, WeightedKernel
from planners.guarantee.proof.grounds import GROUNDS
from planners.guarantee.requirement import MapRequirement
from planners.prediction.error_model import places
from planners.prediction.prior_cover import cell_centres
from survey.core.arrays import FloatArray
from survey.core.streams import stream
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.data.route import Route
from survey.reconstruction.gp.selection.common_maps import mapped
from survey.reconstruction.gp.selection.kernel_search import ALL, KernelSearch
from survey.terrain.conditional import CoarseCells, ConditionalTerrain

_NODES_ALONG = 16
_STEPS_ALONG = 60
_CELLS_ALONG = 16
_MOST_SAMPLES = 900
_LEARNED = 80
_DOUBTFUL = 0.05


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

    def contradict(self, limit_m: float, probability: float) -> bool:
        """Return whether so many surveys miss the limit as happens by chance once in twenty times."""
        missed = int(np.sum(self.rmse_m > limit_m))
        return bool(binom.sf(missed - 1, len(self.rmse_m), 1.0 - probability) < _DOUBTFUL)


class SimulatedSurveys:
    """Ground of three kinds on which routes are tried; of a large area, on a square of 16 cells in its midst."""

    def __init__(
        self, area: SurveyArea, prior: Dem, posterior: KernelPosterior, requirement: MapRequirement
    ) -> None:
        self.requirement = requirement
        self.part = _part(area, prior)
        xmin, ymin, xmax, ymax = self.part.bounds
        self.nodes = cell_centres(self.part, _NODES_ALONG)
        step_m = max(xmax - xmin, ymax - ymin) / _STEPS_ALONG
        cells = CoarseCells(_cells_on(self.part, prior), requirement.prior_sigma_m)
        grid = Grid.over((xmin, ymin, xmax, ymax), step_m, area.crs)
        worlds: dict[WeightedKernel, ConditionalTerrain] = {}
        self.weighted: list[WeightedKernel] = []
        self.terrains: list[Dem] = []
        names = list(GROUNDS)
        self.grounds = tuple(names[index % len(names)] for index in range(requirement.n_simulations))
        for index, name in enumerate(self.grounds):
            rng = stream(requirement.seed, "promise", index)
            one = posterior.draw(rng)
            world = worlds.setdefault(one, ConditionalTerrain(cells, one.kernel, grid))
            self.weighted.append(one)
            self.terrains.append(GROUNDS[name](world, one.kernel, rng))
        self.actual = np.column_stack([terrain.at(self.nodes) for terrain in self.terrains])

    def errors(self, route: Route) -> SimulatedErrors:
        """Return the error of the map of each simulated survey."""
        xy = self._near(places(route, self.requirement.sample_step_m))
        heights = np.column_stack([terrain.at(xy) for terrain in self.terrains])
        actual = self.actual.copy()
        for column, one in enumerate(self.weighted):
            rng = stream(self.requirement.seed, "promise", column, "samples", len(xy))
            heights[:, column] += one.noise_m * rng.standard_normal(len(xy))
            heights[:, column] += self.requirement.shared_m * rng.standard_normal()
            actual[:, column] += np.sqrt(one.unseen_m2) * rng.standard_normal(len(actual))
        noise_m = float(np.median([one.noise_m for one in self.weighted]))
        found = KernelSearch(xy, heights, noise_m, ALL, most=_LEARNED).found()
        mean, _ = mapped(xy, heights, found, self.nodes)
        return SimulatedErrors(np.sqrt(np.mean(np.square(mean - actual), axis=0)), self.grounds)

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
