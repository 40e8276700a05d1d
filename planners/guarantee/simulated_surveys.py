"""Surveys of simulated ground, on which plans are tried.

`SimulatedSurveys` draws ground that agrees with the cells of the prior and is not drawn from the posterior, and maps it
from the samples of a route with errors. Three kinds are drawn:

- heavy tails: a field of the covariance times a Student factor of four degrees of freedom, one for each surface;
- changing roughness: a field of the covariance whose amplitude changes from place to place by a factor of about 1.5;
- resampled relief: the prior's own relief, shrunk to half, a quarter, … of its size and laid over itself, which has
  ridges, gullies and flats where a Gaussian field has none.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import shapely
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.spatial.distance import cdist
from scipy.special import betaincinv

from planners.guarantee.requirement import MapRequirement
from planners.prediction.error_model import ErrorModel
from planners.prediction.places import places, spread_places
from planners.prediction.prior_cells import PriorCells, mean_of_four
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
        low = float(betaincinv(n_met, n - n_met + 1, 1.0 - _CONFIDENCE)) if n_met else 0.0
        high = float(betaincinv(n_met + 1, n - n_met, _CONFIDENCE)) if n_met < n else 1.0
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

    def errors(self, route: Route, progress: Progress | None = None) -> SimulatedErrors:
        """Return the error of the map of simulated surveys: of more of them until they show whether it is met.

        There are `n_simulations` of them, and as many again while the confidence limits of their share lie on both sides
        of the required probability: up to four times as many, or as many as show it where none misses.
        """
        limit_m, probability = self.requirement.limit_m, self.requirement.probability
        n = self.requirement.n_simulations
        xy = self._near(places(route, self.requirement.sample_step_m))
        needed = np.log(1.0 - _CONFIDENCE) / np.log(min(probability, _MOST_SHOWN))
        most = max(_MOST_BATCHES * n, int(np.ceil(needed)))
        found = SimulatedErrors(np.empty(0), ())
        for first in range(0, most, n):
            if progress is not None:
                progress("simulating surveys", first, most)
            found = found.and_more(self._surveyed(xy, first, n))
            if found.prove(limit_m, probability) or found.bounds(limit_m)[1] < probability:
                break
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
