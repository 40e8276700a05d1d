"""Routes that are changed while they are driven: detours on a grid, and what a scan changes."""

import numpy as np
import pytest

from planners.look_ahead import LookAhead, LookAheadSettings, Returns
from planners.routes.detours import CostGrid, densified
from planners.routes.replanning import rest_of
from survey import CapacityError, InputError, Leg, Route, SurveyArea
from survey.reconstruction.nodes import NodeWindow

CRS = "EPSG:32608"


def grid_with(*walls: tuple[float, float, float, float]) -> CostGrid:
    """Return 40 × 40 m of ground with walls (xmin, ymin, xmax, ymax)."""
    window = NodeWindow(0.25, 0, 0, 161, 161)
    cost = np.ones(window.shape)
    x, y = window.xy.T.reshape(2, *window.shape)
    for xmin, ymin, xmax, ymax in walls:
        cost[(x >= xmin) & (x <= xmax) & (y >= ymin) & (y <= ymax)] = np.inf
    return CostGrid(window, cost)


def test_a_detour_is_the_shortest_way_around_a_wall() -> None:
    grid, path = grid_with((19.0, 10.0, 21.0, 25.0)), densified(np.array([[0.0, 20.0], [40.0, 20.0]]), 0.25)
    found = grid.detour(path, np.ones(len(path), dtype=bool), 0.25)
    assert found is not None
    way = densified(found.xy, 0.05)
    assert np.isfinite(grid.at(way)).mean() > 0.98  # a corner of a node may be cut
    assert path[found.leaves] == pytest.approx([17.25, 20.0], abs=0.3)
    assert path[found.joins][0] > 21.0
    # Over the top of the wall: from (17.25, 20) to its corners and down to where the path is joined again.
    a, corners, b = path[found.leaves], np.array([[19.0, 25.0], [21.0, 25.0]]), path[found.joins]
    least = np.hypot(*(corners[0] - a)) + 2.0 + np.hypot(*(b - corners[1]))
    assert np.hypot(*np.diff(found.xy, axis=0).T).sum() <= 1.1 * least


def test_a_pocket_behind_walls_is_left_out() -> None:
    grid = grid_with(
        (10.0, 15.0, 10.5, 25.0), (20.0, 15.0, 20.5, 25.0), (10.0, 25.0, 20.5, 25.5), (10.0, 15.0, 20.5, 15.5)
    )
    path = densified(np.array([[0.0, 20.0], [40.0, 20.0]]), 0.25)
    found = grid.detour(path, np.ones(len(path), dtype=bool), 0.25)
    assert found is not None
    assert path[found.joins][0] > 20.5


def test_no_way_is_nothing() -> None:
    grid = grid_with((19.0, 0.0, 21.0, 40.0))
    path = densified(np.array([[0.0, 20.0], [40.0, 20.0]]), 0.25)
    assert grid.detour(path, np.ones(len(path), dtype=bool), 0.25) is None


def swath(length_m: float = 30.0) -> tuple[Route, SurveyArea]:
    route = Route((Leg("swath", [[0.0, 0.0], [length_m, 0.0]]),), CRS, "line")
    return route, SurveyArea.rectangle((-10.0, -15.0, length_m + 10.0, 15.0), CRS)


def seen(height, rng: np.random.Generator) -> Returns:
    """Return points of the ground around the swath as if seen from above."""
    xy = rng.uniform((-8.0, -15.0), (25.0, 15.0), (120_000, 2))
    z = height(xy) + 0.01 * rng.standard_normal(len(xy))
    return Returns(np.column_stack([xy, z]), None, np.full(len(xy), 0.02))


def test_nothing_changes_on_gentle_ground(rng: np.random.Generator) -> None:
    rover = LookAhead(*swath(), LookAheadSettings())
    before = rover.path.copy()
    assert not rover.update(seen(lambda xy: 0.1 * xy[:, 0], rng), np.zeros(2))
    assert np.array_equal(rover.path, before)
    assert rover.n_detours == 0


def test_the_path_is_led_around_a_block_with_clearance(rng: np.random.Generator) -> None:
    settings = LookAheadSettings()
    rover = LookAhead(*swath(), settings)
    rover.update(
        seen(lambda xy: 1.0 * ((np.abs(xy[:, 0] - 8.0) < 1.0) & (np.abs(xy[:, 1]) < 2.0)), rng), np.zeros(2)
    )
    off = (
        np.maximum(np.abs(rover.path[:, 0] - 8.0) - 1.0, 0.0),
        np.maximum(np.abs(rover.path[:, 1]) - 2.0, 0.0),
    )
    assert np.hypot(*off).min() > settings.clearance_m
    assert rover.path[-1] == pytest.approx([30.0, 0.0])
    assert 2.0 < rover.skipped_m < 12.0
    driven = rover.advance(100.0)
    assert rover.is_done
    route = rover.driven_route()
    assert [leg.kind for leg in route.legs] == ["swath", "transit", "swath"]
    assert route.length_m == pytest.approx(np.hypot(*np.diff(driven, axis=0).T).sum(), rel=0.02)


def test_a_path_without_a_way_is_scanned_again_and_then_ends(rng: np.random.Generator) -> None:
    wall = seen(lambda xy: 1.0 * (np.abs(xy[:, 0] - 8.0) < 0.5), rng)
    rover = LookAhead(swath()[0], SurveyArea.rectangle((-10.0, -6.0, 40.0, 6.0), CRS), LookAheadSettings())
    assert rover.update(wall, np.zeros(2))
    assert not rover.has_way
    for _ in range(10):
        if not rover.update(wall, np.zeros(2)):
            break
    assert rover.path[-1][0] < 7.0
    assert rover.skipped_m == pytest.approx(22.0, abs=2.0)


def test_what_is_left_of_a_route_begins_at_the_rover() -> None:
    route = Route(
        (
            Leg("swath", [[0, 0], [10, 0]]),
            Leg("transit", [[10, 0], [10, 5]]),
            Leg("swath", [[10, 5], [0, 5]]),
        ),
        CRS,
        "line",
    )
    rest = rest_of(route, np.array([4.0, 0.5]))
    assert rest.legs[0].xy.tolist() == [[4.0, 0.5], [10.0, 0.0]]
    assert [leg.kind for leg in rest.legs] == ["swath", "transit", "swath"]


def test_a_route_of_several_rovers_is_refused() -> None:
    route = Route((Leg("swath", [[0, 0], [10, 0]]), Leg("swath", [[0, 5], [10, 5]], 1)), CRS, "line")
    with pytest.raises(InputError, match="2 rovers"):
        LookAhead(route, SurveyArea.rectangle((0, 0, 10, 10), CRS), LookAheadSettings())
    with pytest.raises(InputError, match="2 rovers"):
        rest_of(route, np.zeros(2))


def test_an_area_that_is_too_large_to_remember_is_refused() -> None:
    with pytest.raises(CapacityError, match="the part of it that is driven next"):
        LookAhead(swath()[0], SurveyArea.rectangle((0, 0, 3000, 3000), CRS), LookAheadSettings())
