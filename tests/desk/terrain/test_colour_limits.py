"""Limits of colours: little of a map lies beyond them, and little of the colours is unused."""

import numpy as np
import pytest

from desk.plan.summary import error_layer
from desk.runs import layers_of
from desk.terrain.shading import colour_limit
from survey.data.dem import Dem
from survey.data.grid import Grid


@pytest.mark.parametrize("scale", [0.0011, 0.19, 0.36, 0.99, 4.9, 73.0])
@pytest.mark.parametrize("draw", ["uniform", "exponential", "normal"])
def test_few_values_are_beyond_the_limit_and_it_is_near_them(scale, draw):
    values = scale * getattr(np.random.default_rng(3), draw)(size=20_000)
    top = colour_limit(values)
    assert np.mean(np.abs(values) > top) <= 0.02
    assert top <= 1.4 * max(np.percentile(np.abs(values), 98.0), 1e-3)


def test_the_limit_of_the_standard_deviation_of_a_map_leaves_few_values_out():
    grid = Grid((0.0, 0.0, 400.0, 400.0), 4.0, "EPSG:32608")
    std = Dem.on(grid, np.random.default_rng(1).uniform(0.15, 0.19, grid.shape))
    low, high = layers_of(std, std)["sigma"]["limits"]
    assert low == 0.0
    assert np.mean(std.elevation > high) <= 0.02


@pytest.mark.parametrize("swaths", [4, 24])
def test_the_error_layer_of_a_dense_plan_is_not_one_colour(workspace, swaths):
    document = workspace.store.document.model_copy(
        update={"planner": {"pattern": "lawnmower", "swaths": swaths}}
    )
    plan = workspace.planner.exact(document).plan
    shown = error_layer(plan, "fine")
    std = plan.drawing.std(plan.route, plan.drawing.fine_cell_m).elevation
    assert np.mean(std[np.isfinite(std)] > shown["top_m"]) <= 0.02
