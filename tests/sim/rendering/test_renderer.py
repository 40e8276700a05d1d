"""The renderer: exact depth, motion that agrees with it, the same bytes whoever computes them."""

from dataclasses import replace

import cv2
import numba
import numpy as np
import pytest

from sim.config.world import AppearanceConfig, ImagingConfig, SceneryConfig
from sim.rendering import Renderer, RoverBox
from sim.rendering.light import ImageSensor
from sim.rendering.visibility import surface_of
from sim.simulate.assembly import RoverCamera, rover_camera
from sim.world.fine_terrain import FineTerrain, fine_terrain
from survey.core.errors import InputError
from survey.data.camera import Camera
from survey.data.dem import Dem
from survey.data.grid import Grid
from tests.sim.rendering.plan_view import plan_view
from tests.sim.rendering.reference import brute_force_depth

QUIET = ImagingConfig(width=80, height=60, noise="off", vignetting=0.0, blur_px=0.0)


@pytest.fixture(scope="module")
def ground() -> FineTerrain:
    grid = Grid((500000.0, 6000000.0, 500060.0, 6000048.0), 1.0)
    x, y = np.meshgrid(grid.x, grid.y)
    hills = 1200.0 + 0.03 * (x - 500000.0) + 0.8 * np.cos((y - 6000000.0) / 7.0)
    return fine_terrain(Dem.on(grid, hills), SceneryConfig(crevasses_per_ha=12.0, bridged_share=0.0), seed=4)


@pytest.fixture(scope="module")
def camera() -> Camera:
    return rover_camera(QUIET)


@pytest.fixture(scope="module")
def renderer(ground: FineTerrain, camera: Camera) -> Renderer:
    return Renderer(ground, AppearanceConfig(), camera, seed=4, imaging=QUIET)


def body_pose(ground: FineTerrain, x: float, y: float, yaw: float, roll: float = 0.0) -> np.ndarray:
    """Pose of a rover that stands at a place, level but for its roll."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    pose = np.eye(4)
    pose[:3, :3] = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    pose[:3, :3] @= cv2.Rodrigues(np.array([roll, 0.0, 0.0]))[0]
    place = np.array([[500000.0 + x, 6000000.0 + y]])
    pose[:3, 3] = *place[0], ground.elevation(place)[0]
    return pose


def pixels(camera: Camera) -> np.ndarray:
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    return np.column_stack([u.ravel(), v.ravel()]).astype(float)


def test_depth_is_that_of_the_exact_ray_caster(
    ground: FineTerrain, camera: Camera, renderer: Renderer
) -> None:
    wrong, n = 0, 0
    crevasse = ground.hazards[1].outline.point_on_surface()
    beside = crevasse.x - 500000.0 - 2.5, crevasse.y - 6000000.0
    for x, y, yaw, roll in ((20.0, 20.0, 0.4, 0.1), (35.0, 30.0, 3.3, -0.2), (*beside, 0.0, 0.0)):
        view = body_pose(ground, x, y, yaw, roll) @ camera.T_body_camera
        exact = brute_force_depth(ground, view[:3, 3], camera.rays(pixels(camera)) @ view[:3, :3].T, 30.0)
        depth = renderer.depth(view).ravel().astype(float)
        seen = np.isfinite(exact)
        wrong += int((np.abs(depth[seen] - exact[seen]) > 0.02).sum()) + int((depth[~seen] < 29.9).sum())
        n += seen.sum()
    assert n > 5000
    assert wrong <= 0.001 * n  # the bar: 99.9 % within 2 cm


def test_blocks_of_the_terrain_hold_all_that_a_jump_of_one_block_may_meet(ground: FineTerrain) -> None:
    north_up = np.zeros_like(ground.height)
    north_up[::-1][32, 32] = 5.0
    blocks = surface_of(replace(ground, height=north_up), 0.0).fine_blocks
    # From the last cell of block 6, number 27, a jump of 4 cells ends in cell 31, of which node 32 is a corner.
    assert blocks[6, 6] == 5.0
    assert blocks[5, 6] == blocks[6, 5] == 0.0


def test_a_pinhole_sees_the_same_ground(ground: FineTerrain, camera: Camera) -> None:
    matrix = np.array([[40.0, 0.0, 39.5], [0.0, 40.0, 29.5], [0.0, 0.0, 1.0]])
    pinhole = Camera("pinhole", 80, 60, matrix, np.zeros(5), camera.T_body_camera)
    view = body_pose(ground, 20.0, 20.0, 0.4) @ pinhole.T_body_camera
    depth = Renderer(ground, AppearanceConfig(), pinhole, seed=4).depth(view).ravel()
    exact = brute_force_depth(ground, view[:3, 3], pinhole.rays(pixels(pinhole)) @ view[:3, :3].T, 30.0)
    seen = np.isfinite(exact)
    assert np.mean(np.abs(depth[seen] - exact[seen]) > 0.02) <= 0.001


def test_rolling_shutter_gives_each_row_its_own_pose(
    ground: FineTerrain, camera: Camera, renderer: Renderer
) -> None:
    first = body_pose(ground, 20.0, 20.0, 0.40) @ camera.T_body_camera
    last = body_pose(ground, 20.03, 20.0, 0.45) @ camera.T_body_camera
    whole = renderer.depth(first, last)
    alone = [renderer.depth(pose) for pose in (first, last)]
    assert whole[0] == pytest.approx(alone[0][0], rel=1e-5)
    assert whole[-1] == pytest.approx(alone[1][-1], rel=1e-5)
    assert np.abs(whole[30] - alone[0][30]).max() > 1e-3


def test_flow_leads_to_the_same_place_on_the_ground(
    ground: FineTerrain, camera: Camera, renderer: Renderer
) -> None:
    before = body_pose(ground, 20.0, 20.0, 0.4) @ camera.T_body_camera
    after = body_pose(ground, 20.1, 20.02, 0.42) @ camera.T_body_camera
    flow = renderer.flow(before, after).reshape(-1, 2)
    depth = renderer.depth(before).ravel().astype(float)
    near = np.isfinite(flow).all(axis=1) & (depth < 15.0) & renderer.visible(before, after).ravel()
    start, moved = pixels(camera)[near], (pixels(camera) + flow)[near]
    exact = brute_force_depth(ground, after[:3, 3], camera.rays(moved) @ after[:3, :3].T, 20.0)
    met = (camera.rays(moved) * exact[:, None]) @ after[:3, :3].T + after[:3, 3]
    local = (met - before[:3, 3]) @ before[:3, :3]
    error = np.linalg.norm(camera.project(local) - start, axis=1)
    assert near.sum() > 1500
    # What the next view meets lies where the first one saw it; beside edges a few rays pass.
    assert np.quantile(error, 0.99) < 0.1


def test_pictures_move_as_the_flow_says(ground: FineTerrain) -> None:
    imaging = ImagingConfig(width=240, height=180, noise="off", gain=150.0)
    camera = rover_camera(imaging)
    renderer = Renderer(ground, AppearanceConfig(), camera, seed=4, imaging=imaging)
    poses = [body_pose(ground, 20.0 + d, 20.0, 0.4) @ camera.T_body_camera for d in (0.0, 0.05)]
    images = [renderer.render(pose) for pose in poses]
    corners = cv2.goodFeaturesToTrack(images[0][100:], 300, 1e-6, 5) + np.array([0.0, 100.0], np.float32)
    tracked, status, _ = cv2.calcOpticalFlowPyrLK(*images, corners, None, winSize=(21, 21))
    found = status.ravel() == 1
    u, v = np.rint(corners[found, 0]).astype(int).T
    error = (tracked - corners)[found, 0] - renderer.flow(*poses)[v, u]
    # One track is good to a tenth of a pixel or two; what all have in common would be the renderer's.
    assert np.abs(np.median(error, axis=0)).max() < 0.1
    assert np.median(np.linalg.norm(error, axis=1)) < 0.3


def test_one_and_two_threads_give_the_same_bytes(ground: FineTerrain, camera: Camera) -> None:
    renderer = Renderer(ground, AppearanceConfig(), camera, seed=4)
    view = body_pose(ground, 20.0, 20.0, 0.4) @ camera.T_body_camera
    before = numba.get_num_threads()
    images = []
    for n in {1, min(2, numba.config.NUMBA_NUM_THREADS)}:
        numba.set_num_threads(n)
        images.append(renderer.render(view, frame_index=7))
    numba.set_num_threads(before)
    assert all((image == images[0]).all() for image in images)
    assert (renderer.render(view, frame_index=7) == images[0]).all()
    assert (renderer.render(view, frame_index=8) != images[0]).any()


def test_the_rover_throws_a_shadow(ground: FineTerrain, camera: Camera, renderer: Renderer) -> None:
    sunward = np.radians(90.0 - 220.0)
    body = body_pose(ground, 20.0, 20.0, sunward + np.pi)  # the sun stands behind it
    box = RoverBox((0.7, 0.5, 0.6), body)
    view = body @ camera.T_body_camera
    with_box, without = renderer.render(view, rover_box=box), renderer.render(view)
    darker = with_box.astype(int) < without.astype(int) - 20
    assert 0.02 < darker.mean() < 0.4
    assert darker[45:].mean() > darker[:30].mean()


def test_motion_blurs_what_moves(ground: FineTerrain, camera: Camera, renderer: Renderer) -> None:
    poses = [body_pose(ground, 20.0, 20.0, yaw) @ camera.T_body_camera for yaw in (0.4, 0.5)]
    sharp = renderer.render(poses[0])
    blurred = renderer.render(poses[0], T_world_camera_exposed=poses[1])
    still = renderer.render(poses[0], T_world_camera_exposed=poses[0])
    across = [np.abs(np.diff(image.astype(float), axis=1)).mean() for image in (sharp, blurred)]
    assert across[1] < 0.8 * across[0]
    # Reading an image at its own pixels again changes a grey level at most.
    assert np.abs(still.astype(int) - sharp).max() <= 1


def test_the_camera_uses_the_motion_it_is_given(ground: FineTerrain) -> None:
    imaging = ImagingConfig(width=80, height=60, row_readout_s=1e-3, exposure_s=0.02)
    renderer = Renderer(ground, AppearanceConfig(), rover_camera(imaging), seed=4, imaging=imaging)
    asked: list[float] = []

    def pose_at(time_s: float) -> np.ndarray:
        asked.append(time_s)
        return body_pose(ground, 20.0 + time_s, 20.0, 0.4)

    frame = RoverCamera(renderer, exposure_s=imaging.exposure_s).frame(pose_at, 5.0, 0)
    assert frame.shape == (60, 80)
    assert sorted(asked) == pytest.approx([4.99, 5.01, 5.049])


def test_mountains_have_a_distance(ground: FineTerrain, camera: Camera) -> None:
    imaging = ImagingConfig(width=80, height=60, noise="off", gain=150.0)
    near, far = (
        Renderer(ground, AppearanceConfig(ridges_distance_m=d, haze_m=1e6), camera, seed=4, imaging=imaging)
        for d in (200.0, 50000.0)
    )
    views = [body_pose(ground, 30.0, y, 0.0) @ camera.T_body_camera for y in (5.0, 43.0)]
    views[1][2, 3] = views[0][2, 3]
    both = np.logical_and(*(np.isinf(near.depth(view)) for view in views))
    change = [
        np.abs(np.subtract(*(r.render(view)[both].astype(float) for view in views))).mean()
        for r in (near, far)
    ]
    assert both.sum() > 500
    assert change[0] > 2.0 * change[1]


def test_the_texture_does_not_repeat(camera: Camera) -> None:
    bare = {f"{form}_sd_m": 0.0 for form in ("dune", "sastrugi", "hummock")}
    bare |= {f"{kind}_per_ha": 0.0 for kind in ("crevasses", "pools", "channels", "dirt_cones")}
    flat = Dem.on(Grid((0.0, 0.0, 48.0, 48.0), 1.0), np.zeros((49, 49)))
    ground = fine_terrain(flat, SceneryConfig(**bare), seed=4)
    renderer = Renderer(ground, AppearanceConfig(patches=0.0), camera, seed=4)
    plan = plan_view(renderer, (2.0, 2.0), (512, 512), 0.08).astype(float)
    plan -= plan.mean()
    correlation = np.fft.irfft2(np.abs(np.fft.rfft2(plan, (1024, 1024))) ** 2)[:256, :256] / (plan**2).sum()
    away = np.hypot(*np.mgrid[0:256, 0:256]) * 0.08 > 2.0
    assert np.abs(correlation[away]).max() < 0.3


def test_noise_has_the_stated_size(ground: FineTerrain, camera: Camera) -> None:
    imaging = ImagingConfig(width=80, height=60, gain=150.0)
    renderer = Renderer(ground, AppearanceConfig(), camera, seed=4, imaging=imaging)
    view = body_pose(ground, 20.0, 20.0, 0.4) @ camera.T_body_camera
    frames = np.stack([renderer.render(view, frame_index=k) for k in range(40)]).astype(float)
    expected = np.sqrt(0.6**2 + 0.085**2 * frames.mean() + 1.0 / 12.0)  # and rounding to whole levels
    assert frames.std(axis=0).mean() == pytest.approx(expected, rel=0.05)


def test_automatic_gain_changes_in_steps(camera: Camera) -> None:
    imaging = ImagingConfig(width=80, height=60, noise="off", vignetting=0.0, blur_px=0.0, gain_step_ev=1.0)
    sensor = ImageSensor(imaging, camera, 1)
    # For a level of 200 these would need gains of 267, 222 and 125; the powers of two nearest to them are 256 and 128.
    for radiance, gain in ((0.75, 256.0), (0.9, 256.0), (1.6, 128.0)):
        image = sensor.image(np.full((60, 80), radiance, np.float32), 0)
        assert image == pytest.approx(gain * radiance, abs=0.51)


def test_drops_on_the_lens_keep_the_light_and_lose_the_contrast(camera: Camera) -> None:
    radiance = np.where(np.arange(80) % 8 < 4, 0.4, 0.6).astype(np.float32) * np.ones((60, 1), np.float32)
    wet, dry = (
        ImageSensor(QUIET.model_copy(update={"gain": 200.0, "drops": n}), camera, 4)
        .image(radiance, 0)
        .astype(float)
        for n in (20, 0)
    )
    under = np.abs(wet - dry) > 5.0
    assert 0.05 < under.mean() < 0.9
    assert wet[under].std() < 0.8 * dry[under].std()
    assert wet.mean() == pytest.approx(dry.mean(), abs=2.0)


def test_jpeg_compresses_the_image_of_the_sensor(ground: FineTerrain, camera: Camera) -> None:
    view = body_pose(ground, 20.0, 20.0, 0.4) @ camera.T_body_camera
    plain, fine, coarse = (
        Renderer(
            ground, AppearanceConfig(), camera, seed=4, imaging=QUIET.model_copy(update={"jpeg_quality": q})
        )
        for q in (None, 100, 10)
    )
    image = plain.render(view)
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 10])
    np.testing.assert_array_equal(coarse.render(view), cv2.imdecode(data, cv2.IMREAD_GRAYSCALE))
    assert np.abs(fine.render(view).astype(int) - image).max() <= 3


@pytest.mark.parametrize(
    ("x", "dz", "words"), [(20.0, -0.5, "below the ground"), (-5.0, 1200.0, "outside the terrain")]
)
def test_a_camera_that_cannot_be_is_refused(
    ground: FineTerrain, renderer: Renderer, x: float, dz: float, words: str
) -> None:
    pose = np.eye(4)
    pose[:3, 3] = 500000.0 + x, 6000020.0, dz
    if x > 0:
        pose[2, 3] += ground.elevation(pose[None, :2, 3])[0]
    with pytest.raises(InputError, match=words):
        renderer.render(pose)


def test_a_pose_of_wrong_shape_is_refused(renderer: Renderer) -> None:
    with pytest.raises(InputError, match="4 × 4"):
        renderer.depth(np.eye(3))
