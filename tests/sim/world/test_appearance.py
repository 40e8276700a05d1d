"""Surface appearance: texture tiles, patches, direction of the sun."""

import numpy as np
import pytest

from sim.config.world import AppearanceConfig
from sim.world.appearance import (
    GRAIN_TEXELS,
    downhill_rad,
    grain_tile,
    light_on,
    pack_tile,
    snow_patches,
    sun_direction,
)


def test_the_sun_stands_where_the_settings_say():
    south = sun_direction(AppearanceConfig(sun_elevation_deg=45.0, sun_from_deg=180.0))
    assert south == pytest.approx([0.0, -np.sqrt(0.5), np.sqrt(0.5)])


def test_a_tile_gives_its_texture_back(rng):
    texture = rng.normal(size=(16, 16)).astype(np.float32)
    tile = pack_tile(texture, 100.0)
    assert tile.starts.tolist() == [0, 256]
    assert len(tile.words) == 256 + 64
    words = tile.words[:256].reshape(4, 4, 4, 4).swapaxes(1, 2).reshape(16, 16)  # from blocks of 4 × 4 words
    found = ((words & 255).astype(float) - 128.0) * tile.amplitude
    np.testing.assert_allclose(found, texture - texture.mean(), atol=0.51 * tile.amplitude + 0.3)
    np.testing.assert_array_equal((words >> np.uint32(8)) & 255, np.roll(words & 255, -1, axis=1))


def test_patches_darken_snow_and_stones_more():
    shape = 200, 240
    snow = snow_patches(shape, 0.25, AppearanceConfig(), 1)
    debris = snow_patches(shape, 0.25, AppearanceConfig(stones=1.0), 1)
    assert snow.shape == shape
    assert 0.85 < snow.mean() <= 1.0
    np.testing.assert_allclose(debris, 0.45 * snow, rtol=1e-5)
    assert (snow_patches(shape, 0.25, AppearanceConfig(patches=0.0), 1) == 1.0).all()


def test_contrast_scales_the_grain():
    plain, strong = (grain_tile(AppearanceConfig(contrast=c), 1) for c in (1.0, 2.0))
    assert plain.texels == GRAIN_TEXELS
    assert strong.amplitude == pytest.approx(2.0 * plain.amplitude, rel=1e-5)
    np.testing.assert_array_equal(strong.starts, plain.starts)


def test_a_step_in_the_relief_casts_a_shadow_away_from_the_sun():
    height = np.zeros((64, 64), np.float32)
    height[:20] = 0.2  # the south; the sun stands there at 45°
    light = light_on(
        height, 0.01, AppearanceConfig(sun_elevation_deg=45.0, sun_from_deg=180.0, sky_share=0.4)
    )
    assert light[25:35].max() < 0.45  # the sky alone
    assert light[50, :] == pytest.approx(1.0, abs=0.05)


def test_the_site_falls_to_the_north_east():
    rows, columns = np.mgrid[0:20, 0:20].astype(np.float32)
    assert downhill_rad(rows - columns) == pytest.approx(np.pi / 4.0)
