"""A desk on polar terrain: metres on the ground, routes, contours, files."""

import numpy as np
import pytest

from desk.plan.document import PlanDocument
from desk.plan.exports import PlanExport
from desk.plan.summary import drives
from desk.terrain.tiles import contour_lines
from desk.workspace import Workspace
from survey.data.dem import Dem
from survey.data.grid import Grid

WEST, SOUTH = -200_000.0, -2_300_000.0


@pytest.fixture
def polar(tmp_path):
    """Desk on hills in the polar stereographic CRS of Greenland, with a square drawn."""
    grid = Grid((WEST, SOUTH, WEST + 1170.0, SOUTH + 1170.0), 30.0, "EPSG:3413")
    x, y = np.meshgrid(np.arange(grid.shape[1]) * 30.0, np.arange(grid.shape[0]) * 30.0)
    Dem.on(grid, 700.0 + 20.0 * np.sin(x / 150.0) + 15.0 * np.cos(y / 120.0)).write(tmp_path / "polar.tif")
    corners = ((300.0, 300.0), (800.0, 300.0), (800.0, 800.0), (300.0, 800.0))
    square = tuple((WEST + x, SOUTH + y) for x, y in corners)
    document = PlanDocument(areas=((square,),), planner={"pattern": "lawnmower", "swaths": 3})
    with Workspace(tmp_path / "polar.tif", tmp_path / "polar.desk.json", document) as opened:
        yield opened


def test_lengths_are_those_on_the_ground(polar):
    live = polar.planner.quick(polar.store.document)
    (drive,) = drives(live, polar.tiles.pyramid)
    grid_m = sum(leg.length_m for leg in live.plan.route.legs)
    assert polar.map_scale != pytest.approx(1.0, abs=2e-3)
    assert drive["distance_m"][-1] == pytest.approx(grid_m / polar.map_scale, rel=5e-4)
    assert drive["time_s"][-1] == pytest.approx(live.plan.route.prediction["time_s"], rel=5e-3)


def test_contours_and_tiles_are_drawn(polar):
    bounds = polar.tiles.pyramid.bounds
    assert len(contour_lines(polar.tiles.pyramid, bounds)["lines"]) > 5
    assert polar.tiles.png("relief", 0, 0, 0)


def test_files_hold_degrees_of_greenland(polar):
    document = polar.store.document
    plan = PlanExport(polar.planner.exact(document), document, "polar", polar.terrain)
    rows = plan.file(".csv").content.decode().splitlines()
    longitude, latitude = (float(value) for value in rows[1].split(",")[-2:])
    assert -60.0 < longitude < -45.0
    assert 65.0 < latitude < 72.0
