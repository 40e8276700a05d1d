"""The map of a plan shows what is planned, on what, and what it will leave unknown."""

import numpy as np
import pytest
import shapely
from matplotlib.collections import QuadMesh

from survey import Dem, Grid, InputError, Route, SurveyArea
from survey.data.route import Leg
from survey.figures import plan_map

CRS = "EPSG:32608"
AREA = SurveyArea(shapely.box(0.0, 0.0, 100.0, 60.0), CRS, no_go=(shapely.box(40.0, 20.0, 50.0, 30.0),))
ROUTE = Route(
    (
        Leg("swath", [[0.0, 10.0], [100.0, 10.0]]),
        Leg("transit", [[100.0, 10.0], [100.0, 50.0]]),
        Leg("swath", [[100.0, 50.0], [0.0, 50.0]], rover=1),
    ),
    CRS,
    "lawnmower",
)
GRID = Grid((-10.0, -10.0, 110.0, 70.0), 10.0, CRS)
GROUND = Dem.on(GRID, GRID.xy[:, 0].reshape(GRID.shape))


def legend(figure) -> list[str]:
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_rovers_transits_no_go_and_closed_ground_are_named():
    figure = plan_map(AREA, ROUTE, left_out=[shapely.box(80.0, 20.0, 90.0, 30.0)])
    assert {
        "Survey area",
        "No-go",
        "Not drivable",
        "Rover 1, swaths (1)",
        "Rover 2, swaths (1)",
        "Transit",
    } <= set(legend(figure))
    (xmin, xmax), (ymin, ymax) = figure.axes[0].get_xlim(), figure.axes[0].get_ylim()
    assert (xmin < 0.0, xmax > 100.0) == (True, True)
    assert (ymin < 0.0, ymax > 60.0) == (True, True)
    assert not figure.axes[1].axison


def test_colours_tell_the_predicted_deviation_or_else_the_elevation():
    std = Dem.on(GRID, np.full(GRID.shape, 0.5))
    predicted, known = plan_map(AREA, ROUTE, terrain=GROUND, std=std), plan_map(AREA, ROUTE, terrain=GROUND)
    assert predicted.axes[1].get_ylabel() == "Predicted standard deviation [m]"
    assert known.axes[1].get_ylabel() == "Elevation [m]"
    rasters = [
        np.asarray(mesh.get_array()) for mesh in predicted.axes[0].collections if isinstance(mesh, QuadMesh)
    ]
    # Few cells are drawn as finer ones.
    finer = tuple(5 * n for n in GRID.shape)
    assert any(raster.shape == finer and np.allclose(raster, 0.5) for raster in rasters)


def test_many_swaths_do_not_hide_the_prediction():
    def share_drawn(n: int) -> float:
        legs: list[Leg] = []
        for k, y in enumerate(np.linspace(0.5, 59.5, n)):
            line = [[0.0, y], [100.0, y]][:: 1 if k % 2 == 0 else -1]
            legs += [Leg("transit", [legs[-1].xy[-1], line[0]])] if legs else []
            legs.append(Leg("swath", line))
        axes = plan_map(AREA, Route(tuple(legs), CRS, "lawnmower")).axes[0]
        height_pt = axes.get_position().height * axes.figure.get_figheight() * 72.0
        return float(n * axes.lines[0].get_linewidth() / height_pt)

    assert share_drawn(4) < share_drawn(128) < 0.16


def test_labels_of_contours_stand_within_the_area():
    for width in (20.0, 100.0):
        tongue = SurveyArea(shapely.box(0.0, 25.0, width, 35.0), CRS)
        labels = plan_map(tongue, ROUTE, terrain=GROUND).axes[0].texts
        heights = [text for text in labels if text.get_text().isdigit() and text.get_bbox_patch() is None]
        assert heights
        assert all(
            shapely.dwithin(tongue.polygon, shapely.Point(text.get_position()), 1.0) for text in heights
        )


def test_another_crs_is_refused():
    elsewhere = SurveyArea(AREA.polygon, "EPSG:32609")
    with pytest.raises(InputError, match="the route"):
        plan_map(elsewhere, ROUTE)
