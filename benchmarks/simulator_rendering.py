"""The rover's images: speed beside renderers of pybullet and MuJoCo, exactness against a brute-force ray caster, looks."""

import os
import tempfile
import time
import tracemalloc
from collections.abc import Callable, Iterator
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from unittest.mock import patch

import cv2
import numba
import numpy as np

from benchmarks.report import Row, cpu_seconds, main
from benchmarks.small_inputs import BARE_SCENERY
from papers.glacier.images import (
    SKIES,
    SnowScene,
    at_contrast,
    clahe_yields,
    compare_with_photographs,
    gains,
    mountain_trap,
)
from sim.config.world import AppearanceConfig, ImagingConfig, SceneryConfig
from sim.rendering import Renderer, RoverBox
from sim.simulate.assembly import rover_camera
from sim.world.appearance import grain_tile, surface_tile
from sim.world.fine_terrain import FineTerrain, fine_terrain
from survey.core.arrays import FloatArray
from survey.core.streams import stream
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.terrain.random_fields import squared_exponential_field
from tests.sim.rendering.plan_view import plan_view
from tests.sim.rendering.reference import brute_force_depth

SEED = 77
BUSY = SceneryConfig(crevasses_per_ha=1.0, bridged_share=0.3, pools_per_ha=1.0)


def rows(quick: bool) -> Iterator[Row]:
    """Yield one row per claim."""
    _built(60.0)  # compiles
    ground, renderer = yield from _world_rows(600.0)
    yield from _speed_rows(ground, renderer, 2 if quick else 6)
    yield from _depth_rows(2 if quick else 8, 4000 if quick else 20000)
    yield from _flow_rows(2 if quick else 6)
    yield from _repeat_rows(2048 if quick else 4096)
    yield from _clahe_rows(*((2, 1) if quick else (6, 4)))
    if not quick:
        yield from _photograph_rows()


def _built(side_m: float) -> tuple[FineTerrain, Renderer]:
    grid = Grid((0.0, 0.0, side_m, side_m), 1.0)
    relief_m = 25.0 * side_m / 600.0
    terrain = squared_exponential_field(
        grid, stream(SEED, "terrain"), relief_m=relief_m, length_scale_m=220.0
    )
    ground = fine_terrain(terrain, BUSY, SEED)
    return ground, Renderer(ground, AppearanceConfig(), rover_camera(ImagingConfig()), SEED)


def _world_rows(side_m: float) -> Iterator[Row]:  # returns the world, too
    _forget()
    tracemalloc.start()
    world, seconds = cpu_seconds(lambda: _built(side_m))
    kept, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    name = f"world of {side_m:g} m at {world[0].step_m:g} m"
    yield Row.of(f"{name}: relief, hazards, light and textures, CPU", seconds, "s", "<=", 8.0)
    yield Row(f"{name}: memory kept", kept / 1e6, "MB")
    yield Row.of(f"{name}: most memory while building", peak / 1e6, "MB", "<=", 250.0)
    return world


def _forget() -> None:
    """Empty the caches of earlier worlds."""
    for kept in (surface_tile, grain_tile):
        kept.cache_clear()
    fine_terrain(Dem.on(Grid((0.0, 0.0, 9.0, 9.0), 1.0), np.zeros((10, 10))), BUSY, 0)


def _views(ground: FineTerrain, renderer: Renderer, n: int) -> list[tuple[FloatArray, RoverBox]]:
    """Poses of the camera near the middle, with the rover's box."""
    rng = stream(SEED, "views")
    middle = 0.5 * (np.array(ground.bounds[:2]) + np.array(ground.bounds[2:]))
    views = []
    for _ in range(n):
        body = standing(ground, *(middle + rng.uniform(-20.0, 20.0, 2)), rng.uniform(0.0, 2.0 * np.pi))
        box = body.copy()
        box[2, 3] += 0.3
        views.append((body @ renderer.camera.T_body_camera, RoverBox((0.7, 0.5, 0.35), box)))
    return views


def standing(
    ground: FineTerrain, x: float, y: float, yaw: float, tilt_rad: tuple[float, float] = (0.0, 0.0)
) -> FloatArray:
    """Return T_world_body of a rover at a place, with roll and pitch."""
    pose = np.eye(4)
    for axis, angle in ((2, yaw), (1, tilt_rad[1]), (0, tilt_rad[0])):
        pose[:3, :3] @= cv2.Rodrigues(angle * np.eye(3)[axis])[0]
    pose[:3, 3] = x, y, ground.elevation(np.array([[x, y]]))[0]
    return pose


def _least_ms(work: Callable[[], object], clock: Callable[[], float], n: int = 5) -> float:
    spent = []
    for _ in range(n):
        start = clock()
        work()
        spent.append(clock() - start)
    return 1e3 * min(spent)


def _speed_rows(ground: FineTerrain, renderer: Renderer, n_views: int) -> Iterator[Row]:
    views = _views(ground, renderer, n_views)
    small = Renderer(ground, AppearanceConfig(), renderer.camera.scaled(0.5), SEED)
    threads, cv_threads = numba.get_num_threads(), cv2.getNumThreads()
    cv2.setNumThreads(1)
    numba.set_num_threads(1)
    peers = [(name, scene, least) for name, load, least in _PEERS if (scene := load(ground)) is not None]
    times: list[list[float]] = []
    for view, box in views:  # alternating, so that what else the machine does meets all alike
        works: list[Callable[[], object]] = [
            lambda: renderer.render(view, rover_box=box),  # noqa: B023
            lambda: small.render(view, rover_box=box),  # noqa: B023
        ]
        spent = [_least_ms(work, time.process_time) for work in works]
        spent += [_least_ms(partial(scene, view), time.process_time, 2) for _, scene, _ in peers]
        times.append(spent)
    own, half, *others = np.mean(times, axis=0)
    yield Row.of("640 × 480, lens, shadows, pools, crevasses, noise: CPU", own, "ms", "<=", 15.0)
    for (name, _, least), other in zip(peers, others, strict=True):
        yield Row(f"{name}, 640 × 480, the same ground at 1 m: CPU", other, "ms")
        yield Row.of(f"{name}: time over ours", other / own, "1", ">=", least)
    yield Row("320 × 240: CPU", half, "ms")
    yield Row.of("640 × 480 over 320 × 240", own / half, "1", ">=", 3.3)
    if threads >= 2:
        yield from _thread_rows(renderer, views[0])
    numba.set_num_threads(threads)
    cv2.setNumThreads(cv_threads)


def _thread_rows(renderer: Renderer, view: tuple[FloatArray, RoverBox]) -> Iterator[Row]:
    # On a busy machine wall times say little: the larger share of the work bounds what two threads can give.
    alone = _least_ms(lambda: _row_share(renderer, view[0], 0, 1), time.process_time)
    shares = [_least_ms(lambda k=k: _row_share(renderer, view[0], k, 2), time.process_time) for k in (0, 1)]
    yield Row("work of one thread over the larger share of two, image rows, CPU", alone / max(shares), "1")
    wall: dict[int, list[float]] = {1: [], 2: []}
    images = {}
    for _ in range(12):
        for n in (1, 2):
            numba.set_num_threads(n)
            wall[n].append(
                _least_ms(lambda: renderer.render(view[0], rover_box=view[1]), time.perf_counter, 1)
            )
            images[n] = renderer.render(view[0], rover_box=view[1])
    yield Row.of("two threads over one, wall time", min(wall[1]) / min(wall[2]), "1", ">=", 1.7)
    yield Row.of(
        "bytes that differ between one thread and two", float((images[1] != images[2]).sum()), "1", "<=", 0.0
    )


def _row_share(renderer: Renderer, view: FloatArray, worker: int, n_workers: int) -> None:
    """Do the work of one of several threads."""

    def one(kernel: Callable[..., None], *arguments: object) -> None:
        kernel(worker, n_workers, *arguments)

    with patch("sim.rendering.renderer.share_out", one):
        renderer.trace(view, None, None, shaded=True)


def _coarse(ground: FineTerrain) -> FloatArray:
    """Return the heights of the ground 1 m apart, southern row first, as many rows as columns."""
    every = round(1.0 / ground.step_m)
    heights = ground.height[::-1][::every, ::every].astype(float)
    return heights[: min(heights.shape), : min(heights.shape)]


def _mujoco_scene(ground: FineTerrain) -> Callable[[FloatArray], object] | None:
    """Load the ground into MuJoCo; return what renders a view of it on one thread, None where MuJoCo finds no OpenGL."""
    os.environ |= {"MUJOCO_GL": "egl", "LIBGL_ALWAYS_SOFTWARE": "1", "LP_NUM_THREADS": "0"}
    try:
        import mujoco
    except (ImportError, AttributeError):  # the latter without a library of EGL
        return None
    heights = _coarse(ground)
    low, relief, half = float(heights.min()), float(np.ptp(heights)), 0.5 * (len(heights) - 1)
    west, south, *_ = ground.bounds
    model = mujoco.MjModel.from_xml_string(f"""<mujoco>
      <visual><global offwidth="640" offheight="480"/><map znear="0.0002" zfar="2"/></visual>
      <asset><hfield name="ground" nrow="{len(heights)}" ncol="{len(heights)}" size="{half} {half} {relief} 1"/></asset>
      <worldbody>
        <light directional="true" dir="-1 0 -0.5"/><camera name="camera" fovy="64"/>
        <geom type="hfield" hfield="ground" pos="{west + half} {south + half} {low}"/>
      </worldbody></mujoco>""")
    model.hfield_data[:] = ((heights - low) / relief).ravel()
    data = mujoco.MjData(model)
    try:
        renderer = mujoco.Renderer(model, 480, 640)
    except (mujoco.FatalError, ImportError, RuntimeError):
        return None

    def render(view: FloatArray) -> object:
        model.cam_pos[0] = view[:3, 3]
        mujoco.mju_mat2Quat(model.cam_quat[0], (view[:3, :3] * (1.0, -1.0, -1.0)).ravel())
        mujoco.mj_forward(model, data)
        renderer.update_scene(data, "camera")
        return renderer.render()

    return render


def _bullet_scene(ground: FineTerrain) -> Callable[[FloatArray], object] | None:
    """Load the ground into pybullet; return what renders a view of it, None where pybullet is not installed."""
    if find_spec("pybullet") is None:
        return None
    import pybullet

    pybullet.connect(pybullet.DIRECT)
    heights = _coarse(ground)
    shape = pybullet.createCollisionShape(
        pybullet.GEOM_HEIGHTFIELD,
        meshScale=[1.0, 1.0, 1.0],
        heightfieldData=heights.ravel().tolist(),
        numHeightfieldRows=heights.shape[1],
        numHeightfieldColumns=heights.shape[0],
    )
    body = pybullet.createMultiBody(0, shape)
    middle = 0.5 * (np.array(ground.bounds[:2]) + np.array(ground.bounds[2:]))
    level = 0.5 * float(heights.max() + heights.min())
    pybullet.resetBasePositionAndOrientation(body, [*middle, level], [0.0, 0.0, 0.0, 1.0])
    lens = pybullet.computeProjectionMatrixFOV(80.0, 640.0 / 480.0, 0.1, 900.0)

    def render(view: FloatArray) -> object:
        eye, ahead, up = view[:3, 3], view[:3, 2], -view[:3, 1]
        pose = pybullet.computeViewMatrix(eye.tolist(), (eye + ahead).tolist(), up.tolist())
        return pybullet.getCameraImage(640, 480, pose, lens, shadow=1, renderer=pybullet.ER_TINY_RENDERER)

    return render


_PEERS = (
    ("pybullet's TINY_RENDERER", _bullet_scene, 16.0),
    ("MuJoCo's renderer, OpenGL of Mesa on one thread", _mujoco_scene, 10.0),
)
"""Name, what loads the ground, and how many times our CPU time the peer's is to be."""


def _depth_rows(n_views: int, n_rays: int) -> Iterator[Row]:
    ground, renderer = _built(160.0)
    rng = stream(SEED, "depth")
    snow = [
        standing(
            ground, *rng.uniform(40.0, 120.0, 2), rng.uniform(0.0, 6.3), tuple(rng.uniform(-0.2, 0.2, 2))
        )
        for _ in range(n_views)
    ]
    crevasses = [hazard.outline for hazard in ground.hazards if hazard.kind == "crevasse"]
    beside = []
    for k in range(n_views):
        place, yaw = crevasses[k % len(crevasses)].representative_point(), rng.uniform(0.0, 6.3)
        back = rng.uniform(2.0, 6.0)
        x, y = place.x - back * np.cos(yaw), place.y - back * np.sin(yaw)
        beside.append(standing(ground, float(np.clip(x, 5, 155)), float(np.clip(y, 5, 155)), yaw))
    for name, poses in (("snow", snow), ("crevasses at 2 to 6 m", beside)):
        wrong, seen, worst = 0, 0, 0.0
        for pose in poses:
            bad, n = _wrong_depths(ground, renderer, pose @ renderer.camera.T_body_camera, rng, n_rays)
            wrong, seen, worst = wrong + bad, seen + n, max(worst, bad / n)
        yield Row.of(f"depth to 30 m within 2 cm, {name}", 100.0 * (1.0 - wrong / seen), "%", ">=", 99.9)
        yield Row(f"depth to 30 m within 2 cm, {name}, worst view", 100.0 * (1.0 - worst), "%")


def _wrong_depths(
    ground: FineTerrain, renderer: Renderer, view: FloatArray, rng: np.random.Generator, n_rays: int
) -> tuple[int, int]:
    camera = renderer.camera
    pixels = np.column_stack([rng.integers(0, camera.width, n_rays), rng.integers(0, camera.height, n_rays)])
    exact = brute_force_depth(ground, view[:3, 3], camera.rays(pixels.astype(float)) @ view[:3, :3].T, 30.0)
    depth = renderer.depth(view)[pixels[:, 1], pixels[:, 0]].astype(float)
    near = np.isfinite(exact)
    missed = np.abs(depth[near] - exact[near]) > 0.02
    return int(missed.sum() + (depth[~near] < 29.98).sum()), int(near.sum())


def _flow_rows(n_pairs: int) -> Iterator[Row]:
    imaging = ImagingConfig(noise="off", gain=150.0)
    scene = SnowScene(AppearanceConfig(), SEED, imaging)
    renderer, camera = scene.renderer, scene.renderer.camera
    exact, tracked = [], []
    for drive in range(n_pairs):
        first, second = scene.pose(drive), scene.pose(drive, 0.05)
        pair = scene.pair(drive, 0.05)
        near = pair.mask & (renderer.depth(first) < 30.0)
        v, u = (place[::37] for place in np.nonzero(near))
        start = np.column_stack([u, v]).astype(float)
        rays = camera.rays(start + pair.flow[v, u])
        far = brute_force_depth(renderer.terrain, second[:3, 3], rays @ second[:3, :3].T, 40.0)
        met = (rays * far[:, None]) @ second[:3, :3].T + second[:3, 3]
        exact.append(np.linalg.norm(camera.project((met - first[:3, 3]) @ first[:3, :3]) - start, axis=1))
        corners = cv2.goodFeaturesToTrack(pair.first, 2000, 1e-6, 5, mask=near.astype(np.uint8) * 255)
        ends, status, _ = cv2.calcOpticalFlowPyrLK(pair.first, pair.second, corners, None, winSize=(21, 21))
        kept = status.ravel() == 1
        u, v = np.rint(corners[kept, 0]).astype(int).T
        tracked.append((ends - corners)[kept, 0] - pair.flow[v, u])
    errors = np.concatenate(exact)
    within = 100.0 * float(np.mean(errors < 0.1))
    yield Row.of("flow leads to the same place within 0.1 px", within, "%", ">=", 99.0)
    bias = float(np.abs(np.median(np.concatenate(tracked), axis=0)).max())
    yield Row.of("flow against images tracked by KLT, common part", bias, "px", "<=", 0.1)


def _repeat_rows(n: int) -> Iterator[Row]:
    bare = SceneryConfig(**BARE_SCENERY)
    flat = Dem.on(Grid((0.0, 0.0, 180.0, 180.0), 1.0), np.zeros((181, 181)))
    camera = rover_camera(ImagingConfig(width=80, height=60))
    renderer = Renderer(fine_terrain(flat, bare, SEED), AppearanceConfig(), camera, SEED)
    for texel_m, away_m in ((0.0025, 1.0), (0.01, 2.0), (0.04, 2.0)):
        plan = plan_view(renderer, (5.0, 5.0), (n, n), texel_m).astype(float)
        lag_m, correlation = autocorrelation(plan, texel_m)
        peak = float(np.abs(correlation[lag_m > away_m]).max())
        name = (
            f"autocorrelation of the albedo beyond {away_m:g} m, {n * texel_m:.0f} m at {100 * texel_m:g} cm"
        )
        yield Row.of(name, peak, "1", "<=", 0.3)


def autocorrelation(plan: FloatArray, texel_m: float) -> tuple[FloatArray, FloatArray]:
    """Return lags [m] and unbiased correlations up to half the plan's side."""
    n = len(plan)
    plan = plan - plan.mean()
    padded = (2 * n, 2 * n)
    overlap = np.fft.irfft2(np.abs(np.fft.rfft2(np.ones_like(plan), padded)) ** 2)
    products = np.fft.irfft2(np.abs(np.fft.rfft2(plan, padded)) ** 2)
    lag = np.minimum(np.arange(2 * n), 2 * n - np.arange(2 * n))
    near = lag <= n // 2
    ratio = (products / np.maximum(overlap, 1.0))[np.ix_(near, near)]
    return np.hypot(*np.meshgrid(lag[near], lag[near])) * texel_m, ratio / ratio[0, 0]


def _clahe_rows(n_scenes: int, n_pairs: int) -> Iterator[Row]:
    counts, traps = [], []
    for number, (name, sky) in enumerate(list(SKIES.items())[:n_scenes]):
        scene = at_contrast(sky, 500 + number)
        yield Row(f"local contrast of the snow, {name}", 100.0 * scene.ground_contrast(), "%")
        counts += list(clahe_yields(name, scene, n_pairs))
        if scene.look.ridges_deg > 0.0:
            traps.append(mountain_trap(scene))
    found = gains(counts)
    for method, limit in (("GFTT + KLT", 5.0), ("ORB", 15.0), ("SIFT", 15.0)):
        what = f"correct matches after CLAHE over before, {method}"
        yield Row.of(f"{what}, {n_scenes} scenes together", found[method]["together"], "1", ">=", limit)
        yield Row(f"{what}, median scene", found[method]["median scene"], "1")
        yield Row(f"{what}, worst scene", found[method]["worst scene"], "1")
    relative = found["GFTT + KLT, relative threshold"]["together"]
    yield Row("the same with a relative threshold, GFTT + KLT", relative, "1")
    hidden, shown = (sum(trap[key] for trap in traps) for key in ("mountains painted over", "with mountains"))
    yield Row(
        "corners on snow by a relative threshold: without over with mountains", hidden / max(shown, 1), "1"
    )


def _photograph_rows() -> Iterator[Row]:
    with tempfile.TemporaryDirectory() as folder:
        found = compare_with_photographs(Path(folder), quick=False, progress=lambda *_: None)
    if found["compared"]:
        yield Row.of(
            f"measures within the spread of photographs, of {found['of']}", found["within"], "1", ">=", 5.0
        )


if __name__ == "__main__":
    main("Simulator rendering", rows, packages=("numpy", "numba", "opencv-python-headless", "pybullet"))
