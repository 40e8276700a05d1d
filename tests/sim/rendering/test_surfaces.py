"""Ground without snow: clean snow unchanged, and boulders, debris and snow patches the same for all sensors."""

import numpy as np
import pytest

from benchmarks.small_inputs import BARE_SCENERY
from sim.config.world import AppearanceConfig, ImagingConfig, SceneryConfig
from sim.rendering import Renderer
from sim.simulate.assembly import rover_camera
from sim.world.fine_terrain import FineTerrain, fine_terrain
from survey.data.dem import Dem
from survey.data.grid import Grid
from tests.sim.rendering.plan_view import plan_view
from tests.sim.rendering.reference import brute_force_depth

IMAGING = ImagingConfig(width=80, height=60, noise="off")


def ground(bare: bool = True, **settings: object) -> FineTerrain:
    grid = Grid((0.0, 0.0, 40.0, 40.0), 1.0)
    scenery = (BARE_SCENERY if bare else {}) | settings
    return fine_terrain(Dem.on(grid, np.zeros(grid.shape)), SceneryConfig(**scenery), seed=4)


def seen(terrain: FineTerrain, look: AppearanceConfig | None = None) -> Renderer:
    return Renderer(terrain, look or AppearanceConfig(), rover_camera(IMAGING), seed=4, imaging=IMAGING)


def view(renderer: Renderer) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, 3] = 20.0, 20.0, renderer.terrain.elevation(np.array([[20.0, 20.0]]))[0] + 0.3
    return pose @ renderer.camera.T_body_camera


def test_clean_snow_is_as_it_was_before_other_surfaces() -> None:
    renderer = seen(ground(bare=False))
    pose = view(renderer)
    pose[2, 3] -= 0.3
    found = renderer.render(pose).reshape(4, 15, 8, 10).mean(axis=(1, 3))
    stored = [
        [125, 131, 135, 138, 138, 135, 131, 125], [156, 159, 164, 169, 175, 172, 159, 146],
        [172, 171, 170, 185, 195, 202, 195, 185], [167, 175, 180, 187, 183, 183, 178, 166],
    ]  # fmt: skip
    np.testing.assert_allclose(found, stored, atol=0.6)
    assert renderer.scene.rough.snow.size == 1  # its images skip what other surfaces need


@pytest.mark.parametrize("surface", ["debris", "bare ice"])
def test_depth_on_rough_ground_is_that_of_the_exact_ray_caster(surface: str) -> None:
    renderer = seen(ground(surface=surface, boulders_per_ha=300.0))
    pose = view(renderer)
    v, u = np.mgrid[0:60, 0:80]
    rays = renderer.camera.rays(np.column_stack([u.ravel(), v.ravel()]).astype(float)) @ pose[:3, :3].T
    exact = brute_force_depth(renderer.terrain, pose[:3, 3], rays, 30.0)
    near = np.isfinite(exact)
    wrong = np.abs(renderer.depth(pose).ravel()[near] - exact[near]) > 0.02
    assert near.sum() > 1500
    assert wrong.mean() <= 0.001


def test_debris_is_dark_and_snow_patches_on_it_are_bright() -> None:
    look = AppearanceConfig(patches=0.0, sky_share=0.0, sun_elevation_deg=60.0)
    scenes = {share: seen(ground(surface="debris", snow_cover=share), look) for share in (0.0, 0.3)}
    snow = plan_view(seen(ground(), look), (2.0, 2.0), (72, 72), 0.5).mean()
    bare, patchy = (plan_view(scene, (2.0, 2.0), (72, 72), 0.5) / snow for scene in scenes.values())
    assert 0.2 < bare.mean() < 0.4
    assert 0.15 < (patchy > 0.8).mean() < 0.4
    assert (scenes[0.0].scene.rough.snow == 0).all()


def test_rills_of_bare_ice_are_cut_into_the_ground_and_carry_water() -> None:
    ice, plain = (ground(surface=surface) for surface in ("bare ice", "snow"))
    channels = [hazard for hazard in ice.hazards if hazard.kind == "melt channel"]
    assert len(channels) >= 2
    assert plain.hazards == ()
    assert ice.water.max() == 255
    inside = np.array([hazard.outline.representative_point().coords[0] for hazard in channels])
    assert ice.elevation(inside).mean() < -0.1
