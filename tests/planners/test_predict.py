import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from planners import LawnmowerConfig, WavyConfig, plan, predict_error, terrain_kernel
from planners.prediction.error_model import ErrorModel
from survey import ConfigError, Dem, Grid, InputError, Leg, Route, SurveyArea
from survey.reconstruction.gp.kernels import Matern32, SquaredExponential
from survey.terrain.random_fields import squared_exponential_field

CRS = "EPSG:32608"
SITE = SurveyArea.rectangle((0.0, 0.0, 600.0, 600.0), CRS)
KERNEL = SquaredExponential(30.0, 120.0)


def test_one_sample_of_a_known_covariance():
    # Two places 100 m apart see one another with k = 30 exp(-(100/120)² / 2); with an unknown
    # constant mean the variance of the difference is what is left: 2 (v − k) + σ².
    area = SurveyArea.rectangle((0.0, 0.0, 100.0, 100.0), CRS)
    model = ErrorModel.of(area, KERNEL, noise_m=0.5, cell_m=50.0)
    at = np.array([[25.0, 25.0]])
    distance = np.hypot(*(model.nodes - at).T)
    expected = 2.0 * (30.0 - 30.0 * np.exp(-0.5 * (distance / 120.0) ** 2)) + 0.25
    # At the sampled node itself the map still errs by the noise.
    assert model.variance(at) == pytest.approx(expected, rel=1e-9)


def test_prediction_is_the_spread_of_actual_errors():
    """Maps of fields drawn from the kernel err by what was predicted for their route."""
    rng = np.random.default_rng(5)
    kernel = Matern32(9.0, 150.0)
    route = plan(SITE, None, LawnmowerConfig(swaths=4))
    model = ErrorModel.of(SITE, kernel, noise_m=0.3, sample_step_m=20.0, cell_m=40.0)
    samples = route.sample(20.0).xy
    both = np.vstack([samples, model.nodes])
    fields = np.linalg.cholesky(
        kernel.covariance(both, both) + 1e-9 * np.eye(len(both))
    ) @ rng.standard_normal((len(both), 200))
    heights = fields[: len(samples)] + 0.3 * rng.standard_normal((len(samples), 200))
    inverse = np.linalg.inv(kernel.covariance(samples, samples) + 0.09 * np.eye(len(samples)))
    ones = inverse.sum(axis=1)
    mean = ones @ heights / ones.sum()
    mapped = mean + kernel.covariance(model.nodes, samples) @ inverse @ (heights - mean)
    actual = np.sqrt(np.mean((mapped - fields[len(samples) :]) ** 2))
    # 200 fields of some tens of independent patches: the root mean square is known to about 1 %.
    assert model.rmse_m(route) == pytest.approx(actual, rel=0.03)


def test_infinite_lines_of_a_separable_kernel_agree_with_one_dimension():
    """Between long lines a squared exponential is known as a 1-D process sampled at the spacing."""
    area = SurveyArea.rectangle((0.0, 0.0, 1000.0, 1000.0), CRS)
    kernel = SquaredExponential(1.0, 100.0)
    route = plan(area, None, LawnmowerConfig(swaths=8))
    model = ErrorModel.of(area, kernel, noise_m=0.0, sample_step_m=12.5, cell_m=25.0)
    y = model.grid.y
    lines = 62.5 + 125.0 * np.arange(8)
    k = np.exp(-0.5 * ((lines[:, None] - lines) / 100.0) ** 2)
    cross = np.exp(-0.5 * ((y[:, None] - lines) / 100.0) ** 2)
    one_dimensional = 1.0 - np.einsum("ij,jk,ik->i", cross, np.linalg.inv(k), cross)
    x = model.grid.x[np.abs(model.grid.x - 500.0) < 30.0]
    rows = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    of_rows = model.variance(route.sample(12.5).xy, at=rows).reshape(len(y), len(x)).mean(axis=1)
    inner = (y > 150.0) & (y < 850.0)
    # Unknown mean and the millesimal noise that keeps the matrix regular add a few 1e-4 of the variance.
    assert of_rows[inner] == pytest.approx(one_dimensional[inner], abs=2e-3)


@given(noise_m=st.floats(0.0, 2.0), more=st.floats(0.05, 2.0))
@settings(max_examples=15)
def test_more_noise_never_predicts_a_better_map(noise_m, more):
    route = plan(SITE, None, LawnmowerConfig(swaths=3))
    quiet, loud = (
        ErrorModel.of(SITE, KERNEL, noise_m=n, sample_step_m=30.0, cell_m=60.0).rmse_m(route)
        for n in (noise_m, noise_m + more)
    )
    assert loud >= quiet - 1e-9


def test_noise_hurts_even_where_samples_lie():
    route = plan(SITE, None, LawnmowerConfig(swaths=12))
    error = predict_error(route, SITE, KERNEL, noise_m=0.5)
    assert 0.05 < error.rmse_m < 0.5
    assert error.rmse_m <= error.p95_m <= error.worst_m


def test_fewer_samples_stand_for_all_when_noise_is_averaged():
    route = plan(SITE, None, WavyConfig(swaths=6, wavelength_m=120.0))
    model = ErrorModel.of(SITE, KERNEL, noise_m=0.3, sample_step_m=5.0)
    # 350 samples of a 3.6 km route are 10 m apart, a twelfth of the length scale and of a wave: worth all to 2 %.
    assert model.rmse_m(route, 350) == pytest.approx(model.rmse_m(route), rel=0.02)


def test_long_routes_are_predicted_from_the_samples_near_each_place():
    route = plan(SITE, None, LawnmowerConfig(swaths=20))
    model = ErrorModel.of(SITE, Matern32(30.0, 60.0), noise_m=0.1, sample_step_m=20.0)
    # 150 samples of 12.6 km lie 84 m apart on swaths that are 30 m apart.
    assert model.rmse_m(route, 150) == pytest.approx(model.rmse_m(route), rel=0.08)


def test_pictures_are_predicted_from_the_samples_near_each_place(monkeypatch):
    """At the places of a picture, from those about each; the errors that are stated are those from all samples."""
    grid = Grid((0.0, 0.0, 600.0, 600.0), 10.0, CRS)
    dem = squared_exponential_field(grid, np.random.default_rng(3), length_scale_m=150.0)
    route = plan(SITE, None, LawnmowerConfig(swaths=8))
    model = ErrorModel.from_prior(SITE, dem.block_mean(60.0))
    near = model.error(route)
    monkeypatch.setattr("planners.prediction.error_distribution._MOST_FOR_PICTURES", 1000)
    every = model.error(route)
    assert len(model._samples(route, None)[0]) > 400
    assert near.rmse_m == every.rmse_m
    assert not np.array_equal(near.std.elevation, every.std.elevation)
    np.testing.assert_allclose(near.std.elevation, every.std.elevation, rtol=0.01)


def test_few_good_samples_stand_for_many_on_long_routes():
    route = plan(SITE, None, LawnmowerConfig(swaths=6))
    few = ErrorModel.of(SITE, KERNEL, noise_m=0.3, sample_step_m=5.0)
    many = ErrorModel.of(SITE, KERNEL, noise_m=0.3 * np.sqrt(5.0), sample_step_m=1.0)
    # Five times the samples with five times the variance carry the same information, up to how samples meet at ends.
    assert many.rmse_m(route) == pytest.approx(few.rmse_m(route), rel=0.01)


@pytest.mark.parametrize("swaths", [15, 30])
def test_swaths_as_far_apart_as_the_cells_predict_no_other_map(swaths):
    """Thirty swaths meet the centres of all cells, of which thirty lie along the side."""
    rough = SquaredExponential(30.0, 15.0)
    before, meant, after = (
        predict_error(
            plan(SITE, None, LawnmowerConfig(swaths=n)), SITE, rough, noise_m=0.1, sample_step_m=20.0
        )
        for n in (swaths - 1, swaths, swaths + 1)
    )
    for number in ("rmse_m", "p95_m"):
        errors = [getattr(error, number) for error in (before, meant, after)]
        assert errors[1] == pytest.approx(0.5 * (errors[0] + errors[2]), rel=0.05)
    drawn = np.sqrt(np.mean(np.square(meant.std.elevation)))
    assert drawn == pytest.approx(meant.rmse_m, rel=0.02)


def test_every_rover_s_samples_count():
    line = [[0.0, 150.0], [600.0, 150.0]]
    other = [[0.0, 450.0], [600.0, 450.0]]
    one = Route((Leg("swath", line),), CRS, "lines")
    two = Route((Leg("swath", line), Leg("swath", other, rover=1)), CRS, "lines")
    errors = [predict_error(route, SITE, KERNEL, noise_m=0.1).rmse_m for route in (one, two)]
    assert errors[1] < 0.7 * errors[0]


def test_the_map_covers_the_free_ground_only():
    area = SurveyArea(SITE.polygon, CRS, no_go=(shapely.box(0.0, 0.0, 200.0, 200.0),))
    route = plan(area, None, LawnmowerConfig(swaths=4))
    std = predict_error(route, area, KERNEL, noise_m=0.1).std
    assert std.shape == (30, 30)
    assert np.isnan(std.at([[100.0, 100.0]])).all()
    assert np.isfinite(std.at([[400.0, 400.0]])).all()


def test_plans_carry_the_predicted_error():
    route = plan(SITE, None, LawnmowerConfig(swaths=5), kernel=KERNEL, noise_m=0.2)
    assert route.prediction["rmse_m"] == predict_error(route, SITE, KERNEL, noise_m=0.2).rmse_m
    assert "rmse_m" not in plan(SITE, None, LawnmowerConfig(swaths=5)).prediction


def test_a_kernel_is_fitted_to_the_prior():
    grid = Grid((0.0, 0.0, 600.0, 600.0), 10.0, CRS)
    dem = squared_exponential_field(grid, np.random.default_rng(3), length_scale_m=150.0)
    kernel = terrain_kernel(dem.block_mean(60.0), SITE)
    # One field of sixteen patches of a length scale gives it to a factor of about two.
    assert 75.0 < kernel.length_scales_m[0] < 450.0


def test_a_kernel_of_many_cells_is_that_of_groups_of_them(rng):
    grid = Grid((5.0, 5.0, 1495.0, 1495.0), 10.0, "EPSG:32608")
    terrain = squared_exponential_field(grid, rng, length_scale_m=120.0)
    kernel = terrain_kernel(terrain, SurveyArea.rectangle((0.0, 0.0, 1500.0, 1500.0), "EPSG:32608"))
    assert kernel.length_scales_m[0] == pytest.approx(120.0, rel=0.2)
    assert np.sqrt(kernel.variance_m2) == pytest.approx(terrain.elevation.std(), rel=0.3)


def test_rough_ground_around_the_area_does_not_enter_its_kernel(rng):
    grid = Grid((10.0, 10.0, 590.0, 590.0), 20.0, CRS)
    smooth = squared_exponential_field(grid, rng, length_scale_m=150.0)
    disc = SurveyArea(shapely.Point(300.0, 300.0).buffer(250.0), CRS)
    far = ~shapely.contains_xy(disc.polygon.buffer(25.0), smooth.xy).reshape(grid.shape)
    walls = Dem.on(grid, smooth.elevation + 40.0 * far * rng.standard_normal(grid.shape))
    route = plan(disc, None, LawnmowerConfig(swaths=4))
    errors = [
        predict_error(route, disc, terrain_kernel(dem, disc), noise_m=0.1).rmse_m for dem in (smooth, walls)
    ]
    assert errors[1] == pytest.approx(errors[0], rel=0.01)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [({"noise_m": -0.1}, "noise"), ({"noise_m": 0.1, "sample_step_m": 0.0}, "sample_step_m")],
)
def test_settings_that_make_no_sense_are_refused(wrong, message):
    route = plan(SITE, None, LawnmowerConfig(swaths=2))
    with pytest.raises(ConfigError, match=message):
        predict_error(route, SITE, KERNEL, **wrong)


def test_a_route_in_another_system_is_refused():
    route = Route((Leg("swath", [[0.0, 0.0], [1.0, 1.0]]),), "EPSG:32633", "line")
    with pytest.raises(InputError, match="different systems"):
        predict_error(route, SITE, KERNEL, noise_m=0.1)


def test_a_prior_without_heights_on_the_area_is_refused():
    far = Dem.on(Grid((5000.0, 0.0, 5600.0, 600.0), 50.0, CRS), np.zeros((13, 13)))
    with pytest.raises(InputError, match="0 known cells"):
        terrain_kernel(far, SITE)
