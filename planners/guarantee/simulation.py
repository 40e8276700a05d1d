"""Simulated surveys of terrain that agrees with the cells of a prior."""

import numpy as np

from planners.capacity import MOST_SAMPLES, require_samples
from planners.guarantee.kernel_posterior import KernelPosterior, WeightedKernel
from planners.guarantee.requirement import MapRequirement
from planners.prediction.error_model import places
from planners.prediction.prior_cover import cell_centres
from survey.core.arrays import FloatArray
from survey.core.errors import CapacityError
from survey.core.streams import stream
from survey.data.area import SurveyArea
from survey.data.grid import Grid
from survey.data.route import Route
from survey.reconstruction.gp.selection.common_maps import mapped
from survey.reconstruction.gp.selection.kernel_search import ALL, KernelSearch
from survey.terrain.conditional import CoarseCells, ConditionalTerrain

_STEP_M = 10.0
_NODES_ALONG = 30
_MOST_HEIGHTS = 2e8
"""Heights of all simulated terrains: 1.6 GB."""


class SimulatedSurveys:
    """Terrain drawn from a posterior so that it agrees with the prior's cells, on which routes are tried."""

    def __init__(
        self, area: SurveyArea, cells: CoarseCells, posterior: KernelPosterior, requirement: MapRequirement
    ) -> None:
        self.requirement = requirement
        xmin, ymin, xmax, ymax = area.bounds
        self.nodes = cell_centres(area, _NODES_ALONG)
        step_m = min(_STEP_M, (xmax - xmin) / 20.0)
        _require_size((xmax - xmin) / step_m * (ymax - ymin) / step_m, step_m, requirement.n_simulations)
        grid = Grid.over((xmin, ymin, xmax, ymax), step_m, area.crs)
        worlds: dict[WeightedKernel, ConditionalTerrain] = {}
        self.weighted, self.terrains = [], []
        for index in range(requirement.n_simulations):
            rng = stream(requirement.seed, "promise", index)
            one = posterior.draw(rng)
            world = worlds.setdefault(one, ConditionalTerrain(cells, one.kernel, grid))
            self.weighted.append(one)
            self.terrains.append(world.draw(rng))
        self.actual = np.column_stack([terrain.at(self.nodes) for terrain in self.terrains])

    def errors(self, route: Route) -> FloatArray:
        """Return the root mean square error (n_simulations,) of the map of each simulated survey [m]."""
        require_samples(route.length_m, self.requirement.sample_step_m, MOST_SAMPLES)
        xy = places(route, self.requirement.sample_step_m)
        heights = np.column_stack([terrain.at(xy) for terrain in self.terrains])
        for column, one in enumerate(self.weighted):
            rng = stream(self.requirement.seed, "promise", column, "samples", len(xy))
            heights[:, column] += one.noise_m * rng.standard_normal(len(xy))
        found = KernelSearch(
            xy, heights, float(np.median([one.noise_m for one in self.weighted])), ALL
        ).found()
        mean, _ = mapped(xy, heights, found, self.nodes)
        errors: FloatArray = np.sqrt(np.mean((mean - self.actual) ** 2, axis=0))
        return errors


def _require_size(n_nodes: float, step_m: float, n_simulations: int) -> None:
    """Refuse an area whose simulated terrains would not fit into memory."""
    if n_nodes * n_simulations > _MOST_HEIGHTS:
        side_km = step_m * (_MOST_HEIGHTS / n_simulations) ** 0.5 / 1000.0
        raise CapacityError(
            f"the area takes {n_nodes:.3g} nodes of {step_m:g} m for each of {n_simulations} simulated terrains; at most an area of "
            f"{side_km:.3g} × {side_km:.3g} km can be simulated: split the area."
        )
