"""Coverage and spread by hand, and the known figures of the lawnmower on 600 × 600 m."""

import numpy as np
import pytest
from pyproj import CRS
from shapely import Polygon

from survey.core.errors import InputError
from survey.core.map_scale import scale_factors
from survey.data.area import SurveyArea
from survey.data.route import Leg, Route
from survey.scoring import Coverage, SampleCells, centeredness, distribution, science_coverage

UTM = CRS("EPSG:32608")


def route_of(*legs: Leg) -> Route:
    return Route(legs, UTM, "by hand")


def lawnmower(n: int, side_m: float = 600.0) -> Route:
    """Swaths at (i + 1/2) L / n from edge to edge, with the connectors driven."""
    legs: list[Leg] = []
    for index in range(n):
        x = (index + 0.5) * side_m / n
        xy = np.array([[x, 0.0], [x, side_m]])[:: 1 if index % 2 == 0 else -1]
        if legs:
            legs.append(Leg("transit", np.array([legs[-1].xy[-1], xy[0]])))
        legs.append(Leg("swath", xy))
    return route_of(*legs)


@pytest.fixture
def square() -> SurveyArea:
    """40 × 40 m: sixteen cells of 10 m with centres at 5, 15, 25, 35."""
    return SurveyArea.rectangle((0.0, 0.0, 40.0, 40.0), UTM)


def test_science_coverage_by_hand(square: SurveyArea) -> None:
    """A line along the western column visits distances 15√2, √(15² + 5²) twice and 15√2 of the sum."""
    line = route_of(Leg("swath", np.array([[5.0, 5.0], [5.0, 35.0]])))
    coverage = Coverage.of(line, square)
    corner, side, inner = 15.0 * 2.0**0.5, 250.0**0.5, 5.0 * 2.0**0.5
    whole = 4 * corner + 8 * side + 4 * inner
    assert coverage.scc == pytest.approx((2 * corner + 2 * side) / whole, rel=1e-12)
    assert coverage.cells_share == 4 / 16
    # 30 m driven of the 160 m that lines 10 m apart would take.
    assert coverage.robot_centric == 30.0 / 160.0
    # Four samples with their mean 15 m west of the centre, 20√2 m from the corner.
    assert coverage.alpha == pytest.approx(15.0 / (20.0 * 2.0**0.5), rel=1e-12)
    assert coverage.beta == 0.0


def test_a_cell_visited_twice_counts_once(square: SurveyArea) -> None:
    there = Leg("swath", np.array([[5.0, 5.0], [5.0, 35.0]]))
    back = Leg("transit", there.xy[::-1])
    once, twice = Coverage.of(route_of(there), square), Coverage.of(route_of(there, back), square)
    assert twice.scc == once.scc
    assert twice.cells_share == once.cells_share
    assert twice.robot_centric == 2 * (once.robot_centric or 0.0)


def test_connectors_count_for_coverage_but_not_for_beta(square: SurveyArea) -> None:
    first = Leg("swath", np.array([[5.0, 5.0], [5.0, 35.0]]))
    across = Leg("transit", np.array([[5.0, 35.0], [35.0, 35.0]]))
    coverage = Coverage.of(route_of(first, across), square)
    assert coverage.cells_share == 7 / 16
    assert coverage.beta == 0.0


def test_every_cell_visited_is_full_coverage(square: SurveyArea) -> None:
    assert Coverage.of(lawnmower(4, 40.0), square).scc == pytest.approx(1.0, rel=1e-12)


def test_no_go_ground_and_irregular_outlines_leave_cells_out() -> None:
    outline = Polygon([(0, 0), (40, 0), (40, 20), (20, 20), (20, 40), (0, 40)])
    pond = Polygon([(2, 2), (8, 2), (8, 8), (2, 8)])
    cells = SampleCells(SurveyArea(outline, UTM, (pond,)), 10.0)
    assert len(cells.centres) == 12 - 1
    # Ground outside the area and in the pond cannot be visited.
    assert len(cells.visited([[5.0, 5.0], [35.0, 35.0], [-5.0, 5.0], [500.0, 5.0]])) == 0
    np.testing.assert_array_equal(cells.visited([[35.0, 15.0]]), [[35.0, 15.0]])


def test_the_outer_edge_belongs_to_the_last_cell(square: SurveyArea) -> None:
    cells = SampleCells(square, 10.0)
    np.testing.assert_array_equal(cells.visited([[40.0, 40.0]]), [[35.0, 35.0]])
    np.testing.assert_array_equal(cells.visited([[10.0 - 1e-9, 5.0]]), [[15.0, 5.0]])


def test_sides_that_no_cell_divides_keep_the_cells_with_their_centre_inside() -> None:
    cells = SampleCells(SurveyArea.rectangle((0.0, 0.0, 26.0, 14.0), UTM), 10.0)
    np.testing.assert_array_equal(cells.centres, [[5.0, 5.0], [15.0, 5.0], [25.0, 5.0]])


@pytest.mark.paper
@pytest.mark.parametrize(
    ("n", "scc", "alpha"),
    [(1, None, 0.0), (2, None, 0.136), (3, None, 0.0), (4, 0.082, 0.035), (10, 0.184, None)],
)
def test_the_lawnmowers_known_figures(n: int, scc: float | None, alpha: float | None) -> None:
    """Prototypes gave these to the digits shown, with samples every 10 m along all that is driven."""
    coverage = Coverage.of(lawnmower(n), SurveyArea.rectangle((0.0, 0.0, 600.0, 600.0), UTM))
    if scc is not None:
        assert coverage.scc == pytest.approx(scc, abs=5e-4)
    if alpha is not None:
        assert coverage.alpha == pytest.approx(alpha, abs=5e-4)
    assert coverage.beta == 0.0


def test_coverage_does_not_change_when_all_is_moved(square: SurveyArea) -> None:
    shift = np.array([501_230.0, 6_470_040.0])
    moved = SurveyArea.rectangle((*shift, *(shift + 40.0)), UTM)
    xy = np.array([[2.0, 3.0], [31.0, 24.0], [12.0, 38.0]])
    here = Coverage.of(route_of(Leg("swath", xy)), square)
    there = Coverage.of(route_of(Leg("swath", xy + shift)), moved)
    assert here.scc == pytest.approx(there.scc, rel=1e-9)
    # Coordinates of 6.5e6 m carry rounding of 1e-9 m.
    assert here.beta == pytest.approx(there.beta, rel=1e-7)


def test_two_rovers_are_added_up(square: SurveyArea) -> None:
    west = Leg("swath", np.array([[5.0, 5.0], [5.0, 35.0]]), rover=0)
    east = Leg("swath", np.array([[35.0, 5.0], [35.0, 35.0]]), rover=1)
    coverage = Coverage.of(route_of(west, east), square)
    assert coverage.cells_share == 0.5
    assert coverage.alpha == pytest.approx(0.0, abs=1e-15)


def test_beta_by_hand() -> None:
    """Samples at y = 0, 4, 8, 4, 0 about the axis: βa = 16/5, steps 4, 4, 4, 4, so β = 0.8."""
    zigzag = Leg("swath", np.array([[0.0, 0.0], [6.0, 8.0], [12.0, 0.0]]), axis=[[0.0, 0.0], [12.0, 0.0]])
    route = route_of(zigzag)
    assert distribution(route, [route.sample(5.0)]) == pytest.approx(3.2 / 4.0, rel=1e-12)


def test_beta_divides_by_the_steps_that_it_keeps() -> None:
    """y = 0, 0.6, 3, 5.4: the step of 0.6 is dropped, βa = 9/4, βb = (2.4 + 2.4) / 2."""
    bent = Leg(
        "swath", np.array([[0.0, 0.0], [0.8, 0.6], [1.5, 3.0], [2.2, 5.4]]), axis=[[0.0, 0.0], [1.0, 0.0]]
    )
    route = route_of(bent)
    track = route.sample(1.0)._replace(xy=bent.xy, leg=np.zeros(4, dtype=np.int64))
    assert distribution(route, [track]) == pytest.approx(2.25 / 2.4, rel=1e-12)


def test_beta_never_steps_from_one_swath_to_the_next() -> None:
    """Two swaths beside their axes by 3 m and −3 m: the jump of 6 m between them is no step."""
    legs = (
        Leg("swath", np.array([[0.0, 3.0], [10.0, 3.0]]), axis=[[0.0, 0.0], [10.0, 0.0]]),
        Leg("swath", np.array([[10.0, 3.0], [20.0, 3.0]]), axis=[[10.0, 6.0], [20.0, 6.0]]),
    )
    route = route_of(*legs)
    assert distribution(route, [route.sample(2.0)]) is None


def test_beta_without_a_sample_on_a_swath_does_not_exist() -> None:
    route = route_of(Leg("transit", np.array([[0.0, 0.0], [9.0, 0.0]])))
    assert distribution(route, [route.sample(2.0)]) is None


def test_beta_is_measured_in_the_swaths_own_frame() -> None:
    along = np.linspace(0.0, 60.0, 13)
    wave = np.column_stack([along, 6.0 * np.sin(along / 8.0)])
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    axis = np.array([[0.0, 0.0], [60.0, 0.0]])
    betas = []
    for matrix in (np.eye(2), turn):
        route = route_of(Leg("swath", wave @ matrix.T, axis=axis @ matrix.T))
        betas.append(distribution(route, [route.sample(5.0)]))
    assert betas[0] == pytest.approx(betas[1], rel=1e-9)


def test_centeredness_spans_zero_to_one() -> None:
    assert centeredness([[1.0, 0.0], [-1.0, 0.0]], (0.0, 0.0), 5.0) == 0.0
    assert centeredness([[3.0, 4.0]], (0.0, 0.0), 5.0) == 1.0


def test_refusals(square: SurveyArea) -> None:
    line = Leg("swath", np.array([[5.0, 5.0], [5.0, 35.0]]))
    with pytest.raises(InputError, match="different systems"):
        Coverage.of(Route((line,), CRS("EPSG:32616"), "line"), square)
    for step_m, words in (
        (0.0, "greater than 0"),
        (float("nan"), "greater than 0"),
        (90.0, "sample more finely"),
    ):
        with pytest.raises(InputError, match=words):
            Coverage.of(route_of(line), square, step_m)
    with pytest.raises(InputError, match="reference point"):
        science_coverage([[0.0, 0.0]], [[0.0, 0.0]], (0.0, 0.0))
    with pytest.raises(InputError, match="needs samples"):
        centeredness(np.zeros((0, 2)), (0.0, 0.0), 1.0)
    looped = Leg("swath", np.array([[5.0, 5.0], [9.0, 9.0], [5.0, 5.0]]))
    with pytest.raises(InputError, match="axis"):
        Coverage.of(route_of(looped), square)


def test_the_sample_spacing_counts_on_the_ground():
    utm = SurveyArea.rectangle((0.0, 0.0, 40.0, 40.0), "EPSG:32608")
    line = np.array([[5.0, 5.0], [5.0, 36.0]])
    expected = Coverage.of(Route((Leg("swath", line),), utm.crs, "line"), utm, 10.0)
    factor = float(scale_factors("EPSG:3857", [[0.0, 8.5e6]]).linear[0])
    origin = np.array([0.0, 8.5e6])
    corner = tuple(origin) + tuple(origin + 40.0 * factor)
    mercator = SurveyArea.rectangle(corner, "EPSG:3857")
    scaled = Route((Leg("swath", origin + line * factor),), mercator.crs, "line")
    found = Coverage.of(scaled, mercator, 10.0)
    assert found.cells_share == expected.cells_share
    assert found.robot_centric == pytest.approx(expected.robot_centric, rel=0.01)
