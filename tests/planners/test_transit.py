"""Shortest ways through free ground, against known answers and an independent search."""

import heapq
from itertools import combinations, pairwise

import numpy as np
import pytest
import shapely
from shapely import LineString, Point, Polygon

from planners.routes.shortest_paths import FreeGround
from planners.routes.tours import connect
from survey.core.errors import InputError
from survey.data.area import SurveyArea
from survey.data.outlines import MOST_CORNERS

BOX = shapely.box(0.0, 0.0, 100.0, 100.0)


def shortest_m(ground: Polygon, a: tuple[float, float], b: tuple[float, float]) -> float:
    """Dijkstra over all corners, with shapely's covers deciding who sees whom."""
    fat = ground.buffer(1e-6)
    points = [a, b, *{tuple(xy) for xy in shapely.get_coordinates(ground)}]
    seen: dict[int, list[tuple[int, float]]] = {i: [] for i in range(len(points))}
    for i, j in combinations(range(len(points)), 2):
        line = LineString([points[i], points[j]])
        if fat.covers(line):
            seen[i].append((j, line.length))
            seen[j].append((i, line.length))
    best, heap = {0: 0.0}, [(0.0, 0)]
    while heap:
        cost, i = heapq.heappop(heap)
        for j, length in seen[i]:
            if cost + length < best.get(j, np.inf) - 1e-12:
                best[j] = cost + length
                heapq.heappush(heap, (best[j], j))
    return best.get(1, np.inf)


@pytest.mark.parametrize("seed", range(12))
def test_ways_are_as_short_as_an_independent_search_finds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    holes = [Point(rng.uniform(15, 85, 2)).buffer(rng.uniform(4, 14), quad_segs=2) for _ in range(6)]
    ground = BOX - shapely.union_all(holes)
    ends = [tuple(xy) for xy in rng.uniform(1, 99, (40, 2)) if ground.contains(Point(xy))][:4]
    free = FreeGround(ground)
    for a, b in combinations(ends, 2):
        way = free.way(a, b)
        assert ground.covers(LineString(way))
        # Each bend is passed a millimetre off, which costs at most a few of them.
        assert shortest_m(ground, a, b) - 1e-6 <= LineString(way).length <= shortest_m(ground, a, b) + 0.02


def test_a_straight_way_along_a_border_stays_straight() -> None:
    np.testing.assert_array_equal(FreeGround(BOX).way((0.0, 0.0), (100.0, 0.0)), [[0.0, 0.0], [100.0, 0.0]])


def test_a_way_never_runs_through_the_corners_of_a_square_hole() -> None:
    ground = BOX - shapely.box(40.0, 40.0, 60.0, 60.0)
    way = FreeGround(ground).way((20.0, 20.0), (80.0, 80.0))
    assert ground.covers(LineString(way))
    # Round one corner: twice from (20, 20) to (60, 40) or the like.
    assert LineString(way).length == pytest.approx(2 * np.hypot(40.0, 20.0), abs=0.01)


def test_ways_fit_through_a_neck_as_wide_as_a_hand() -> None:
    ground = BOX - shapely.box(49.0, 0.0, 51.0, 50.0) - shapely.box(49.0, 50.1, 51.0, 100.0)
    way = FreeGround(ground).way((10.0, 10.0), (90.0, 90.0))
    assert ground.covers(LineString(way))


def test_ground_far_from_the_origin_is_treated_alike() -> None:
    ground = BOX - shapely.box(40.0, 0.0, 60.0, 90.0)
    moved = shapely.transform(ground, lambda xy: xy + [500_000.0, 8_000_000.0])
    near = LineString(FreeGround(ground).way((10, 10), (90, 10))).length
    far = FreeGround(moved).way((500_010, 8_000_010), (500_090, 8_000_010))
    assert moved.covers(LineString(far))
    assert LineString(far).length == pytest.approx(near, abs=1e-5)


class TestRefusals:
    def test_closed_ground(self) -> None:
        ground = FreeGround(BOX - shapely.box(40.0, -1.0, 60.0, 101.0))
        with pytest.raises(InputError, match="no way leads"):
            ground.way((10.0, 10.0), (90.0, 10.0))

    def test_points_off_the_ground(self) -> None:
        with pytest.raises(InputError, match="not on free ground"):
            FreeGround(BOX).way((10.0, 10.0), (190.0, 10.0))

    def test_swaths_on_parts_that_are_cut_off_are_named(self) -> None:
        ground = FreeGround(BOX - shapely.box(60.0, -1.0, 70.0, 101.0))
        swaths = [np.array([[x, 10.0], [x, 90.0]]) for x in (10.0, 80.0)]
        with pytest.raises(InputError, match=r"1 swaths lie on 1 parts .* 30(00|\d\d) m² around \(8"):
            connect(swaths, ground, start=(10.0, 10.0))

    def test_a_start_in_a_no_go_zone(self) -> None:
        ground = FreeGround(BOX - shapely.box(60.0, 0.0, 70.0, 50.0))
        with pytest.raises(InputError, match="outside the free ground"):
            connect([np.array([[10.0, 10.0], [10.0, 90.0]])], ground, start=(65.0, 25.0))
        with pytest.raises(InputError, match="in a no-go zone"):
            SurveyArea(BOX, "EPSG:32608", (shapely.box(60.0, 0.0, 70.0, 50.0),), [[65.0, 25.0]])

    def test_a_million_vertices(self) -> None:
        angle = np.linspace(0.0, 2.0 * np.pi, 1_000_000, endpoint=False)
        with pytest.raises(InputError, match=f"at most {MOST_CORNERS} can be planned on"):
            FreeGround(Polygon(np.column_stack([np.cos(angle), np.sin(angle)]) * 1000.0))

    def test_ground_thinner_than_the_margin(self) -> None:
        with pytest.raises(InputError, match="narrower than 2 mm"):
            FreeGround(shapely.box(0.0, 0.0, 100.0, 0.001))

    def test_no_swaths(self) -> None:
        with pytest.raises(InputError, match="no swaths"):
            connect([], FreeGround(BOX))


def bumpy_ring(n_corners: int) -> Polygon:
    """Return a ring about a hole, both with 300 bumps of half a metre."""
    angle = np.linspace(0.0, 2.0 * np.pi, n_corners, endpoint=False)
    bumps = 0.5 * np.sin(300.0 * angle)
    outer, inner = (
        np.column_stack([np.cos(angle), np.sin(angle)]) * (r + bumps)[:, None] for r in (200.0, 120.0)
    )
    return Polygon(outer, [inner])


def test_ways_on_an_outline_of_many_corners_stay_on_the_ground_and_are_nearly_as_short(monkeypatch) -> None:
    ground = bumpy_ring(6000)
    free = FreeGround(ground)
    fewer = free.outline.polygon
    assert shapely.get_num_coordinates(fewer) < 0.4 * shapely.get_num_coordinates(ground)
    assert ground.covers(fewer)
    assert shapely.hausdorff_distance(ground.boundary, fewer.boundary) < 0.2
    angles = np.linspace(0.0, 3.0, 5)
    ends = np.column_stack([np.cos(angles), np.sin(angles)]) * 121.0
    on_border = shapely.get_coordinates(ground.interiors[0])[[100, 2200]]
    ways = [free.way(*pair) for pair in (*pairwise(ends), on_border)]
    monkeypatch.setattr("planners.routes.shortest_paths.MANY_CORNERS", 10**6)
    exact = FreeGround(ground)
    assert exact.outline is exact
    for way in ways:
        assert ground.covers(LineString(way))
        shortest = LineString(exact.way(way[0], way[-1])).length
        assert shortest - 0.01 <= LineString(way).length <= 1.005 * shortest + 0.5


def test_an_outline_that_would_lose_a_part_is_not_simplified() -> None:
    ground = bumpy_ring(6000) - shapely.box(0.0, -300.0, 0.3, 300.0)
    narrow = shapely.union(
        ground, shapely.box(-1.0, 150.0, 1.0, 150.1)
    )  # a bridge that a border of 0.1 m closes
    free = FreeGround(narrow)
    assert free.outline is free
    assert narrow.covers(LineString(free.way((-20.0, 160.0), (20.0, 160.0))))
