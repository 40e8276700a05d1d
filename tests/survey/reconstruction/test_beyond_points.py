"""Far beyond the points a map states what they cannot show; near them it stays as it is."""

import numpy as np
import pytest
import shapely
from pyproj import CRS

from survey import Dem, Grid, SurfacePoints, SurveyArea, reconstruct
from survey.core.arrays import FloatArray
from survey.reconstruction.beyond_points import BeyondPoints, beyond_sentences, widened_beyond
from survey.reconstruction.gp.config import GaussianProcessConfig
from survey.reconstruction.gp.gp_terrain import GaussianProcessTerrain
from survey.reconstruction.terrain_map import BEYOND, UNSEEN, Reconstruction
from survey.scoring.standards.map_classes import certificate, own_claim

CRS_UTM = CRS.from_epsg(32608)
EXTENT_M = 400.0
GRID = Grid((-1200.0, -1200.0, 1600.0, 1600.0), 100.0, CRS_UTM)


def ground(xy: FloatArray) -> FloatArray:
    """Return heights with waves of 300 m, and of 6 km, which points on 400 m show as a slope."""
    x, y = xy.T
    return 5.0 * np.sin(x / 50.0) * np.cos(y / 60.0) + 150.0 * np.sin((x + 0.5 * y) / 1000.0)


@pytest.fixture(scope="module")
def points() -> SurfacePoints:
    rng = np.random.default_rng(3)
    corners = EXTENT_M * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
    xy = np.concatenate([corners, rng.uniform(0.0, EXTENT_M, (246, 2))])
    return SurfacePoints(np.column_stack([xy, ground(xy)]), sigma_m=0.05, crs=CRS_UTM)


@pytest.fixture(scope="module")
def mapped(points: SurfacePoints) -> Reconstruction:
    return reconstruct(points, GRID)


def test_far_beyond_the_points_the_standard_deviation_of_one_smooth_kernel_holds(
    points: SurfacePoints,
) -> None:
    config = GaussianProcessConfig(family="squared-exponential")
    mapped = reconstruct(points, GRID, config=config)
    plain_map = GaussianProcessTerrain(config, None, "gp", bounds=GRID.bounds).fit(points).grid(GRID)
    distance = BeyondPoints.of(points.xy, points.z).distance_m(GRID.xy).reshape(GRID.shape)
    error = np.abs(mapped.mean.elevation - ground(GRID.xy).reshape(GRID.shape))
    far = distance > 0.5 * EXTENT_M
    assert np.mean(error[far] < 1.96 * plain_map.std.elevation[far]) < 0.7
    assert np.mean(error[far] < 1.96 * mapped.std.elevation[far]) > 0.93
    near = distance < 0.25 * EXTENT_M
    np.testing.assert_array_equal(mapped.std.elevation[near], plain_map.std.elevation[near])
    np.testing.assert_array_equal(mapped.mean.elevation, plain_map.mean.elevation)
    np.testing.assert_array_equal(mapped.support, plain_map.support)


def test_the_record_and_the_claim_name_the_share_and_the_distance(mapped: Reconstruction) -> None:
    facts = mapped.diagnostics[BEYOND]
    assert facts["share"] == pytest.approx(0.946, abs=0.001)
    assert facts["farthest_m"] == pytest.approx(1200.0 * 2.0**0.5)
    assert beyond_sentences(mapped)[0] in own_claim(mapped)
    assert beyond_sentences(mapped)[0].startswith("95 % of the ground lies 100 to 1,697 m beyond")
    certified = certificate(mapped)
    assert certified is not None
    assert not any(verdict.met for verdict in (*certified.absolute, *certified.relative))


def test_a_map_of_the_ground_about_the_points_stays_as_it_is(points: SurfacePoints) -> None:
    grid = Grid((-20.0, -20.0, 420.0, 420.0), 20.0, CRS_UTM)
    plain = GaussianProcessTerrain(GaussianProcessConfig(), None, "gp", bounds=grid.bounds)
    plain_map = plain.fit(points).grid(grid)
    assert widened_beyond(plain_map, points.xy, points.z, None) is plain_map
    assert beyond_sentences(plain_map) == []


def test_stated_hyperparameters_and_a_prior_are_taken_at_their_word(points: SurfacePoints) -> None:
    stated = GaussianProcessConfig(fit=False, variance_m2=100.0, length_scale_m=80.0)
    prior = Dem.on(Grid((-1500.0, -1500.0, 2000.0, 2000.0), 250.0, CRS_UTM), np.full((15, 15), 20.0))
    for result in (reconstruct(points, GRID, config=stated), reconstruct(points, GRID, prior)):
        assert BEYOND not in result.diagnostics


def test_the_share_counts_within_the_area(points: SurfacePoints) -> None:
    flat = Dem.on(GRID, np.zeros(GRID.shape))
    result = Reconstruction(flat, flat, np.full(GRID.shape, UNSEEN), "gp", {})
    about = SurveyArea(shapely.box(0.0, 0.0, 400.0, 400.0), CRS_UTM)
    assert widened_beyond(result, points.xy, points.z, about) is result
    half = SurveyArea(shapely.box(-1000.0, 0.0, 400.0, 400.0), CRS_UTM)
    assert 0.5 < widened_beyond(result, points.xy, points.z, half).diagnostics[BEYOND]["share"] < 0.8


@pytest.mark.parametrize(
    "xy",
    [
        np.array([[0.0, 0.0], [100.0, 0.0], [0.0, 1.0]]),
        np.column_stack([np.repeat([0.0, 100.0], 20), np.tile(np.arange(20.0), 2)]),
        np.column_stack([np.linspace(0.0, 100.0, 50), np.zeros(50)]),
    ],
)
def test_any_arrangement_of_points_shows_a_slope(xy: FloatArray) -> None:
    beyond = BeyondPoints.of(xy, 0.2 * xy[:, 0])
    assert beyond.extent_m == 100.0
    assert beyond.per_metre == pytest.approx(0.2, rel=0.1)
    np.testing.assert_allclose(beyond.distance_m(np.array([[-50.0, 0.0], [50.0, 0.0]])), [50.0, 0.0])
