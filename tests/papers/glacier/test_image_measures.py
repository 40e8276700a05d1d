"""Measures of images: known pictures have known contrast, corners and matches."""

import numpy as np
import pytest

from papers.glacier.images import (
    METHODS,
    Pair,
    clahe,
    corners,
    entropy_bits,
    gains,
    gradients,
    ground_region,
    local_contrast,
    patch_statistics,
    relative_corners,
    rms_contrast,
    spread,
    statistics,
)

ALL = np.ones((120, 160), bool)


def speckled(rng: np.random.Generator, sd: float) -> np.ndarray:
    """Smooth random texture around grey level 150."""
    import cv2

    noise = cv2.GaussianBlur(rng.standard_normal((120, 180)).astype(np.float32), (0, 0), 1.5)
    return np.clip(150.0 + sd * noise / noise.std(), 0, 255).astype(np.uint8)


def test_contrast_and_gradient_of_known_pictures(rng: np.random.Generator) -> None:
    halves = np.where(np.arange(160)[None, :] < 80, 100, 140).astype(np.uint8).repeat(120, axis=0)
    assert rms_contrast(halves, ALL) == pytest.approx(20.0 / 120.0)
    assert entropy_bits(halves, ALL) == pytest.approx(1.0)
    ramp = np.tile(np.arange(160, dtype=np.uint8), (120, 1))
    assert np.median(gradients(ramp, ALL)) == pytest.approx(1.0)
    # Under a window of 12 pixels noise of 4.5 levels at 150 is 3 %, less what varies slower than the window.
    assert local_contrast(speckled(rng, 4.5)[:, :160], ALL) == pytest.approx(0.03, rel=0.15)


def test_absolute_thresholds_tell_faint_from_strong_texture(rng: np.random.Generator) -> None:
    faint, strong = speckled(rng, 1.5)[:, :160], speckled(rng, 20.0)[:, :160]
    assert len(corners(faint, ALL)) == 0
    assert len(corners(strong, ALL)) > 50
    assert len(corners(clahe(faint), ALL)) > 50
    # A threshold relative to the best corner sees no difference.
    assert len(relative_corners(faint, ALL)) > 0.5 * len(relative_corners(strong, ALL))


def test_every_method_finds_a_shift(rng: np.random.Generator) -> None:
    wide = speckled(rng, 25.0)
    flow = np.broadcast_to(np.array([-6.0, 0.0]), (120, 160, 2))
    pair = Pair(np.ascontiguousarray(wide[:, :160]), np.ascontiguousarray(wide[:, 6:166]), flow, ALL)
    for name, method in METHODS.items():
        found = method(pair)
        assert found.correct <= found.matched <= found.detected
        assert found.correct > 0.5 * found.matched > 5, name
    lost = Pair(pair.first, pair.first, flow, ALL)
    assert METHODS["GFTT + KLT"](lost).correct == 0


def test_statistics_have_sixteen_measures(rng: np.random.Generator) -> None:
    values = statistics(speckled(rng, 20.0)[:, :160], ALL)
    assert len(values) == 16
    assert all(np.isfinite(value) for value in values.values())


def test_gains_are_ratios_of_correct_matches() -> None:
    rows = [
        {"scene": scene, "method": method, "image": image, "correct": n}
        for method in METHODS
        for scene, raw, after in (("a", 10, 50), ("b", 30, 60))
        for image, n in (("raw", raw), ("CLAHE", after))
    ]
    assert gains(rows)["ORB"] == {"together": 2.75, "median scene": 3.5, "worst scene": 2.0}


def test_a_region_is_measured_patch_by_patch(rng: np.random.Generator) -> None:
    image = speckled(rng, 20.0)
    image[:, 80:] //= 2
    left, right = patch_statistics(
        [(image, (0, 0, 160, 90))], 80
    )  # the last ten rows hold less than half a patch
    assert right["gradient, median"] == pytest.approx(0.5 * left["gradient, median"], rel=0.2)
    low, middle, high = spread([left, right])["entropy"]
    assert low < middle < high


def test_the_region_of_the_ground_leaves_rows_with_sky_out() -> None:
    mask = np.ones((60, 80), bool)
    mask[:20, 5:] = False
    image = np.zeros((60, 80), np.uint8)
    assert ground_region(image, mask)[1] == (0, 20, 80, 60)
