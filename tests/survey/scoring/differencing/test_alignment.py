"""Level, shift, tilt and bias by curvature: found where they were put in, and counted in the error of a mean."""

from pathlib import Path

import numpy as np
import pytest
import rasterio
import shapely
from scipy.ndimage import gaussian_filter

from firnline.actions import ChangeRequest
from firnline.actions import change as change_action
from survey import Dem, Grid
from survey.scoring import change
from survey.scoring.differencing.coregistration import align
from survey.scoring.differencing.variogram import Structure, SumErrors, Variogram

GRID = Grid((0.0, 0.0, 1190.0, 1190.0), 10.0, "EPSG:32608")
X, Y = np.meshgrid(GRID.x, GRID.y)
ICE = {"ice": shapely.Point(600.0, 600.0).buffer(250.0)}
ON_ICE = shapely.contains_xy(ICE["ice"], X, Y)
TRUE = {"east_m": 6.0, "north_m": -3.0, "up_m": 1.5, "tilt_east_m_per_km": 0.8, "tilt_north_m_per_km": -0.5}


def hills(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return 100.0 + 30.0 * np.sin(x / 90.0) + 25.0 * np.cos(y / 70.0)


def correlated(seed: int, sigma_m: float = 0.3, cells: float = 4.0) -> np.ndarray:
    """Return errors (H, W) of a standard deviation [m], correlated over some cells."""
    field = gaussian_filter(np.random.default_rng(seed).standard_normal(GRID.shape), cells, mode="wrap")
    return sigma_m * field / field.std()


def earlier(curvature_m2: float = 0.0) -> Dem:
    """Return the hills, displaced so that `TRUE` moves them back."""
    x, y = X + TRUE["east_m"], Y + TRUE["north_m"]
    tilt = 0.001 * (TRUE["tilt_east_m_per_km"] * (X - 600.0) + TRUE["tilt_north_m_per_km"] * (Y - 600.0))
    laplacian = -30.0 / 90.0**2 * np.sin(x / 90.0) - 25.0 / 70.0**2 * np.cos(y / 70.0)
    return Dem.on(GRID, hills(x, y) - TRUE["up_m"] - tilt - curvature_m2 * laplacian)


def test_shift_tilt_and_bias_by_curvature_are_found() -> None:
    reference = Dem.on(GRID, hills(X, Y) + 0.05 * np.random.default_rng(1).standard_normal(GRID.shape))
    found = align(earlier(curvature_m2=60.0), reference, ~ON_ICE)
    for name, value in TRUE.items():
        # Bilinear cells of 10 m on hills of 70 m wave number are 0.03 m off.
        assert getattr(found.alignment, name) == pytest.approx(value, abs=0.06), name
    # The curvature is that of smoothed surfaces, some tenth smaller.
    assert found.alignment.curvature_bias_m2 == pytest.approx(60.0, rel=0.2)
    assert found.alignment.left_out == ()
    # 0.05 m of noise; within four cells of the edge the curvature is not known.
    assert np.nanstd((reference.elevation - found.heights)[5:-5, 5:-5]) < 0.07


def test_terms_that_flat_ground_does_not_determine_are_left_out_and_named() -> None:
    noise = 0.001 * np.random.default_rng(1).standard_normal(GRID.shape)
    found = change(Dem.on(GRID, noise), Dem.on(GRID, 0.0 * X - 1.0), ICE, align=True)
    assert found.alignment is not None
    assert found.alignment.left_out == ("east_m", "north_m", "curvature_bias_m2")
    assert found.alignment.up_m == pytest.approx(1.0, abs=0.001)
    assert any("too even to determine: shift to the east" in note for note in found.notes)


def test_errors_of_the_alignment_are_in_the_error_of_the_mean() -> None:
    z = []
    for seed in range(12):
        later = Dem.on(GRID, hills(X, Y) - 2.0 * ON_ICE + correlated(seed))
        found = change(later, earlier(), ICE, align=True)
        assert found.alignment is not None
        volume = found.volumes[0]
        z.append((volume.mean_m + 2.0) * volume.area_m2 / volume.std_m3)
        off = [
            (getattr(found.alignment, name) - value) / found.alignment.std[name]
            for name, value in TRUE.items()
        ]
        assert np.abs(off).max() < 5.0
        assert (
            abs(np.median(found.difference.elevation[~ON_ICE & np.isfinite(found.difference.elevation)]))
            < 1e-9
        )
    assert 0.4 < np.sqrt(np.mean(np.square(z))) < 1.7


def test_the_level_is_the_median_and_a_skewed_ground_is_stated() -> None:
    rng = np.random.default_rng(3)
    bushes = np.where(rng.random(GRID.shape) < 0.25, rng.exponential(0.4, GRID.shape), 0.0)
    later = Dem.on(GRID, hills(X, Y) + 0.1 * rng.standard_normal(GRID.shape) + bushes)
    found = change(later, Dem.on(GRID, hills(X, Y)), ICE)
    assert found.level is not None
    assert found.offset_m == found.level.median_m < 0.7 * found.level.mean_m
    assert any("its mean is" in note for note in found.notes)
    calm = change(Dem.on(GRID, hills(X, Y) + correlated(1)), Dem.on(GRID, hills(X, Y)), ICE)
    assert not any("its mean is" in note for note in calm.notes)


def test_a_median_of_correlated_errors_scatters_as_stated() -> None:
    variogram = Variogram(0.5, (Structure("gaussian", 60.0, 0.5),))
    everywhere = np.ones((24, 24), dtype=bool)
    weights = everywhere / everywhere.sum()
    sums = SumErrors(variogram, everywhere, 10.0)
    x, y = np.mgrid[:24, :24].reshape(2, -1) * 10.0
    lag = np.hypot(x[:, None] - x, y[:, None] - y)
    root = np.linalg.cholesky(variogram.covariance(lag) + 1e-9 * np.eye(lag.shape[0]))
    drawn = np.median(root @ np.random.default_rng(2).standard_normal((lag.shape[0], 4000)), axis=0)
    stated = np.hypot(sums.of(weights).std, sums.median_excess_m(weights))
    # 4,000 draws: 1.1 % of a standard deviation.
    assert drawn.std() == pytest.approx(stated, rel=0.05)


def test_surveys_are_aligned_unless_both_state_the_same_source(tmp_path: Path) -> None:
    files = [tmp_path / "later.tif", tmp_path / "earlier.tif"]
    Dem.on(GRID, hills(X, Y) + correlated(1)).write(files[0])
    earlier().write(files[1])

    def is_aligned(*sources: str, **options: bool) -> bool:
        for file, source in zip(files, sources, strict=False):
            with rasterio.open(file, "r+", IGNORE_COG_LAYOUT_BREAK="YES") as raster:
                raster.update_tags(SOURCE=source)
        request = ChangeRequest(later=files[0], earlier=files[1], no_pictures=True, **options)
        return change_action(request).change.alignment is not None

    assert is_aligned()
    assert is_aligned("lidar of 2026", "ASTER")
    assert not is_aligned("lidar of 2026", "lidar of 2026")
    assert is_aligned(align=True)
    assert not is_aligned("lidar of 2026", "ASTER", align=False)
