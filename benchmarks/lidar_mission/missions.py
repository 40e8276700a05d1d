"""One mission with a LiDAR: maps from its scans and from its landmarks, by the same estimated path."""

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import planners
from benchmarks.fleet.joint_maps import judged, mapped
from benchmarks.fleet.sites import FAMILIES, on_site
from benchmarks.mission_settings import stated_mission
from benchmarks.report import cpu_seconds
from sim.config.mission import MissionConfig
from sim.mission.drives import register_scans
from sim.simulate.simulation import simulate_statistical
from sim.world.site import World, build_world
from survey.data.recording import Recording
from survey.data.sensors.lidar import LidarScans
from survey.data.surface_points import SurfacePoints
from survey.data.trajectory import Trajectory
from vision_slam import localize

SIDE_M, N_SWATHS, N_STAKES = 600.0, 4, 4
# The LiDAR sees 80 m and more beyond the area; a site that ended there would give it nothing but blown snow.
_MARGIN_M = 80.0


def mission_on(seed: int) -> MissionConfig:
    """Return the mission on a random site, with the default LiDAR of 32 beams."""
    sections = {
        "planner": {"pattern": "lawnmower", "swaths": N_SWATHS},
        "aids": {"accelerometer": True, "stakes": N_STAKES},
        "sensors": {"lidar": {"beams": 32}},
    }
    site = on_site(FAMILIES[seed % len(FAMILIES)], SIDE_M, margin_m=_MARGIN_M)
    return stated_mission("lidar-benchmark", seed, site | sections)


def outcome(seed: int) -> dict[str, Any]:
    """Simulate a mission, map it by its scans and by its landmarks, and judge both maps."""
    mission = mission_on(seed)
    world = build_world(mission)
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "recording"
        _, simulate_s = cpu_seconds(lambda: _record(world, mission, place))
        recording = Recording.read(place)
        (points, path, landmarks), points_s = cpu_seconds(lambda: _points(recording, mission))
        facts = _facts(recording.lidar, place)
    by_scans, map_s = cpu_seconds(lambda: mapped(world, mission, [(points, path.error)]))
    by_landmarks = mapped(world, mission, [(landmarks, path.error)])
    maps = {"scans": by_scans.reconstruction, "landmarks": by_landmarks.reconstruction}
    scores = {
        kind: judged(world, one.mean.elevation, one.std.elevation, one.mean.grid())._asdict()
        for kind, one in maps.items()
    }
    times = {"simulate_cpu_s": simulate_s, "estimate_cpu_s": points_s + map_s}
    return {"seed": seed, **scores, **times, "drive_s": float(path.time_s[-1]), **facts}


def _record(world: World, mission: MissionConfig, place: Path) -> None:
    """Simulate the drive, and write its recording with all scans."""
    route = planners.plan(world.area, world.prior, mission.planner, rover=mission.rover, fleet=mission.fleet)
    recording, _ = simulate_statistical(world.terrain, route, mission)
    recording.write(place)


def _points(recording: Recording, mission: MissionConfig) -> tuple[SurfacePoints, Trajectory, SurfacePoints]:
    """Return the points of the scans, the estimated path, and the landmarks."""
    estimate = localize(recording, mission.assumed)
    return register_scans(recording, estimate.trajectory, mission), estimate.trajectory, estimate.points


def _facts(lidar: LidarScans | None, place: Path) -> dict[str, float]:
    """Return the number of returns, and the size of the scans on the disk."""
    assert lidar is not None
    n_returns = sum(len(lidar.minutes[k].scan) for k in range(len(lidar.minutes)))
    n_bytes = sum(file.stat().st_size for file in (place / "lidar").iterdir())
    return {"n_returns": n_returns, "scans_mb": round(n_bytes / np.float64(1e6), 1)}
