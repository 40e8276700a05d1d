import numpy as np
import pytest
import shapely

from planners.steered_paths import Band
from planners.steering import Attitude, attitude_sensor
from survey import Dem, Grid, InputError

FIELD = shapely.box(0.0, 0.0, 100.0, 60.0)
AXIS = np.array([[0.0, 20.0], [100.0, 20.0]])


def test_the_band_ends_at_the_border_and_at_half_a_spacing():
    band = Band.about(AXIS, 30.0, FIELD, step_m=10.0)
    assert band.length_m == 100.0
    assert band.heading_rad == 0.0
    assert band.left_m.tolist() == pytest.approx([30.0] * len(band.knots_m))
    assert band.right_m.tolist() == pytest.approx([20.0] * len(band.knots_m))


def test_the_band_narrows_a_step_before_an_obstacle():
    band = Band.about(AXIS, 30.0, FIELD - shapely.box(40.0, 30.0, 60.0, 60.0), step_m=10.0)
    left = dict(zip(band.knots_m.round(6), band.left_m, strict=True))
    assert left[25.0] == pytest.approx(30.0)
    assert left[32.0] == left[50.0] == left[68.0] == pytest.approx(10.0)


def test_steps_are_clipped_to_the_band_and_end_with_the_swath():
    band = Band.about(AXIS, 15.0, FIELD, step_m=10.0)
    here = np.array([[50.0, 34.0], [95.0, 20.0]])
    there = band.next_waypoint(here, np.array([np.pi / 4, 0.0]), 10.0)
    assert there[0] == pytest.approx([50.0 + 10.0 * np.cos(np.pi / 4), 35.0])
    assert there[1] == pytest.approx([100.0, 20.0])
    assert band.is_at_end(there).tolist() == [False, True]


def test_slope_along_any_heading_follows_from_pitch_and_roll():
    left_side_up = Attitude(np.array([0.1]), np.zeros(1), np.zeros(1))
    slopes = left_side_up.slope_along(np.array([[0.0], [np.pi / 2], [np.pi]]))
    assert slopes.ravel() == pytest.approx([0.0, np.tan(0.1), 0.0], abs=1e-12)


def test_an_attitude_is_that_of_the_plane_under_the_rover():
    grid = Grid((0.0, 0.0, 100.0, 100.0), 5.0)
    plane = Dem.on(grid, 0.2 * grid.x + np.zeros((len(grid.y), 1)))
    sensed = attitude_sensor(plane)(np.array([[50.0, 50.0], [50.0, 50.0]]), np.array([0.0, np.pi / 2]))
    assert sensed.pitch_rad == pytest.approx([-np.arctan(0.2), 0.0], abs=1e-9)
    assert sensed.roll_rad[1] == pytest.approx(-np.arctan(0.2))


def test_unknown_ground_is_taken_as_level_and_other_grids_are_refused():
    grid = Grid((0.0, 0.0, 100.0, 100.0), 5.0)
    holes = np.add.outer(grid.y, grid.x)
    holes[8:13, 8:13] = np.nan
    sensed = attitude_sensor(Dem.on(grid, holes))(np.array([[50.0, 50.0]]), np.zeros(1))
    assert sensed.pitch_rad.tolist() == [0.0]
    other = Dem.on(Grid((0.0, 0.0, 100.0, 100.0), 10.0), np.zeros((11, 11)))
    with pytest.raises(InputError, match="different grids"):
        attitude_sensor([Dem.on(grid, np.zeros(grid.shape)), other])
