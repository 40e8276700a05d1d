import numpy as np
import pytest
from affine import Affine

from survey import Dem, InputError
from survey.scoring.differencing.tracking import hillshade, normalized_correlation, track

CRS, N = "EPSG:32608", 90


def surveys(shift_px: tuple[float, float], noise_m: float = 0.02, seed: int = 1) -> tuple[Dem, Dem]:
    """A surface before and after it moved by some pixels down and to the right, exactly: its waves are moved."""
    rng = np.random.default_rng(seed)
    waves, phase = rng.uniform(-0.6, 0.6, (120, 2)), rng.uniform(0.0, 2.0 * np.pi, 120)
    y, x = np.mgrid[:N, :N].astype(float)
    images = []
    for down, right in ((0.0, 0.0), shift_px):
        heights = sum(
            np.cos((x - right) * kx + (y - down) * ky + p) for (kx, ky), p in zip(waves, phase, strict=True)
        )
        images.append(0.15 * heights + noise_m * rng.standard_normal((N, N)))
    transform = Affine(2.0, 0.0, 500000.0, 0.0, -2.0, 6000000.0)
    first, second = (Dem(image, transform, CRS) for image in images)
    return first, second


def test_parts_of_a_pixel_are_found_without_bias():
    errors = []
    for seed, shift in enumerate([(0.3, -0.2), (5.5, 2.25), (-11.7, 8.1)]):
        found = track(*surveys(shift, seed=seed), window_px=25, step_px=6, search_px=14)
        assert not found.is_outlier.any()
        # Down is south.
        errors.append(found.shift_m / 2.0 - [shift[1], -shift[0]])
    assert np.abs(np.concatenate(errors).mean(axis=0)).max() < 0.02


def test_errors_are_as_large_as_claimed():
    scores = []
    for seed in range(6):
        found = track(*surveys((1.4, 0.6), noise_m=0.1, seed=seed), window_px=21, step_px=12, search_px=6)
        scores.append((found.shift_m - [1.2, -2.8]) / found.sigma_m)
    assert 0.75 < np.std(np.concatenate(scores)) < 1.25


def test_other_ground_is_flagged():
    first, _ = surveys((0.0, 0.0), seed=1)
    _, other = surveys((0.0, 0.0), seed=2)
    assert track(first, other, window_px=25, step_px=8, search_px=12).is_outlier.mean() > 0.9


def test_a_patch_whose_surface_is_another_one_is_flagged():
    first, second = surveys((1.0, 1.0))
    _, other = surveys((1.0, 1.0), seed=7)
    patched = second.elevation.copy()
    patched[30:60, 30:60] = other.elevation[30:60, 30:60]
    found = track(first, Dem(patched, second.transform, CRS), window_px=15, step_px=6, search_px=8)
    middle = np.abs(found.xy - found.xy.mean(axis=0)).max(axis=1) < 7.0
    assert found.is_outlier[middle].all()


def test_windows_with_gaps_are_left_out():
    first, second = surveys((1.0, 0.0))
    heights = first.elevation.copy()
    heights[:, :40] = np.nan
    found = track(Dem(heights, first.transform, CRS), second, window_px=15, step_px=6, search_px=6)
    assert found.xy[:, 0].min() > first.x[40]


def test_other_grids_and_even_windows_are_refused():
    first, second = surveys((0.0, 0.0))
    with pytest.raises(InputError, match="different grids"):
        track(first, Dem(second.elevation, second.transform @ Affine.translation(3, 0), CRS))
    with pytest.raises(InputError, match="odd window"):
        track(first, second, window_px=20)
    with pytest.raises(InputError, match="no window"):
        track(first, second, window_px=81, search_px=20)


def test_level_ground_is_evenly_bright():
    flat = Dem(np.zeros((5, 5)), Affine(1.0, 0.0, 0.0, 0.0, -1.0, 5.0), CRS)
    np.testing.assert_allclose(hillshade(flat, altitude_deg=30.0), 0.5)


def test_correlation_of_a_window_with_itself_is_one():
    image = np.random.default_rng(1).standard_normal((30, 30))
    scores = normalized_correlation(image[5:16, 7:18], image)
    assert np.unravel_index(scores.argmax(), scores.shape) == (5, 7)
    assert scores.max() == pytest.approx(1.0)
