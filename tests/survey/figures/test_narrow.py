"""Narrow versions of wide figures: one column, and the wide figure unchanged."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from survey import Dem, Grid, SurveyArea
from survey.figures import path_map, survey_map
from survey.figures.layout import NARROW_IN, narrow_image
from survey.figures.style import SHARP_DPI, png_bytes

GRID = Grid((0.0, 0.0, 60.0, 30.0), 5.0, "EPSG:32608")
GROUND = Dem.on(GRID, GRID.xy[:, 0].reshape(GRID.shape))


def panels() -> Figure:
    figure = Figure(figsize=(9.0, 3.0), layout="constrained")
    left, right = figure.subplots(1, 2)
    for axes in (left, right):
        axes.plot([0, 1], [0, 1], label="one")
        axes.set_title("A title that is far too long for half of the width of a page of a report")
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def a_map() -> Figure:
    return survey_map(GROUND, area=SurveyArea.rectangle(GRID.bounds, GRID.crs))


def a_path() -> Figure:
    path = np.column_stack([np.linspace(0.0, 50.0, 11), np.zeros(11), np.zeros(11)])
    return path_map(path, np.tile(0.04 * np.eye(3), (11, 1, 1)), reference=path)


@pytest.mark.parametrize("draw", [panels, a_map, a_path])
def test_a_narrow_figure_leaves_the_wide_one_as_it_was(draw) -> None:
    figure = draw()
    before = png_bytes(figure, 60)
    assert narrow_image(figure).width == round(SHARP_DPI * NARROW_IN)
    assert png_bytes(figure, 60) == before


def test_panels_stand_below_one_another_each_as_tall_as_before() -> None:
    figure = panels()
    assert narrow_image(figure).height == 2 * SHARP_DPI * 3
