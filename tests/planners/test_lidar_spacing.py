"""Swath spacing of a LiDAR survey: beams on known ground, and the spacing that an error allows."""

from dataclasses import replace

import numpy as np
import pytest

from planners.prediction.assumptions import MapAssumptions
from planners.swaths import lidar_spacing
from planners.swaths.lidar_spacing import (
    LidarSurvey,
    SpacingModel,
    height_sigma_m,
    paper_range_m,
    widest_spacing,
)
from sim.instruments.lidar import HeightRaster
from survey import CapacityError, Dem, Grid, InputError, SurveyArea
from survey.core.streams import stream
from survey.data.sensors.lidar import Scanner
from survey.terrain import random_dem, satellite_copy

CRS = "EPSG:32608"
SCANNER = Scanner(elevation_deg=tuple(np.linspace(-25.0, 3.0, 12).tolist()), n_columns=60)
SURVEY = LidarSurvey(scanner=SCANNER, scan_step_m=4.0, farthest_m=20.0)
GRID = Grid((0.0, 0.0, 80.0, 80.0), 1.0, CRS)


@pytest.fixture(scope="module", autouse=True)
def few_patches():
    """Half as many pieces of terrain, so that the tests are fast."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lidar_spacing, "N_PATCHES", 3)
        yield


def returns(terrain, sensor=(40.0, 40.0, 1.5)):
    return lidar_spacing._returns(terrain, SURVEY, np.array([sensor]), np.zeros((1, 2)))


def test_beams_meet_level_ground_where_geometry_says():
    found = returns(Dem.on(GRID, np.zeros((81, 81))))
    expected = 1.5 / np.tan(np.radians(-np.array(SCANNER.elevation_deg)))
    slant = 1.5 / np.sin(np.radians(-np.array(SCANNER.elevation_deg)))
    met = np.unique(np.hypot(*(found[:, :2] - 40.0).T).round(6))
    assert met == pytest.approx(np.sort(expected[(slant >= 3.0) & (slant <= 20.0)]), abs=1e-5)
    assert np.abs(found[:, 2]).max() < 1e-9


def test_beams_meet_rough_ground_where_the_simulator_has_it():
    terrain = random_dem("squared-exponential", GRID, stream(5), 8.0, length_scale_m=12.0)
    sensor = np.array([40.0, 40.0, float(terrain.at([[40.0, 40.0]])[0]) + 1.5])
    found = returns(terrain, tuple(sensor))
    ray = found[:, :3] - sensor
    far = np.linalg.norm(ray, axis=1)
    simulated = HeightRaster.of(terrain).hits(np.tile(sensor, (len(ray), 1)), ray / far[:, None], 100.0)
    assert len(found) > 200
    assert np.quantile(np.abs(simulated.range_m - far), 0.9) < 0.1


def test_ground_behind_a_wall_returns_nothing():
    wall = np.zeros((81, 81))
    wall[:, 50] = 3.0
    found = returns(Dem.on(GRID, wall))
    assert found[:, 0].max() < 51.0
    assert found[:, 0].min() < 25.0


def test_heights_err_by_the_range_below_and_by_the_direction_far_away():
    below, far = height_sigma_m(np.array([[0.0, 0.0, -2.0], [1000.0, 0.0, -2.0]]), SCANNER)
    assert below == pytest.approx(SCANNER.range_sigma_m)
    assert far == pytest.approx(1000.0 * np.radians(SCANNER.angle_sigma_deg), rel=1e-3)


def test_the_papers_range_grows_with_the_error_that_is_allowed():
    distance = np.arange(0.5, 40.0)
    assert paper_range_m(distance, (0.01 * distance) ** 2, 0.05) < paper_range_m(
        distance, (0.01 * distance) ** 2, 0.1
    )
    assert paper_range_m(distance, np.full(40, 1.0), 0.01) == 0.0


@pytest.fixture(scope="module")
def site():
    """An area of 200 m with a prior of 25 m cells."""
    terrain = random_dem(
        "matern-3/2", Grid((0.0, 0.0, 200.0, 200.0), 5.0, CRS), stream(3), 12.0, length_scale_m=60.0
    )
    prior = satellite_copy(terrain, rng=stream(4), cell_m=25.0, sigma_m=0.3)
    return SurveyArea.rectangle((0.0, 0.0, 200.0, 200.0), CRS), prior


@pytest.fixture(scope="module")
def model(site):
    return SpacingModel.of(*site, SURVEY, assumed=MapAssumptions(prior_sigma_m=0.3))


def test_the_error_grows_with_the_spacing_and_with_the_probability(site, model):
    close, far = model.rmse_m(8.0), model.rmse_m(40.0)
    assert 0.0 < close < far
    smoother = SpacingModel.of(*site, SURVEY, probability=0.5, assumed=MapAssumptions(prior_sigma_m=0.3))
    assert smoother.rmse_m(40.0) < far


def test_a_scanner_that_sees_less_maps_worse(model):
    shorter = replace(SURVEY, farthest_m=10.0)
    assert replace(model, survey=shorter).rmse_m(30.0) > model.rmse_m(30.0)


def test_the_widest_spacing_meets_the_error_and_the_next_one_does_not(site, model):
    wish_m = 0.5 * (model.rmse_m(10.0) + model.rmse_m(40.0))
    found = widest_spacing(*site, SURVEY, wish_m, assumed=MapAssumptions(prior_sigma_m=0.3))
    assert found.rmse_m == model.rmse_m(found.spacing_m) <= wish_m < model.rmse_m(1.05 * found.spacing_m)
    assert 0.0 < found.range_m <= SURVEY.farthest_m * 1.5


def test_an_error_that_no_spacing_meets_comes_with_what_the_smallest_one_reaches(site):
    found = widest_spacing(*site, SURVEY, 1e-4, assumed=MapAssumptions(prior_sigma_m=0.3))
    assert found.rmse_m > 1e-4
    assert found.spacing_m == 5.0


def test_metres_that_are_not_those_of_the_ground_are_refused(site):
    _, prior = site
    mercator = SurveyArea.rectangle((0.0, 8_399_000.0, 1000.0, 8_400_000.0), "EPSG:3857")
    with pytest.raises(InputError, match="plan in a UTM zone"):
        widest_spacing(mercator, prior, SURVEY, 0.1)


def test_a_lattice_that_is_too_fine_is_refused_before_terrain_is_drawn():
    prior = Dem.on(Grid((0.0, 0.0, 600.0, 600.0), 30.0, CRS), np.zeros((21, 21)))
    area = SurveyArea.rectangle((100.0, 100.0, 500.0, 500.0), CRS)
    with pytest.raises(CapacityError, match="give the mission's map a larger step"):
        widest_spacing(area, prior, replace(SURVEY, node_step_m=0.05), 0.1)


def test_a_swath_that_never_meets_the_error_reaches_nowhere():
    distance_m, squared_m2 = np.array([0.5, 1.5, 2.5]), np.array([0.02, 0.01, 0.04])
    assert lidar_spacing._range_m(distance_m, squared_m2, 0.1) == 0.0
    assert lidar_spacing._range_m(distance_m, squared_m2, 0.15) == 1.5
    assert lidar_spacing._range_m(distance_m, squared_m2, 1.0) == 2.5
