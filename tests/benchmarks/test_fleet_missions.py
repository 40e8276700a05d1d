"""Missions of the benchmarks of fleets and LiDAR can be driven as their documentation says."""

import planners
from benchmarks.fleet.image_missions import N_ROVERS, SHORT, mission_of
from benchmarks.fleet.sites import on_site
from benchmarks.lidar_mission.missions import N_STAKES, N_SWATHS, SIDE_M, mission_on
from sim.config.sensors import LidarConfig
from sim.world.site import build_world

DEVELOPMENT_SEED = 41


def test_every_rover_of_the_fleet_in_images_has_a_swath() -> None:
    mission = mission_of(DEVELOPMENT_SEED, SHORT)
    world = build_world(mission)
    route = planners.plan(world.area, world.prior, mission.planner, rover=mission.rover, fleet=mission.fleet)
    assert {leg.rover for leg in route.swaths} == set(range(N_ROVERS))
    assert len(route.swaths) == SHORT.n_swaths


def test_a_lidar_mission_has_ground_beyond_its_area_and_stakes() -> None:
    mission = mission_on(DEVELOPMENT_SEED)
    (west, south, east, north), (x, y) = mission.area.bounds_m, mission.terrain.origin_m
    assert (east - west, north - south) == (SIDE_M, SIDE_M)
    assert min(west - x, south - y) == 80.0
    assert mission.terrain.size_m == SIDE_M + 160.0
    assert (mission.aids.stakes, mission.planner.swaths) == (N_STAKES, N_SWATHS)
    assert mission.sensors.lidar.beams > LidarConfig().beams


def test_a_site_without_a_margin_is_all_area() -> None:
    sections = on_site("matern-5/2", 300.0)
    assert sections["terrain"]["size_m"] == 300.0
    assert sections["area"]["bounds_m"][:2] == sections["terrain"]["origin_m"]
