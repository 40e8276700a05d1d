"""Plots and HTML representations of the data types."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.data.path_error import PathError
from survey.data.route import Leg, Route
from survey.data.surface_points import SurfacePoints
from survey.data.trajectory import Trajectory
from survey.reconstruction.terrain_map import Reconstruction

GRID = Grid((0.0, 0.0, 3.0, 2.0), 1.0)
DEM = Dem.on(GRID, GRID.xy[:, 0].reshape(GRID.shape))
ROUTE = Route(
    (Leg("swath", [[0.0, 0.0], [3.0, 0.0]]), Leg("transit", [[3.0, 0.0], [3.0, 2.0]])), GRID.crs, "line"
)
POINTS = SurfacePoints([[0.0, 0.0, 5.0], [1.0, 2.0, 6.0]], sigma_m=0.1, crs=GRID.crs)
TRAJECTORY = Trajectory(
    [0.0, 1.0], [[0.0, 0.0, 5.0], [3.0, 4.0, 5.0]], [[0.0, 0.0, 0.0, 1.0]] * 2, np.zeros((2, 3, 3)), GRID.crs
)
MAP = Reconstruction(DEM, DEM, np.full(GRID.shape, 3), "tin", {})
PLOTTED = {
    "Dem": DEM,
    "Route": ROUTE,
    "SurfacePoints": POINTS,
    "Trajectory": TRAJECTORY,
    "Reconstruction": MAP,
}


@pytest.mark.parametrize("name", PLOTTED)
def test_plot_draws_on_the_given_axes_in_map_coordinates(name):
    axes = Figure().add_subplot()
    assert PLOTTED[name].plot(axes) is axes
    assert axes.get_xlabel() == "Easting [m]"
    assert axes.get_ylabel() == "Northing [m]"
    assert axes.images or axes.lines or axes.collections


def test_plot_without_axes_opens_a_figure():
    from matplotlib import pyplot

    axes = DEM.plot()
    assert axes.images[0].get_extent() == [-0.5, 3.5, -0.5, 2.5]
    pyplot.close(axes.figure)


@pytest.mark.parametrize("shown", [DEM, ROUTE, MAP, TRAJECTORY, POINTS])
def test_html_representation_holds_facts_and_a_picture(shown):
    text = shown._repr_html_()
    assert "WGS 84 / UTM zone 8N" in text
    assert "data:image/png;base64," in text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (DEM, "Dem(3 × 4 of 1 m, 0.0 to 3.0 m, WGS 84 / UTM zone 8N)"),
        (GRID, "Grid(3 × 4 nodes every 1 m, WGS 84 / UTM zone 8N)"),
        (ROUTE, "Route(line, 1 swath, 5 m, 1 rover, WGS 84 / UTM zone 8N)"),
        (POINTS, "SurfacePoints(2 points, 5.0 to 6.0 m, WGS 84 / UTM zone 8N)"),
        (TRAJECTORY, "Trajectory(2 poses, 5.0 m in 1.0 s, WGS 84 / UTM zone 8N)"),
        (MAP, "Reconstruction(tin, 3 × 4 of 1 m, 0.0 to 3.0 m, σ 0.0 to 3.0 m, WGS 84 / UTM zone 8N)"),
        (PathError([0.0, 1.0], np.eye(12)), "PathError(2 keyframes of 6 states, 12 unknowns)"),
    ],
)
def test_representation_is_one_line(value, text):
    assert repr(value) == text


def test_objects_with_equal_arrays_are_equal():
    assert Dem.on(GRID, GRID.xy[:, 0].reshape(GRID.shape)) == DEM
    assert Dem.on(GRID, np.zeros(GRID.shape)) != DEM
    assert PathError([0.0, 1.0], np.eye(12)) == PathError([0.0, 1.0], np.eye(12))
    assert PathError([0.0, 1.0], np.eye(12)) != PathError([0.0, 1.0], 2.0 * np.eye(12))
    assert hash(GRID) == hash(Grid((0.0, 0.0, 3.0, 2.0), 1.0))
