"""From points to a map in one call: what it gives, and what it refuses."""

from pathlib import Path

import numpy as np
import pytest
import rasterio

from survey.core.config import validated
from survey.core.errors import ConfigError, InputError
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.data.surface_points import SurfacePoints
from survey.reconstruction import GaussianProcessConfig, reconstruct
from survey.reconstruction.gp.mean import ConstantMean
from survey.reconstruction.terrain_map import MEASURED, UNSEEN

CRS = "EPSG:32608"
GRID = Grid((0.0, 0.0, 100.0, 100.0), 2.0, CRS)
FIXED = GaussianProcessConfig(fit=False, variance_m2=9.0, length_scale_m=15.0)


def points(xy: object = None, **changes: object) -> SurfacePoints:
    places = (
        np.random.default_rng(0).uniform(0.0, 100.0, (300, 2)) if xy is None else np.asarray(xy, dtype=float)
    )
    z = 3.0 * np.sin(places[:, 0] / 20.0)
    values: dict[str, object] = {"sigma_m": 0.1, "crs": CRS} | changes
    return SurfacePoints(np.column_stack([places, z]), **values)  # type: ignore[arg-type]


@pytest.mark.parametrize("method", ["gp", "dense", "tin"])
def test_every_method_maps_the_ground(method: str) -> None:
    result = reconstruct(points(), GRID, method=method, config=None if method == "tin" else FIXED)
    error = result.mean.elevation - 3.0 * np.sin(GRID.x / 20.0)
    known = np.isfinite(error)
    assert known.mean() > 0.85
    assert np.sqrt(np.mean(error[known] ** 2)) < 0.25
    assert result.method == method


def test_everything_is_fitted_by_default_and_said() -> None:
    result = reconstruct(points(), GRID)
    assert {"family", "nugget_m", "log_marginal_likelihood"} <= set(result.hyperparameters)
    assert {"outliers", "calibration", "engine", "n_points"} <= set(result.diagnostics)


def test_far_from_points_it_says_unseen_and_returns_the_prior() -> None:
    corner = points(np.random.default_rng(1).uniform(0.0, 20.0, (60, 2)))
    result = reconstruct(corner, GRID, ConstantMean(7.0), config=FIXED)
    assert result.support[0, -1] == UNSEEN
    assert result.support[-3, 3] == MEASURED
    # 80 m are five length scales.
    assert result.mean.elevation[0, -1] == pytest.approx(7.0, abs=1e-3)
    assert result.std.elevation[0, -1] == pytest.approx(3.0, abs=1e-3)


def test_other_quantities_are_mapped_like_heights(tmp_path: Path) -> None:
    xy = np.random.default_rng(2).uniform(0.0, 100.0, (80, 2))
    warm = points(
        xy,
        values={"temperature_c": -5.0 + xy[:, 1] / 50.0},
        value_sigmas={"temperature_c": np.full(80, 0.05)},
    )
    result = reconstruct(warm, GRID, config=FIXED, value="temperature_c")
    assert result.quantity == "temperature_c"
    assert result.mean.elevation[25, 25] == pytest.approx(-4.0, abs=0.1)
    assert "°C" in repr(result)
    result.write(tmp_path)
    with rasterio.open(tmp_path / "dem.tif") as written:
        assert written.units == (None, None)
    with pytest.raises(InputError, match="temperature_c"):
        reconstruct(warm, GRID, value="humidity_percent")
    with pytest.raises(InputError, match="standard deviation"):
        reconstruct(points(xy, values={"temperature_c": xy[:, 0]}), GRID, value="temperature_c")


def test_outside_the_area_there_is_no_map() -> None:
    area = SurveyArea.rectangle((0.0, 0.0, 50.0, 50.0), CRS)
    result = reconstruct(points(), GRID, config=FIXED, area=area)
    assert np.isnan(result.mean.elevation[0, -1])
    assert np.isfinite(result.mean.elevation[-1, 0])
    with pytest.raises(InputError, match="no node"):
        reconstruct(points(), GRID, config=FIXED, area=SurveyArea.rectangle((900.0, 0.0, 990.0, 50.0), CRS))


def test_a_prior_carries_the_map_where_no_point_is() -> None:
    coarse = Grid((-30.0, -30.0, 150.0, 150.0), 30.0, CRS)
    east = np.meshgrid(coarse.x, coarse.y)[0]
    prior = Dem.on(coarse, 3.0 * np.sin(east / 20.0))
    corner = points(np.random.default_rng(1).uniform(0.0, 20.0, (60, 2)))
    result = reconstruct(corner, GRID, prior, config=FIXED)
    assert result.mean.elevation[0, -1] == pytest.approx(prior.at([[100.0, 100.0]])[0], abs=1e-3)


def test_repeated_points_count_as_often_as_they_were_measured() -> None:
    once = points([[20.0, 20.0], [60.0, 70.0], [80.0, 30.0]])
    twice = points([[20.0, 20.0]] * 2 + [[60.0, 70.0]] * 2 + [[80.0, 30.0]] * 2)
    single, double = (reconstruct(p, GRID, ConstantMean(0.0), config=FIXED) for p in (once, twice))
    # Two measurements of σ = 0.1 m are one of 0.1/√2.
    exact = reconstruct(
        points([[20.0, 20.0], [60.0, 70.0], [80.0, 30.0]], sigma_m=0.1 / np.sqrt(2.0)),
        GRID,
        ConstantMean(0.0),
        config=FIXED,
    )
    np.testing.assert_allclose(double.std.elevation, exact.std.elevation, atol=1e-9)
    assert (single.std.elevation >= double.std.elevation - 1e-12).all()


def test_points_on_one_line_are_mapped_and_determine_no_plane() -> None:
    line = points(np.column_stack([np.linspace(0, 100, 40), np.linspace(0, 100, 40)]))
    assert np.isfinite(reconstruct(line, GRID, config=FIXED).mean.elevation).all()
    plane = FIXED.model_copy(update={"mean": "plane"})
    with pytest.raises(InputError, match="one line"):
        reconstruct(line, GRID, config=plane)


def test_points_far_off_are_left_out_and_counted() -> None:
    far = points(np.vstack([np.random.default_rng(0).uniform(0, 100, (50, 2)), [[90_000.0, 0.0]]]))
    with pytest.raises(InputError, match="lies far from all others"):
        reconstruct(far, GRID, config=FIXED)
    result = reconstruct(far, GRID, config=FIXED, area=SurveyArea.rectangle(GRID.bounds, CRS))
    assert result.diagnostics["n_points_beyond_reach"] == 1
    assert result.diagnostics["n_points"] == 50


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"points": points([[1.0, 1.0], [2.0, 2.0]])}, "at least 3"),
        ({"points": points([[9e4, 1.0], [9e4, 2.0], [9e4, 5.0]])}, "0 of 3 points"),
        ({"points": points(crs="EPSG:32609")}, "different systems"),
        ({"method": "kriging"}, "kriging"),
        ({"prior": Dem.on(Grid((0.0, 0.0, 50.0, 50.0), 25.0, CRS), np.zeros((3, 3)))}, "does not cover"),
        (
            {"prior": Dem.on(Grid((0.0, 0.0, 150.0, 150.0), 50.0, "EPSG:32609"), np.zeros((4, 4)))},
            "different systems",
        ),
    ],
)
def test_bad_input_gets_one_sentence(change: dict[str, object], word: str) -> None:
    settings: dict[str, object] = {"points": points(), "grid": GRID, "config": FIXED} | change
    with pytest.raises(InputError, match=word) as refusal:
        reconstruct(**settings)  # type: ignore[arg-type]
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    "settings",
    [
        {"fit": False},
        {"fit": False, "variance_m2": -1.0, "length_scale_m": 5.0},
        {"family": "cubic"},
        {"fit": False, "variance_m2": 1.0, "length_scale_m": 5.0, "family": "two-scale"},
        {"length_scale": 5.0},
        {"prior_sigma_m": 1.0},
    ],
)
def test_wrong_settings_are_refused(settings: dict[str, object]) -> None:
    with pytest.raises(ConfigError):
        validated(GaussianProcessConfig, settings, "the test")
