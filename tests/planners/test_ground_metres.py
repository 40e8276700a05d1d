import numpy as np
import pyproj
import pytest
import shapely

from planners import LawnmowerConfig, Rover, WavyConfig, drivable, plan
from planners.config import in_grid_metres, settings_factor
from planners.routes.rover import Crew, crew_in_grid_metres
from survey import Dem, Grid, SurveyArea
from survey.core.transformation import transformed

UTM = "EPSG:32633"
SITE = shapely.box(500_000.0, 8_700_000.0, 500_600.0, 8_700_400.0)  # at 78.4° north


def site_in(crs: str) -> SurveyArea:
    # Corners along the sides, so that sides stay where they are.
    shape = shapely.segmentize(SITE, 50.0)
    return SurveyArea(
        shapely.transform(shape, lambda xy: transformed(xy, pyproj.CRS(UTM), pyproj.CRS(crs), "the site")),
        crs,
    )


@pytest.mark.parametrize("crs", ["EPSG:3857", "EPSG:3413", "EPSG:3995"])
def test_lengths_times_and_energies_are_those_of_the_ground_in_every_projection(crs):
    config = LawnmowerConfig(spacing_m=55.0)
    here, there = (plan(site_in(c), None, config) for c in (UTM, crs))
    for fact in ("length_m", "time_s", "energy_j"):
        assert there.prediction[fact] == pytest.approx(here.prediction[fact], rel=3e-3)
    assert len(there.swaths) == len(here.swaths)


def test_a_spacing_is_metres_on_the_ground_where_the_scale_differs_by_more_than_a_hundredth():
    mercator = plan(site_in("EPSG:3857"), None, LawnmowerConfig(spacing_m=55.0))
    factor = mercator.prediction["map_scale"]
    assert factor == pytest.approx(1.0 / np.cos(np.radians(78.37)), rel=0.01)
    assert mercator.spacing_m == pytest.approx(50.0 * factor, rel=0.01)
    assert settings_factor(site_in(UTM)) == 1.0
    assert plan(site_in(UTM), None, LawnmowerConfig(spacing_m=55.0)).spacing_m == 50.0


def test_the_scale_is_stated_and_warned_of(caplog):
    plan(site_in(UTM), None, LawnmowerConfig(swaths=2))
    assert not caplog.records
    plan(site_in("EPSG:3857"), None, LawnmowerConfig(swaths=2))
    assert "times those on the ground" in caplog.text


def test_slopes_are_those_of_the_ground():
    area = site_in("EPSG:3857")
    xmin = area.bounds[0]
    grid = Grid.over(area.bounds, 50.0, area.crs)
    factor = settings_factor(area)
    # Rises by tan 20° per metre on the ground: by much less per grid metre.
    ramp = np.tan(np.radians(20.0)) / factor * (grid.x - xmin)
    dem = Dem.on(grid, np.broadcast_to(ramp, grid.shape))
    assert drivable(area, Rover(max_pitch_deg=21.0), dem).left_out_share(area) < 0.05
    with pytest.raises(ValueError, match="too steep"):
        drivable(area, Rover(max_pitch_deg=19.0), dem)


def test_pieces_left_out_are_measured_on_the_ground():
    area = site_in("EPSG:3857")
    xmin, ymin, xmax, ymax = area.bounds
    middle = 0.5 * (xmin + xmax)
    wall = shapely.box(middle - 20.0, ymin - 1.0, middle + 20.0, ymax + 1.0)
    split = SurveyArea(area.polygon, area.crs, (wall,))
    (piece,) = drivable(split).left_out
    assert piece.area_m2 == pytest.approx(0.5 * 600.0 * 400.0, rel=0.05)


def test_only_horizontal_lengths_are_converted():
    wave = in_grid_metres(WavyConfig(spacing_m=40.0, wavelength_m=90.0), 2.0)
    assert (wave.spacing_m, wave.wavelength_m, wave.steepness) == (80.0, 180.0, 0.6)
    assert in_grid_metres(LawnmowerConfig(swaths=4), 2.0) == LawnmowerConfig(swaths=4)


def test_energy_for_a_grid_metre_is_smaller_by_the_factor():
    rover = Rover(turn_radius_m=3.0, speed_m_s=0.5)
    on_grid = crew_in_grid_metres(Crew(rover), 4.0).rover
    assert on_grid.flat_j_per_m == pytest.approx(rover.flat_j_per_m / 4.0)
    assert (on_grid.turn_radius_m, on_grid.speed_m_s) == (12.0, 2.0)


def test_a_route_is_as_long_on_the_ground_in_every_projection():
    route = plan(site_in("EPSG:3857"), None, LawnmowerConfig(swaths=3))
    assert route.ground_length_m == pytest.approx(route.prediction["length_m"])
    assert route.length_m > 4.0 * route.ground_length_m
