"""Simulated surveys of ground that agrees with the cells of a prior and is not drawn from the posterior."""

from typing import NamedTuple

import numpy as np
import shapely
from scipy.stats import beta

from planners.guarantee.posterior.kernel_posterior import KernelPosterior
from planners.guarantee.proof.grounds import GROUNDS
from planners.guarantee.requirement import MapRequirement
from planners.prediction.error_model import places
from planners.prediction.map_places import spread_places
from survey.core.arrays import FloatArray
from survey.core.streams import stream
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.data.route import Route
from survey.reconstruction.gp.kernel_search import ALL, KernelSearch, mapped
from survey.terrain.random_fields import CoarseCells, ConditionalTerrain

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

    def __init__(
        self, area: SurveyArea, prior: Dem, posterior: KernelPosterior, requirement: MapRequirement
    ) -> None:
        self.requirement = requirement
        self.part = _part(area, prior)
        xmin, ymin, xmax, ymax = self.part.bounds
        self.nodes = spread_places(self.part, _N_NODES)
        step_m = max(xmax - xmin, ymax - ymin) / _STEPS_ALONG
        cells = CoarseCells(_cells_on(self.part, prior), requirement.prior_sigma_m)
        self._weighted = posterior.likeliest
        grid = Grid.over((xmin, ymin, xmax, ymax), step_m, area.crs)
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
        found = KernelSearch(xy, heights, one.noise_m, ALL, most=_LEARNED).found()
        mean, _ = mapped(xy, heights, found, self.nodes)
        rmse_m = np.sqrt(np.mean(np.square(mean - actual), axis=0))
        return SimulatedErrors(rmse_m, tuple(one.name for one in drawn))

    def _ground(self, index: int) -> "_Drawn":
        """Return the surface of a survey; drawn once for all routes."""
        names = list(GROUNDS)
        while len(self._drawn) <= index:
            rng = stream(self.requirement.seed, "promise", len(self._drawn))
            name = names[len(self._drawn) % len(names)]
            terrain = GROUNDS[name](self._world, self._weighted.kernel, rng)
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
