"""A small surveyed site whose errors are known, for figures and reports."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from shapely import Polygon

from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.data.route import Leg, Route
from survey.data.surface_points import SurfacePoints
from survey.data.trajectory import Trajectory
from survey.reconstruction.terrain_map import Reconstruction

CRS = "EPSG:32608"
WEST, SOUTH = 500_000.0, 6_712_000.0


@pytest.fixture(scope="session")
def site() -> SimpleNamespace:
    """Hills of 200 × 200 m, two rovers, four swaths; error ±0.1 m, claimed 0.1 m (0.2 m in the east)."""
    grid = Grid((WEST, SOUTH, WEST + 200.0, SOUTH + 200.0), 5.0, CRS)
    east, north = (grid.xy - (WEST, SOUTH)).T.reshape(2, *grid.shape)
    truth = Dem.on(grid, 1500.0 + 8.0 * np.cos(east / 40.0) + 5.0 * np.sin(north / 30.0), "EGM96")
    error = 0.1 * np.where((np.add.outer(np.arange(41), np.arange(41)) % 2) == 0, 1.0, -1.0)
    std = np.where(east > 100.0, 0.2, 0.1)
    support = np.where(np.abs(east % 50.0 - 25.0) < 8.0, 3, 1)
    reconstruction = Reconstruction(
        Dem.on(grid, truth.elevation + error, "EGM96"),
        Dem.on(grid, std, "EGM96"),
        support,
        "gp",
        {"length_scale_m": 40.0, "kernel": "matern-5/2"},
    )
    return SimpleNamespace(
        grid=grid,
        truth=truth,
        error=error,
        prior=truth.block_mean(25.0),
        reconstruction=reconstruction,
        area=_area(),
        route=_route(),
        points=_points(truth),
        **_trajectories(),
    )


def _area() -> SurveyArea:
    corners = [(10.0, 10.0), (190.0, 10.0), (190.0, 150.0), (120.0, 190.0), (10.0, 190.0)]
    no_go = [(60.0, 60.0), (90.0, 60.0), (75.0, 90.0)]
    shift = np.array([WEST, SOUTH])
    return SurveyArea(Polygon(np.array(corners) + shift), CRS, (Polygon(np.array(no_go) + shift),))


def _route() -> Route:
    legs = []
    for rover, (first, second) in enumerate(((25.0, 75.0), (125.0, 175.0))):
        up, down = (np.array([[x, 20.0], [x, 100.0], [x, 145.0]]) + (WEST, SOUTH) for x in (first, second))
        legs += [
            Leg("swath", up, rover),
            Leg("transit", [up[-1], down[-1]], rover),
            Leg("swath", down[::-1], rover),
        ]
    return Route(tuple(legs), CRS, "lawnmower", 50.0, {"time_s": 800.0})


def _points(truth: Dem) -> SurfacePoints:
    xy = np.column_stack(
        [np.repeat([25.0, 75.0, 125.0, 175.0], 12), np.tile(np.arange(20.0, 140.0, 10.0), 4)]
    )
    xy += (WEST, SOUTH)
    return SurfacePoints(np.column_stack([xy, truth.at(xy)]), sigma_m=0.05, crs=CRS, vertical_datum="EGM96")


def _trajectories() -> dict[str, Trajectory]:
    time = np.arange(50.0)
    position = np.column_stack([WEST + time, SOUTH + 2.0 * time, 1500.0 + 0.0 * time])
    level = np.tile([0.0, 0.0, 0.0, 1.0], (50, 1))
    covariance = np.tile(0.04 * np.eye(3), (50, 1, 1))
    off = position + (0.3, -0.1, 0.0)
    return {
        "reference_trajectory": Trajectory(time, position, level, covariance, CRS),
        "trajectory": Trajectory(
            time, off, level, covariance, CRS, np.where((time > 20) & (time < 25), 0.0, 1.0)
        ),
    }


@pytest.fixture(scope="session")
def scored(site: SimpleNamespace) -> Any:
    """The score of the small site."""
    from survey.scoring import score

    return score(site.reconstruction, truth=site.truth, route=site.route, area=site.area)
