"""A smooth site of 300 m, its satellite elevations and survey lines."""

import numpy as np

from planners.prediction.kernel_posterior import WeightedKernel
from survey import Dem, Grid, SurveyArea
from survey.core.streams import stream
from survey.reconstruction.gp.kernel_search import Cell
from survey.terrain import random_dem, satellite_copy

CRS = "EPSG:32608"
SIDE_M = 300.0
AREA = SurveyArea.rectangle((0.0, 0.0, SIDE_M, SIDE_M), CRS)
SMOOTH = WeightedKernel(Cell.of("squared-exponential", 80.0, -12.0), 25.0, 0.1, 1.0)


def smooth_terrain(seed: int = 3) -> Dem:
    grid = Grid((0.0, 0.0, SIDE_M, SIDE_M), 5.0, CRS)
    return random_dem("squared-exponential", grid, stream(seed), 12.0, length_scale_m=80.0)


def coarse(terrain: Dem) -> Dem:
    return satellite_copy(terrain, rng=stream(4), cell_m=50.0, sigma_m=0.5)


def lines(n: int) -> np.ndarray:
    along = np.arange(0.0, SIDE_M + 1.0, 10.0)
    offsets = (np.arange(n) + 0.5) * SIDE_M / n
    return np.array([(x, y) for y in offsets for x in along])
