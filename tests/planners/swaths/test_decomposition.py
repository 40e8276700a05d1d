"""Swaths over polygons, cells and headings, on sites with known answers."""

import numpy as np
import pytest
import shapely
from affine import Affine
from shapely import Polygon

from planners.routes.shortest_paths import FreeGround
from planners.routes.tours import connect
from planners.swaths.decomposition import cells, clip_lines, swaths_on, unswept
from planners.swaths.heading import heading_by
from survey.core.errors import ConfigError, InputError
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.route import Leg


def test_rectangle_gives_the_lines_of_the_paper_from_edge_to_edge() -> None:
    ground = FreeGround(shapely.box(0.0, 0.0, 600.0, 600.0))
    swaths = swaths_on(ground, 150.0, 90.0)
    np.testing.assert_array_equal([s[:, 0] for s in swaths], [[x, x] for x in (75.0, 225.0, 375.0, 525.0)])
    np.testing.assert_array_equal([s[:, 1] for s in swaths], [[0.0, 600.0]] * 4)
    legs = connect(swaths, ground)
    assert sum(leg.length_m for leg in legs) == 4 * 600.0 + 3 * 150.0
    assert [leg.kind for leg in legs] == ["swath", "transit"] * 3 + ["swath"]


def test_spacing_is_the_largest_one_that_divides_the_width() -> None:
    ground = FreeGround(shapely.box(0.0, 0.0, 100.0, 50.0))
    x = [s[0, 0] for s in swaths_on(ground, 30.0, 90.0)]
    np.testing.assert_allclose(np.diff(x), 25.0)


def test_a_hole_splits_swaths_and_makes_four_cells() -> None:
    ground = FreeGround(shapely.box(0.0, 0.0, 100.0, 100.0) - shapely.box(30.0, 40.0, 70.0, 60.0))
    swaths = swaths_on(ground, 10.0, 90.0)
    # Six lines pass beside the hole, four are cut in two; the cells: left, below, above, right.
    assert len(swaths) == 14
    assert sorted(np.bincount(cells(swaths, 90.0))) == [3, 3, 4, 4]


def test_several_parts_are_all_swept() -> None:
    ground = FreeGround(shapely.union(shapely.box(0, 0, 40, 40), shapely.box(60, 0, 100, 40)))
    swaths = swaths_on(ground, 20.0, 0.0)
    assert len(swaths) == 4
    assert not unswept(ground, swaths, 20.5)


def test_a_passage_between_two_lines_gets_a_swath_of_its_own() -> None:
    # A neck 3 m wide between the lines at 15 m and 25 m.
    ground = FreeGround(
        shapely.box(0, 0, 40, 40) | shapely.box(40, 18.5, 140, 21.5) | shapely.box(140, 0, 180, 40)
    )
    swaths = swaths_on(ground, 10.0, 0.0)
    assert any(abs(s[0, 1] - 20.0) < 1.0 and s[-1, 0] - s[0, 0] > 95.0 for s in swaths)


def test_a_headland_keeps_off_every_border() -> None:
    ground = FreeGround(shapely.box(0.0, 0.0, 100.0, 40.0))
    inner = swaths_on(ground, 20.0, 0.0, headland_m=10.0)
    np.testing.assert_allclose([s[:, 0] for s in inner], [[10.0, 90.0]])


def test_winding_lines_are_cut_to_the_ground() -> None:
    ground = FreeGround(shapely.box(0.0, 0.0, 100.0, 20.0) - shapely.box(45.0, 5.0, 55.0, 15.0))
    x = np.linspace(-10.0, 110.0, 121)
    wave = np.column_stack([x, 10.0 + 3.0 * np.sin(x / 10.0)])
    pieces = clip_lines(ground, [wave])
    assert len(pieces) == 2
    assert all(ground.covers(shapely.linestrings(piece)) for piece in pieces)
    assert pieces[0][0, 0] < pieces[0][-1, 0] < pieces[1][0, 0]


def test_slanted_borders_leave_only_short_tips_unswept() -> None:
    triangle = FreeGround(Polygon([(0, 0), (200, 0), (100, 150)]))
    tips = unswept(triangle, swaths_on(triangle, 20.0, 0.0), 20.0)
    assert sum(tip.area for tip in tips) < 0.02 * triangle.polygon.area


@pytest.mark.parametrize("spacing_m", [0.0, -1.0, float("nan"), float("inf")])
def test_a_spacing_that_is_no_length_is_refused(spacing_m: float) -> None:
    ground = FreeGround(shapely.box(0.0, 0.0, 10.0, 10.0))
    with pytest.raises(ConfigError, match="spacing of the swaths"):
        swaths_on(ground, spacing_m, 0.0)


def test_ground_without_room_for_a_swath_is_refused() -> None:
    with pytest.raises(InputError, match="no swath fits"):
        swaths_on(FreeGround(shapely.box(0.0, 0.0, 10.0, 10.0)), 5.0, 0.0, headland_m=6.0)
    with pytest.raises(ConfigError, match="the headland is -1"):
        swaths_on(FreeGround(shapely.box(0.0, 0.0, 10.0, 10.0)), 5.0, 0.0, headland_m=-1.0)


def test_ground_smaller_than_a_spacing_gets_one_swath_through_its_middle() -> None:
    swaths = swaths_on(FreeGround(shapely.box(0.0, 0.0, 10.0, 4.0)), 50.0, 0.0)
    np.testing.assert_array_equal(swaths, [[[0.0, 2.0], [10.0, 2.0]]])


class TestHeading:
    def test_narrowest_runs_along_the_long_side(self) -> None:
        site = shapely.affinity.rotate(shapely.box(0.0, 0.0, 200.0, 50.0), 33.0)
        assert heading_by("narrowest", FreeGround(site)) == pytest.approx(33.0)

    def test_fewest_swaths_sees_that_an_l_is_not_its_hull(self) -> None:
        comb = shapely.box(0, 0, 200, 20) | shapely.box(0, 0, 20, 100) | shapely.box(180, 0, 200, 100)
        ground = FreeGround(comb)
        heading_deg = heading_by("fewest-swaths", ground, spacing_m=10.0)
        n = {h: len(swaths_on(ground, 10.0, h)) for h in (0.0, 90.0)}
        assert n[heading_deg] == min(n.values())

    def test_slope_and_grain_follow_the_terrain(self) -> None:
        x, y = np.meshgrid(np.arange(50.0), np.arange(50.0)[::-1])
        ground = FreeGround(shapely.box(0.0, 0.0, 49.0, 49.0))
        transform = Affine(1.0, 0.0, -0.5, 0.0, -1.0, 49.5)
        tilted = Dem(0.1 * x + 0.1 * y, transform, "EPSG:32608")
        assert heading_by("slope", ground, dem=tilted) == pytest.approx(45.0)
        # Ridges run along (1, -1): heights change across them, along (1, 1).
        ridged = Dem(np.sin((x + y) / 4.0), transform, "EPSG:32608")
        assert heading_by("grain", ground, dem=ridged) == pytest.approx(45.0, abs=0.5)
        with pytest.raises(InputError, match="alike in all directions"):
            heading_by("grain", ground, dem=tilted)

    def test_what_a_rule_needs_is_asked_for(self) -> None:
        ground = FreeGround(shapely.box(0.0, 0.0, 49.0, 49.0))
        with pytest.raises(InputError, match="needs a DEM"):
            heading_by("slope", ground)
        with pytest.raises(InputError, match="needs the spacing"):
            heading_by("fewest-swaths", ground)


def test_legs_keep_the_axis_that_winding_swaths_deviate_from() -> None:
    ground = FreeGround(shapely.box(0.0, 0.0, 100.0, 40.0))
    wave = [
        np.array([[0.0, 10.0], [50.0, 14.0], [100.0, 9.0]]),
        np.array([[0.0, 30.0], [50.0, 34.0], [100.0, 31.0]]),
    ]
    axes = [np.array([[0.0, y], [100.0, y]]) for y in (10.0, 30.0)]
    swaths = [leg for leg in connect(wave, ground, axes=axes) if leg.kind == "swath"]
    assert isinstance(swaths[0], Leg)
    for leg in swaths:
        np.testing.assert_array_equal(leg.axis[:, 0], leg.xy[[0, -1], 0])
        assert abs(leg.axis[0, 1] - leg.xy[0, 1]) < 5.0


def test_a_line_along_a_border_stays_one_swath() -> None:
    ground = FreeGround(shapely.box(0.0, 0.0, 100.0, 100.0) - shapely.box(35.0, 40.0, 65.0, 60.0))
    at_35 = [s for s in swaths_on(ground, 10.0, 90.0) if s[0, 0] == 35.0]
    np.testing.assert_array_equal(at_35, [[[35.0, 0.0], [35.0, 100.0]]])


SQUARE = [(0.0, 0.0), (100.0, 0.0), (100.0, 100.0), (0.0, 100.0)]


@pytest.mark.parametrize(
    ("polygon", "crs", "message"),
    [
        (Polygon([(0, 0), (100, 100), (100, 0), (0, 100)]), "EPSG:32608", "not a simple polygon"),
        (Polygon(), "EPSG:32608", "empty polygon"),
        (shapely.LineString(SQUARE), "EPSG:32608", "a polygon was expected"),
        (Polygon(SQUARE, [[(200, 0), (210, 0), (210, 10)]]), "EPSG:32608", "not a simple polygon"),
        (Polygon(SQUARE), "EPSG:4326", "metres"),
        (Polygon([(0, 0), (100, 0), (50, 0)]), "EPSG:32608", "polygon"),
    ],
)
def test_areas_that_cannot_be_planned_are_refused_in_a_sentence(
    polygon: Polygon, crs: str, message: str
) -> None:
    with pytest.raises(InputError, match=message) as caught:
        SurveyArea(polygon, crs)
    assert "\n" not in str(caught.value)
