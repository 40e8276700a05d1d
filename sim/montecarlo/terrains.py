"""Terrains of Monte Carlo trials: random surfaces, or surfaces that agree with a coarse prior."""

from functools import lru_cache

import numpy as np
from pyproj import CRS

import planners
from sim.montecarlo.blocks import TrialBlock
from sim.montecarlo.config import ConditionalKind, RandomKind, StudyConfig
from sim.world.prior import erroneous_copy
from survey import Dem, Grid, SurveyArea
from survey.core.errors import InputError
from survey.core.streams import stream
from survey.terrain import ice_micro_relief, random_dem
from survey.terrain.conditional import CoarseCells, ConditionalTerrain

_WITH_LENGTH = ("squared-exponential", "matern-3/2", "matern-5/2")
_CRS = CRS("EPSG:32608")


class TrialTerrains:
    """The terrains of a block, and what every survey of them needs."""

    def __init__(self, study: StudyConfig, block: TrialBlock) -> None:
        self.study = study
        self.kind = study.terrains[block.terrain]
        self.trials = range(block.first, block.first + block.n)
        self.dems = [drawn(study, self.kind, trial) for trial in self.trials]
        self.area = SurveyArea.rectangle(self.dems[0].grid().bounds, self.dems[0].crs)
        self.nodes = map_nodes(self.area, study.map_step_m)
        self.actual = np.column_stack([dem.at(self.nodes.xy) for dem in self.dems])

    def stream(self, what: str, trial: int, *names: str | int) -> np.random.Generator:
        """Return the stream of one trial."""
        return stream(self.study.seed, what, self.kind.name, trial, *names)

    def prior(self, index: int) -> Dem:
        """Return the satellite's cells of one terrain."""
        satellite = self.study.satellite
        trial = self.trials[index]
        rng, errors_rng = self.stream("satellite", trial), self.stream("satellite errors", trial)
        return erroneous_copy(self.dems[index], satellite, rng, errors_rng)


def map_nodes(area: SurveyArea, step_m: float) -> Grid:
    """Return the centres of square cells over a rectangle, where maps are judged."""
    xmin, ymin, xmax, ymax = area.bounds
    columns, rows = (int(side / step_m + 1e-9) for side in (xmax - xmin, ymax - ymin))
    if min(columns, rows) < 2:
        raise InputError(f"nodes {step_m:g} m apart do not fit the site; set map_step_m smaller.")
    x0, y0 = xmin + 0.5 * step_m, ymin + 0.5 * step_m
    return Grid((x0, y0, x0 + (columns - 1) * step_m, y0 + (rows - 1) * step_m), step_m, area.crs)


def drawn(study: StudyConfig, kind: RandomKind | ConditionalKind, trial: int) -> Dem:
    """Return the terrain of one trial."""
    rng = stream(study.seed, "terrain", kind.name, trial)
    if isinstance(kind, ConditionalKind):
        return _conditional(study, kind).draw(rng)
    grid = Grid((0.0, 0.0, kind.size_m, kind.size_m), kind.step_m, _CRS)
    scale = {"length_scale_m": kind.length_scale_m} if kind.family in _WITH_LENGTH else {}
    dem = random_dem(kind.family, grid, rng, relief_m=kind.relief_m, **scale)
    if kind.micro_relief_sd_m == 0.0:
        return dem
    relief = ice_micro_relief(
        grid, stream(study.seed, "micro-relief", kind.name, trial), sd_m=kind.micro_relief_sd_m
    )
    return Dem.on(grid, dem.elevation + relief)


def _conditional(study: StudyConfig, kind: ConditionalKind) -> ConditionalTerrain:
    return _conditional_on(str(study.path(kind.file)), kind.sigma_m, kind.step_m)


@lru_cache(maxsize=4)
def _conditional_on(file: str, sigma_m: float, step_m: float) -> ConditionalTerrain:
    """Learn the covariance from the prior's cells; the terrain ends at the centres of the outer ones."""
    prior = Dem.read(file)
    xmin, ymin, xmax, ymax = prior.grid().bounds
    columns, rows = (int(side / step_m + 1e-9) for side in (xmax - xmin, ymax - ymin))
    grid = Grid((xmin, ymin, xmin + columns * step_m, ymin + rows * step_m), step_m, prior.crs)
    area = SurveyArea.rectangle(prior.bounds, prior.crs)
    return ConditionalTerrain(CoarseCells(prior, sigma_m), planners.terrain_kernel(prior, area), grid)
