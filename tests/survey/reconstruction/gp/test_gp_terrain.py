"""The terrain model: learn, predict, update, sample, forecast, save."""

from pathlib import Path

import numpy as np
import pytest
import shapely

from survey.core.errors import InputError
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.data.surface_points import SurfacePoints
from survey.reconstruction import GaussianProcessConfig
from survey.reconstruction.gp.gp_terrain import GaussianProcessTerrain
from survey.reconstruction.gp.mean import FunctionMean

CRS = "EPSG:32608"
GRID = Grid((0.0, 0.0, 120.0, 100.0), 4.0, CRS)
CONFIG = GaussianProcessConfig(fit=False, variance_m2=4.0, length_scale_m=20.0)


def height(xy: np.ndarray) -> np.ndarray:
    return 30.0 + 2.0 * np.sin(xy[:, 0] / 18.0) * np.cos(xy[:, 1] / 25.0)


def points(n: int, seed: int = 0) -> SurfacePoints:
    rng = np.random.default_rng(seed)
    xy = rng.uniform((0.0, 0.0), (120.0, 100.0), (n, 2))
    z = height(xy) + 0.05 * rng.standard_normal(n)
    return SurfacePoints(np.column_stack([xy, z]), sigma_m=0.05, crs=CRS, vertical_datum="EGM96 height")


# Two sizes: the dense engine carries the first, the fast one the second.
@pytest.fixture(scope="module", params=[250, 600])
def model(request: pytest.FixtureRequest) -> GaussianProcessTerrain:
    return GaussianProcessTerrain(CONFIG, bounds=GRID.bounds).fit(points(request.param))


def test_the_map_is_near_the_ground_and_says_how_near(model: GaussianProcessTerrain) -> None:
    result = model.grid(GRID)
    error = result.mean.elevation.ravel() - height(GRID.xy)
    # Some 40 independent patches: 95 % give or take 3.5, twice that allowed.
    assert np.mean(np.abs(error) < 1.96 * result.std.elevation.ravel()) > 0.88
    assert np.sqrt(np.mean(error**2)) < 0.15
    assert result.mean.vertical_datum == "EGM96 height"


def test_places_and_grid_agree(model: GaussianProcessTerrain) -> None:
    result = model.grid(GRID)
    for what, dem in (("mean", result.mean), ("std", result.std)):
        np.testing.assert_allclose(model.predict(GRID.xy, what), dem.elevation.ravel(), atol=1e-6)
    lower, upper = (model.predict(GRID.xy[:5], what) for what in ("lower", "upper"))
    np.testing.assert_allclose(upper - lower, 2 * 1.959964 * model.predict(GRID.xy[:5], "std"))


def test_an_update_is_a_fit_of_all(model: GaussianProcessTerrain) -> None:
    assert model.learned_ is not None
    n = len(model.learned_.process.data)
    both = points(n)
    more = points(40, seed=9)
    xyz = np.vstack([both.xyz, more.xyz])
    whole = GaussianProcessTerrain(CONFIG, bounds=GRID.bounds).fit(SurfacePoints(xyz, sigma_m=0.05, crs=CRS))
    grown = model.update(more)
    # The fast engine keeps its waves in an update and may choose others in a fit: its tolerance is a millimetre.
    np.testing.assert_allclose(grown.predict(GRID.xy), whole.predict(GRID.xy), atol=2e-3)
    np.testing.assert_allclose(grown.predict(GRID.xy, "std"), whole.predict(GRID.xy, "std"), atol=2e-3)


def test_samples_spread_like_the_map(model: GaussianProcessTerrain) -> None:
    drawn = model.sample(GRID, 60, np.random.default_rng(0))
    result = model.grid(GRID)
    z = (drawn - result.mean.elevation) / result.std.elevation
    # 60 draws of some 50 independent patches: 2 % of a standard deviation, five times that allowed.
    assert z.std() == pytest.approx(1.0, abs=0.1)


def test_slopes_are_those_of_the_map(model: GaussianProcessTerrain) -> None:
    slope, std = model.slope(GRID)
    places = GRID.xy
    east = 2.0 / 18.0 * np.cos(places[:, 0] / 18.0) * np.cos(places[:, 1] / 25.0)
    north = -2.0 / 25.0 * np.sin(places[:, 0] / 18.0) * np.sin(places[:, 1] / 25.0)
    expected = np.degrees(np.arctan(np.hypot(east, north)))
    error = np.abs(slope.elevation.ravel() - expected)
    assert np.median(error) < 0.5
    assert np.mean(error < 2.5 * std.elevation.ravel()) > 0.95


def test_the_volume_is_that_of_the_ground(model: GaussianProcessTerrain) -> None:
    polygon = shapely.box(20.0, 20.0, 100.0, 80.0)
    volume = model.volume(polygon, base_m=30.0)
    x, y = np.meshgrid(np.linspace(20, 100, 401), np.linspace(20, 80, 301))
    expected = float(np.mean(height(np.column_stack([x.ravel(), y.ravel()])) - 30.0) * polygon.area)
    assert volume.area_m2 == pytest.approx(polygon.area)
    assert abs(volume.mean_m3 - expected) < 4.0 * volume.std_m3
    # Far less than if the errors of all nodes were one.
    assert volume.std_m3 < 0.5 * polygon.area * float(model.predict(polygon.centroid.coords, "std")[0]) + 20.0


def test_a_forecast_is_what_the_map_then_says(model: GaussianProcessTerrain) -> None:
    more = points(30, seed=4)
    forecast = model.forecast(more.xy, more.sigma_z, GRID)
    np.testing.assert_allclose(forecast, model.update(more).grid(GRID).std.elevation, atol=1e-9)


def test_it_comes_back_from_its_file(model: GaussianProcessTerrain, tmp_path: Path) -> None:
    model.save(tmp_path / "one.npz")
    model.save(tmp_path / "two.npz")
    assert (tmp_path / "one.npz").read_bytes() == (tmp_path / "two.npz").read_bytes()
    back = GaussianProcessTerrain.load(tmp_path / "one.npz")
    # Standard deviations go through a square root and back: one rounding.
    np.testing.assert_allclose(back.predict(GRID.xy), model.predict(GRID.xy), atol=1e-9)
    np.testing.assert_allclose(back.predict(GRID.xy, "std"), model.predict(GRID.xy, "std"), atol=1e-9)


def test_a_prior_comes_back_too_and_a_function_is_refused(tmp_path: Path) -> None:
    coarse = Grid((-50.0, -50.0, 200.0, 150.0), 50.0, CRS)
    prior = Dem.on(coarse, np.full(coarse.shape, 29.0))
    config = CONFIG.model_copy(update={"prior_sigma_m": 1.0})
    fitted = GaussianProcessTerrain(config, prior).fit(points(60))
    fitted.save(tmp_path / "model.npz")
    back = GaussianProcessTerrain.load(tmp_path / "model.npz")
    places = GRID.xy[::7]
    np.testing.assert_allclose(back.predict(places, "std"), fitted.predict(places, "std"), atol=1e-9)
    function = GaussianProcessTerrain(CONFIG, FunctionMean(height)).fit(points(60))
    with pytest.raises(InputError, match="function"):
        function.save(tmp_path / "other.npz")
    assert not (tmp_path / "other.npz").exists()


@pytest.mark.parametrize("content", [b"", b"no model", b"PK\x03\x04 half"])
def test_damaged_files_are_named(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "model.npz"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"model\.npz"):
        GaussianProcessTerrain.load(path)


def test_nothing_can_be_asked_before_fit() -> None:
    with pytest.raises(InputError, match="call fit first"):
        GaussianProcessTerrain().predict([[0.0, 0.0]])


def test_an_unknown_quantity_is_refused(model: GaussianProcessTerrain) -> None:
    with pytest.raises(InputError, match="median"):
        model.predict([[1.0, 1.0]], "median")  # type: ignore[arg-type]
