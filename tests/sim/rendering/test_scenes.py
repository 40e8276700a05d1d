"""Horizon, clouds, ruts and colour: each does what it says, and none of them changes images without it."""

import hashlib
from functools import lru_cache

import cv2
import numpy as np
import pytest

from benchmarks.small_inputs import BARE_SCENERY
from sim.config.world import AppearanceConfig, ImagingConfig, SceneryConfig
from sim.rendering import Renderer, RoverBox, Ruts
from sim.rendering.clouds import drift_m
from sim.simulate.assembly import rover_camera
from sim.world.fine_terrain import FineTerrain, fine_terrain
from survey.core import FloatArray
from survey.data.dem import Dem
from survey.data.grid import Grid
from tests.sim.rendering.reference import brute_force_depth

QUIET = ImagingConfig(width=80, height=60, noise="off", vignetting=0.0, blur_px=0.0, gain=200.0)
PLAIN = {"contrast": 0.0, "debris": 0.0, "patches": 0.0}
CRS = "EPSG:32632"


@lru_cache
def ground(surface: str = "snow", *, bare: bool = True) -> FineTerrain:
    grid = Grid((0.0, 0.0, 40.0, 40.0), 1.0, CRS)
    scenery = (BARE_SCENERY if bare else {}) | {"surface": surface}
    return fine_terrain(Dem.on(grid, np.zeros(grid.shape)), SceneryConfig(**scenery), seed=4)


def renderer(
    terrain: FineTerrain | None = None, imaging: ImagingConfig = QUIET, **settings: object
) -> Renderer:
    parts = {name: settings.pop(name) for name in ("surroundings", "ruts") if name in settings}
    return Renderer(
        terrain or ground(),
        AppearanceConfig(**settings),
        rover_camera(imaging),
        seed=4,
        imaging=imaging,
        **parts,
    )


def pose(scene: Renderer, yaw: float = 0.0) -> FloatArray:
    T_world_body = np.eye(4)
    cos, sin = np.cos(yaw), np.sin(yaw)
    T_world_body[:2, :2] = [[cos, -sin], [sin, cos]]
    T_world_body[:3, 3] = 20.0, 20.0, scene.terrain.elevation(np.array([[20.0, 20.0]]))[0]
    return T_world_body @ scene.camera.T_body_camera


def box_at(*place: float) -> RoverBox:
    T_world_box = np.eye(4)
    T_world_box[:3, 3] = place
    return RoverBox((0.5, 1.5, 1.0), T_world_box)


STORED = {
    "snow": [165035, 173543, 206389, 219321, 171246, 168224, 221678, 192576],
    "bare ice": [182126, 183453, 90398, 118261, 184463, 180217, 147527, 92043],
}
"""Sums of the grey levels over quarters of the images as they were before any of the switches."""


@pytest.mark.parametrize("surface", STORED)
def test_images_without_the_switches_are_as_they_were(surface: str) -> None:
    scene = renderer(ground(surface, bare=False), ImagingConfig(width=80, height=60))
    images = [
        scene.render(pose(scene, yaw), rover_box=box_at(22.0, 20.0, 0.4)).astype(int) for yaw in (0.0, 2.5)
    ]
    sums = [
        int(part.sum()) for image in images for half in np.split(image, 2) for part in np.split(half, 2, 1)
    ]
    # Other processors round some texels otherwise.
    np.testing.assert_allclose(sums, STORED[surface], atol=15)


def test_settings_that_need_a_switch_change_no_byte() -> None:
    digests = {
        hashlib.sha256(scene.render(pose(scene), time_s).tobytes()).hexdigest()
        for scene, time_s in (
            (renderer(), 0.0),
            (renderer(cloud_speed_m_s=30.0), 90.0),
            (renderer(ruts=Ruts((40.0, 40.0), gauge_m=0.45, width_m=0.15, depth_m=0.02, smooth=0.5)), 0.0),
        )
    }
    assert len(digests) == 1


def hills() -> Dem:
    """Level ground around the site, and a ridge from 1 to 2 km in the east that rises to 400 m."""
    grid = Grid((-3200.0, -3200.0, 3200.0, 3200.0), 80.0, CRS)
    x, _ = np.meshgrid(grid.x, grid.y)
    return Dem.on(grid, np.interp(x, [1000.0, 1500.0, 2000.0], [0.0, 400.0, 0.0]))


def test_mid_ground_and_ridges_have_their_distances() -> None:
    scene = renderer(surroundings=hills())
    view = pose(scene)
    depth = scene.depth(view)
    v, u = np.mgrid[0:60, 0:80]
    rays = scene.camera.rays(np.column_stack([u.ravel(), v.ravel()]).astype(float)) @ view[:3, :3].T
    slope = (rays[:, 2] / np.hypot(rays[:, 0], rays[:, 1])).reshape(depth.shape)
    far = rays.reshape(60, 80, 3)[:, 36:44]
    assert np.isfinite(depth[slope < -1e-3]).all()  # the ground does not end with the fine terrain
    assert np.isinf(depth[slope > 0.28]).all()
    ridge = np.isfinite(depth[:, 36:44]) & (slope[:, 36:44] > 0.02)
    east = (far[..., 0] * depth[:, 36:44])[ridge] + 20.0
    height = (far[..., 2] * depth[:, 36:44])[ridge] + view[2, 3]
    assert ridge.sum() > 50
    assert height == pytest.approx(np.interp(east, [1000.0, 1500.0], [0.0, 400.0]), abs=12.0)
    near = brute_force_depth(scene.terrain, view[:3, 3], rays, 30.0).reshape(depth.shape)
    assert depth[np.isfinite(near)] == pytest.approx(near[np.isfinite(near)], abs=0.02)


def test_near_and_far_ground_move_against_each_other() -> None:
    scene = renderer(surroundings=hills())
    view = pose(scene)
    aside = view.copy()
    aside[1, 3] += 5.0
    moved = np.hypot(*np.moveaxis(scene.flow(view, aside), -1, 0))
    depth = scene.depth(view)
    expected = 5.0 * scene.camera.matrix[0, 0] / depth
    middle = np.isfinite(depth) & (depth > 100.0)
    middle[:, :30] = middle[:, 50:] = False
    assert middle.sum() > 50
    assert moved[middle] == pytest.approx(expected[middle], rel=0.3)


def test_a_ridge_is_brighter_in_the_sun_and_may_hide_it_from_the_site() -> None:
    lit = renderer(surroundings=hills(), sun_from_deg=270.0, **PLAIN)
    dark = renderer(surroundings=hills(), sun_from_deg=90.0, **PLAIN)
    ridge = np.isfinite(lit.depth(pose(lit))) & (lit.depth(pose(lit)) > 1000.0)
    assert lit.render(pose(lit))[ridge].mean() > dark.render(pose(dark))[ridge].mean() + 30.0
    hidden = renderer(
        surroundings=hills(), sun_from_deg=90.0, sun_elevation_deg=10.0, **PLAIN
    )  # the ridge is 15° high
    bright, shady = (radiance(scene, pose(scene))[50:].mean() for scene in (dark, hidden))
    assert shady == pytest.approx(0.45 * bright, rel=0.05)


def radiance(scene: Renderer, view: FloatArray, time_s: float = 0.0) -> FloatArray:
    return scene.trace(view, None, None, shaded=True, time_s=time_s)[0].astype(float)


def test_cloud_shadows_drift_with_the_wind() -> None:
    look = AppearanceConfig(clouds=0.5, haze_m=1e9, **PLAIN)
    cloudy, clear = renderer(clouds=0.5, haze_m=1e9, **PLAIN), renderer(haze_m=1e9, **PLAIN)
    view = pose(cloudy)
    ground_seen = clear.depth(view) < 8.0
    bare = radiance(clear, view)
    shares = np.array(
        [radiance(cloudy, view, t)[ground_seen] / bare[ground_seen] for t in np.arange(0.0, 600.0, 20.0)]
    )
    means = shares.mean(axis=1)
    assert means.max() > 0.97  # sun
    assert means.min() < 0.65  # the sky alone gives 0.45 of the light, and the cloud lets some through
    assert shares.max() < 1.01
    assert np.abs(np.diff(means)).max() < 0.35  # soft edges
    # A place that moves with the clouds keeps its light.
    moved = view.copy()
    drift = drift_m(look, 235.0, 1.0)
    moved[:2, 3] += drift
    assert np.hypot(*drift) == pytest.approx(8.0)
    assert radiance(cloudy, moved, 1.0)[ground_seen] == pytest.approx(
        radiance(cloudy, view)[ground_seen], abs=0.02
    )


def test_clouds_cover_the_sky_above_mountains_alone() -> None:
    cloudy, clear = renderer(clouds=0.6, **PLAIN), renderer(**PLAIN)
    view = pose(clear)
    view[:3, :3] = cv2.Rodrigues(np.array([0.0, -0.3, 0.0]))[0] @ view[:3, :3]  # up
    changed = np.abs(radiance(cloudy, view) - radiance(clear, view)) > 0.01
    sky = np.isinf(clear.depth(view))
    assert changed[:20][sky[:20]].mean() > 0.4
    crest = np.flatnonzero(sky[:, 40])[-3:]  # just above the ground there are mountains
    assert not changed[crest][:, sky[crest].all(axis=0)].any()


def places(scene: Renderer, view: FloatArray) -> FloatArray:
    """Return the place of each pixel (H, W, 3); NaN for the sky."""
    v, u = np.mgrid[: scene.camera.height, : scene.camera.width]
    rays = scene.camera.rays(np.column_stack([u.ravel(), v.ravel()]).astype(float)) @ view[:3, :3].T
    depth = scene.depth(view)
    depth[np.isinf(depth)] = np.nan
    return rays.reshape(*depth.shape, 3) * depth[..., None] + view[:3, 3]


def test_ruts_lie_where_the_rover_drove_and_nowhere_else() -> None:
    ruts = Ruts((40.0, 40.0), gauge_m=0.6, width_m=0.2, depth_m=0.03, smooth=0.5)
    scene = renderer(ruts=ruts, **PLAIN)
    view = pose(scene)
    before = radiance(scene, view)
    for x in np.arange(18.0, 30.0, 0.07):
        ruts.press(float(x), 20.0, 0.0)
    changed = np.abs(radiance(scene, view) - before) > 1e-4
    points = places(scene, view)
    aside = np.abs(np.abs(points[..., 1] - 20.0) - 0.3)
    near = points[..., 0] < 26.0
    assert changed[near & (aside < 0.08)].mean() > 0.9
    assert not changed[near & (aside > 0.35)].any()


def test_cleats_vanish_with_distance() -> None:
    ruts = Ruts((40.0, 40.0), gauge_m=0.6, width_m=0.4, depth_m=0.03, smooth=0.5)
    scene = renderer(imaging=QUIET.model_copy(update={"width": 320, "height": 240}), ruts=ruts, **PLAIN)
    for x in np.arange(18.0, 39.0, 0.1):
        ruts.press(float(x), 20.0, 0.0)
    view = pose(scene)
    light, points = radiance(scene, view), places(scene, view)
    in_rut = np.abs(np.abs(points[..., 1] - 20.0) - 0.3) < 0.1
    rough = [light[in_rut & (np.abs(points[..., 0] - x) < 0.5)].std() for x in (21.5, 32.0)]
    assert rough[0] > 0.03
    assert rough[1] < 0.2 * rough[0]


@pytest.mark.parametrize("surface", ["snow", "bare ice"])
def test_colour_images_turned_to_grey_are_the_grey_images(surface: str) -> None:
    terrain = ground(surface, bare=False)
    grey, colour = (
        renderer(terrain, QUIET.model_copy(update={"colour": on}), surroundings=hills(), clouds=0.3)
        for on in (False, True)
    )
    image = colour.render(pose(colour), 5.0)
    expected = grey.render(pose(grey), 5.0)
    assert image.shape == (60, 80, 3)
    saturated = (image == 255).any(axis=-1)
    assert saturated.mean() < 0.6
    found = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY).astype(int)
    assert np.abs(found - expected)[~saturated].max() <= 1


def test_shade_and_sky_are_bluer_than_snow_in_the_sun() -> None:
    scene = renderer(
        imaging=QUIET.model_copy(update={"colour": True, "gain": 150.0}), sun_from_deg=90.0, **PLAIN
    )
    image = scene.render(pose(scene), rover_box=box_at(23.0, 20.0, 0.6)).astype(float)
    bluish = image[..., 0] / image[..., 2].clip(1.0)
    points = places(scene, pose(scene))
    shade = (np.abs(points[..., 0] - 22.3) < 0.3) & (np.abs(points[..., 1] - 20.0) < 0.3)
    sunny = (np.abs(points[..., 0] - 22.3) < 0.3) & (np.abs(points[..., 1] - 20.0) > 1.5)
    sky = np.isinf(scene.depth(pose(scene)))
    sky[8:] = False
    assert shade.sum() > 5
    assert sunny.sum() > 5
    assert bluish[sunny].mean() == pytest.approx(1.0, abs=0.03)
    assert bluish[shade].mean() > 1.15
    assert bluish[sky].mean() > 1.3


def test_noise_of_the_channels_is_independent_and_jpeg_keeps_them() -> None:
    imaging = QUIET.model_copy(update={"colour": True, "noise": "on", "read_noise": 3.0, "gain": 100.0})
    scene, still = (
        renderer(imaging=one, **PLAIN) for one in (imaging, imaging.model_copy(update={"noise": "off"}))
    )
    noise = (scene.render(pose(scene)).astype(float) - still.render(pose(still)))[30:].reshape(-1, 3)
    assert np.abs(np.corrcoef(noise.T) - np.eye(3)).max() < 0.1
    packed = renderer(imaging=imaging.model_copy(update={"jpeg_quality": 90}), **PLAIN)
    assert packed.render(pose(packed)).shape == (60, 80, 3)
