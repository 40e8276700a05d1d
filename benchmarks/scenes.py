"""Measure what horizon, clouds, ruts and colour cost, and what odometry makes of them: ``python -m benchmarks.scenes``.

Each switch of the scene is turned on by itself, and all together. The CPU time of an image is divided by that of the same image
without any of them, rendered in turns in one process. Drives of 24 m lead out and back beside their own ruts, on windows of the
real elevations that matplotlib installs, without switches, with the horizon, with clouds, and with all: the same way, seeds and noise. The error of the odometry
is that of the last place after the best rotation and shift, over the way. Nothing was chosen on these seeds. The mountains
of that sample are low, and the odometry follows corners on the ground above all: read the rows as a check that the switches
neither help nor harm, not as a forecast for high mountains.
"""

import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.report import Row, main
from sim.config.mission import MissionConfig
from sim.rendering import Renderer, RoverBox
from sim.simulate.assembly import camera_on_rover, rover_camera
from sim.simulate.vision import simulate_vision
from sim.world.fine_terrain import fine_terrain
from survey import Dem, Grid, Leg, Route
from survey.core import FloatArray
from survey.core.config import validated
from survey.core.streams import stream
from survey.terrain.real import sample_site
from survey.terrain.satellite import smooth_interpolation
from vision_slam.evaluation import alignment
from vision_slam.motion import dead_reckoning
from vision_slam.odometry.visual_odometry import visual_odometry

SEEDS = (9101, 9102)
DRIVEN = ("none", "horizon", "clouds", "all")
SIDE_M, WAY_M, ASIDE_M = 60.0, 11.0, 2.0
_N_IMAGES = 16
SWITCHES: dict[str, dict[str, dict[str, Any]]] = {
    "none": {},
    "horizon": {"appearance": {"horizon": "terrain"}},
    "clouds": {"appearance": {"clouds": 0.4}},
    "ruts": {"appearance": {"ruts": True}},
    "colour": {"imaging": {"colour": True}},
    "all": {"appearance": {"horizon": "terrain", "clouds": 0.4, "ruts": True}, "imaging": {"colour": True}},
}


class Outcome(NamedTuple):
    """Error over the way [%], corners that agree with the pose, and the share of images that gave a pose."""

    error: float
    inliers: float
    visual: float


def rows(quick: bool) -> Iterator[Row]:
    """Yield the rows."""
    yield from _costs(SEEDS[0])
    for name in ("none", "all") if quick else DRIVEN:
        found = [_driven(seed, name) for seed in (SEEDS[:1] if quick else SEEDS)]
        errors, inliers, visual = (np.array(values) for values in zip(*found, strict=True))
        yield Row(
            f"{name}: error of odometry over the way, median of the drives", float(np.median(errors)), "%"
        )
        yield Row(f"{name}: error of odometry over the way, worst of the drives", float(errors.max()), "%")
        yield Row(f"{name}: corners that agree with the pose, mean", float(inliers.mean()), "1")
        yield Row.of(
            f"{name}: images that give a pose, least of the drives", 100.0 * visual.min(), "%", ">=", 95.0
        )


def _mission(seed: int, name: str) -> MissionConfig:
    content: dict[str, Any] = {
        "schema_version": 1,
        "name": "scene",
        "seed": seed,
        "fidelity": "vision",
        "terrain": {"source": "srtm-sample"},
        "planner": {"pattern": "lawnmower", "swaths": 1},
        "rover": {"mass_kg": 18.0, "idle_w": 20.0},
        "scenery": {"crevasses_per_ha": 0.0, "pools_per_ha": 0.0, "channels_per_ha": 0.0},
        **SWITCHES[name],
    }
    return validated(MissionConfig, content, "the benchmark")


def _site(seed: int) -> Dem:
    """Return a window of the site of the real sample."""
    prior, (west, south, east, north) = sample_site()
    rng = stream(seed, "scenes")
    x, y = rng.uniform(west, east - SIDE_M), rng.uniform(south, north - SIDE_M)
    return smooth_interpolation(prior, Grid((x, y, x + SIDE_M, y + SIDE_M), 1.0, prior.crs))


def _costs(seed: int) -> Iterator[Row]:
    """Yield the CPU time of an image with each switch over that without, the medians of images in turns."""
    site = _site(seed)
    renderers = {name: _renderer(site, _mission(seed, name)) for name in SWITCHES}
    times = {name: list[float]() for name in SWITCHES}
    for k in range(_N_IMAGES):
        for name, (renderer, T_world_body) in renderers.items():
            begin = time.process_time()
            view, box = T_world_body @ renderer.camera.T_body_camera, RoverBox((0.7, 0.55, 0.3), T_world_body)
            renderer.render(view, float(k), k, rover_box=box)
            times[name].append(time.process_time() - begin)
    typical = {name: float(np.median(values[2:])) for name, values in times.items()}
    yield Row("none: CPU time of an image of 640 × 480", 1e3 * typical["none"], "ms")
    for name in list(SWITCHES)[1:]:
        yield Row(f"{name}: CPU time of an image over that without", typical[name] / typical["none"], "1")


def _renderer(site: Dem, mission: MissionConfig) -> tuple[Renderer, FloatArray]:
    """Return the renderer of a rover that has driven a loop before it, and the pose of its body."""
    ground = fine_terrain(site, mission.scenery, mission.site_seed)
    camera = camera_on_rover(ground, mission.appearance, rover_camera(mission.imaging), mission)
    renderer, ruts = camera.renderer, camera.ruts
    place = ground.origin + 0.5 * SIDE_M
    if ruts is not None:
        for turn in np.linspace(0.0, 2.0 * np.pi, 400):
            x, y = 0.5 * SIDE_M + 4.0 + 3.0 * np.array([np.cos(turn), np.sin(turn)])
            ruts.press(float(x), float(y), float(turn + 0.5 * np.pi))
    T_world_body = np.eye(4)
    T_world_body[:3, 3] = *place, ground.elevation(place[None])[0]
    return renderer, T_world_body


def _driven(seed: int, name: str) -> Outcome:
    """Drive out and back with a switch on, and judge the odometry."""
    site, mission = _site(seed), _mission(seed, name)
    xmin, ymin, _, _ = site.bounds
    x, y = xmin + 0.5 * (SIDE_M - WAY_M), ymin + 0.5 * SIDE_M
    corners = np.array([[x, y], [x + WAY_M, y], [x + WAY_M, y + ASIDE_M], [x, y + ASIDE_M]])
    route = Route((Leg("swath", corners),), site.crs, "out and back")
    with tempfile.TemporaryDirectory() as folder:
        drive = simulate_vision(site, route, mission, Path(folder) / "recording")
        found = visual_odometry(drive.recording)
    real, times = drive.truth.trajectory, found.odometry.time_s
    places = np.column_stack([np.interp(times, real.time_s, axis) for axis in real.position.T])
    path = dead_reckoning(found.odometry, np.zeros(3))
    best = alignment(path, places, "se3")
    last_m = np.linalg.norm(best.rotation @ path[-1] + best.translation - places[-1])
    inliers = np.mean([health.n_inliers for health in found.health])
    visual = np.mean([health.is_visual for health in found.health[1:]])
    return Outcome(100.0 * float(last_m) / real.length_m, float(inliers), float(visual))


if __name__ == "__main__":
    main("Scenes", rows, packages=("numpy", "numba", "opencv-python-headless"))
