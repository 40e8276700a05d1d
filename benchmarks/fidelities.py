"""Both fidelities beside each other: where surveys in images fall among drawn ones of the same sites.

Run with ``python -m benchmarks.fidelities``. The error model of the statistical fidelity is what the fit behind
``firnline fit`` found on six development surveys; nothing is fitted here. Along the routes of the lawnmower missions of ``benchmarks.vision_mission``
(``FIRNLINE_MISSION_SEEDS`` takes fewer), over the ground that was really there and with the same kind of receiver and the
same satellite cells, surveys are drawn again and again (``FIRNLINE_DRAWS`` of each site) and go through the same joint
estimate. No error is debiased.
"""

import os
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.image_surveys import Outcome, fixes_along, judged
from benchmarks.report import Row, main
from benchmarks.vision_mission import EXAMPLES, RECEIVERS, SEEDS, survey_of, treated
from planners import plan
from sim.config.mission import AidsConfig, MissionConfig, SensorConfig
from sim.instruments.gps import GPS_PROFILES
from sim.mission.runs import read_mission
from sim.simulate.simulation import simulate_statistical
from sim.world.fine_terrain import fine_terrain
from sim.world.site import World, build_world
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.data.route import Route
from survey.reconstruction.joint.joint_map import JointTerrain
from vision_slam import localize
from vision_slam.pipeline import image_config

IMAGES = SensorConfig(
    yaw_sigma_deg=0.0,
    heading_walk_deg_sqrt_m=0.036,
    tilt_sigma_deg=0.0836,
    tilt_bias_sigma_deg=0.182,
    scale_sigma=0.0161,
    step_sigma_m=0.015,
    landmarks_per_m=6.85,
    landmark_range_m=(5.03, 32.5),
    landmark_cross_sigma_m=(0.0111, 0.00366),
    landmark_along_sigma_m=(0.0775, 0.000571),
)
"""What `sim.simulate.error_model.fitted` made of the surveys of the seeds 51 to 53, 61 and 62 and the mission of seed 81."""
AIDS = AidsConfig(accelerometer=True, turn_at_start=False)
RECEIVER = "GPS of 60 s"
N_DRAWS = int(os.environ.get("FIRNLINE_DRAWS", "12"))


@dataclass(frozen=True)
class Site:
    """What is surveyed: the ground as it is, what the satellite knew of it, and where maps are judged."""

    ground: Dem
    prior: Dem
    nodes: Grid


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows."""
    if quick:
        yield from _drawn_once()
        return
    profile, assumed = RECEIVERS[RECEIVER]
    seen, drawn = [], []
    for number, seed in enumerate(SEEDS):
        survey = survey_of("lawnmower", seed, quick=False)
        seen.append(treated(survey, fixes_along(survey, profile, 2000 + number), assumed, "joint"))
        site = Site(survey.real.dem, survey.prior, survey.nodes)
        route = Route.read(survey.folder / "2-simulate" / "driven_route.geojson")
        mission = mission_of((f"seed={seed}",))
        drawn.append([surveyed(site, route, mission, 100 * seed + draw) for draw in range(N_DRAWS)])
        yield Row(f"seed {seed}, in images: RMSE", seen[-1].rmse_m, "m")
        middle = float(np.median([out.rmse_m for out in drawn[-1]]))
        yield Row(f"seed {seed}, drawn: RMSE, median", middle, "m")
    yield from compared(seen, drawn)


def _drawn_once() -> Iterator[Row]:
    """Draw one survey of the site of the first seed."""
    mission = mission_of((f"seed={SEEDS[0]}",))
    world, site = site_of(mission)
    found = surveyed(site, plan(world.area, world.prior, mission.planner), mission, SEEDS[0])
    yield Row("drawn: RMSE", found.rmse_m, "m")
    yield Row("drawn: coverage of 95 %", found.coverage, "1")


def compared(seen: list[Outcome], drawn: list[list[Outcome]]) -> Iterator[Row]:
    """Yield where surveys in images fall among those that were drawn of the same sites."""
    images = np.array([out.rmse_m for out in seen])
    by_site = [np.array([out.rmse_m for out in site]) for site in drawn]
    rmse = np.concatenate(by_site)
    low, middle, high = np.percentile(rmse, [5.0, 50.0, 95.0])
    yield Row("drawn: surveys", float(len(rmse)), "1")
    yield Row("drawn: RMSE, median", float(middle), "m")
    yield Row("drawn: RMSE, 5th percentile", float(low), "m")
    yield Row("drawn: RMSE, 95th percentile", float(high), "m")
    yield Row("in images: RMSE, median", float(np.median(images)), "m")
    yield Row("in images: RMSE, least", float(images.min()), "m")
    yield Row("in images: RMSE, worst", float(images.max()), "m")
    for name, done in (("drawn", [out for site in drawn for out in site]), ("in images", seen)):
        yield Row(f"{name}: coverage of 95 %, mean", float(np.mean([out.coverage for out in done])), "1")
    ranks = [float(np.mean(site < value)) for site, value in zip(by_site, images, strict=True)]
    yield Row("share of its own site's draws below a survey in images, mean", float(np.mean(ranks)), "1")
    within = bool(low <= np.median(images) <= high)
    bar = f"{low:.3g} to {high:.3g}"
    yield Row("in images: median, held to what is drawn in 90 %", float(np.median(images)), "m", bar, within)


def site_of(mission: MissionConfig) -> tuple[World, Site]:
    """Return a mission's world, with the relief that a rover in images drives over."""
    world = build_world(mission)
    ground = fine_terrain(world.terrain, mission.scenery, mission.seed).dem
    xmin, _, xmax, _ = world.area.bounds
    nodes = Grid.over(world.area.bounds, (xmax - xmin) / 80.0, world.prior.crs)
    return world, Site(ground, world.prior, nodes)


def mission_of(settings: tuple[str, ...]) -> MissionConfig:
    """Return the mission of the paper's survey with errors that are drawn."""
    mission = read_mission(EXAMPLES / "mendenhall_like.toml", ("fidelity=statistical", *settings))
    return mission.model_copy(update={"sensors": IMAGES, "aids": AIDS})


def surveyed(site: Site, route: Route, mission: MissionConfig, draw: int) -> Outcome:
    """Draw a survey, estimate path and map as for one in images, and judge it."""
    profile, assumed = RECEIVERS[RECEIVER]
    lasting = GPS_PROFILES[profile]
    fixes = {
        "gps_bias_sigma_m": lasting.bias_sigma_m,
        "gps_correlation_time_s": lasting.correlation_s,
        "gps_white_sigma_m": lasting.white_sigma_m,
    }
    sensors = mission.sensors.model_copy(update=fixes)
    recording, real = simulate_statistical(
        site.ground, route, mission.model_copy(update={"seed": draw, "sensors": sensors})
    )
    localized = localize(recording, image_config(assumed))
    path, points = localized.trajectory, localized.points
    assert path.error is not None
    found = JointTerrain(path.error, site.prior).map(points, site.nodes)
    return judged(found.reconstruction, real, path)


if __name__ == "__main__":
    main("Fidelities", measure)
