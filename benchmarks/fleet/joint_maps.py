"""One joint map of three rovers with a third of the swaths each, beside one rover's map and the three maps merged apart."""

from typing import Any, NamedTuple

import numpy as np

import planners
from benchmarks.fleet.sites import FAMILIES, mission_on
from benchmarks.moving_ice.chance import drawn_coverages
from sim.config.mission import MissionConfig
from sim.mission.fleet import route_of
from sim.simulate.simulation import simulate_statistical
from sim.world.site import World, build_world
from survey.core.arrays import FloatArray
from survey.data.grid import Grid
from survey.data.path_error import PathError
from survey.data.surface_points import SurfacePoints
from survey.reconstruction.checks import sampled_nodes
from survey.reconstruction.joint.drives import SeveralDrives
from survey.reconstruction.mapping import map_landmarks
from survey.reconstruction.method import MappedTerrain
from survey.reconstruction.terrain_map import CLAIM, Reconstruction
from vision_slam import localize

_NODES_M = 5.0
N_ROVERS = 3
_95 = 1.959964


class Judged(NamedTuple):
    """RMSE of a map [m], coverage of its 95 % interval, and error of its mean height [m]."""

    rmse_m: float
    coverage: float
    offset_m: float


def outcome(seed: int) -> dict[str, Any]:
    """Survey a site with one rover and with three, and judge the maps."""
    one, fleet = (mission_on(seed, FAMILIES[seed % len(FAMILIES)], n_rovers=n) for n in (1, N_ROVERS))
    world = build_world(one)
    alone, several = drives(world, one), drives(world, fleet)
    joint = {"one": mapped(world, one, alone), "joint": mapped(world, fleet, several)}
    maps = [mapped(world, one, [drive]).reconstruction for drive in several]
    found = {
        **{name: judged(world, *fields(one.reconstruction)) for name, one in joint.items()},
        "merged": judged(world, *merged(maps)),
    }
    stated = {name: _stated(one, world, seed) for name, one in joint.items()}
    return {"seed": seed, **{name: one._asdict() for name, one in found.items()}, "stated": stated}


def _stated(mapped: MappedTerrain, world: World, seed: int) -> dict[str, Any]:
    """Return what a map states of its error, and coverages by chance."""
    grid = mapped.reconstruction.mean.grid()
    inside = world.area.contains(grid.xy).reshape(grid.shape)
    drawn = drawn_coverages(mapped.solution, grid.xy[sampled_nodes(inside)], seed)
    return stated_errors(mapped.reconstruction) | {"drawn": drawn}


def stated_errors(reconstruction: Reconstruction) -> dict[str, float]:
    """Return the standard deviation of the level of a map, and the RMSE about it that the map expects [m]."""
    claim = reconstruction.diagnostics[CLAIM]
    return {"level_sigma_m": claim["offset_sigma_m"], "relative_m": claim["relative"]["expected_m"]}


def drives(world: World, mission: MissionConfig) -> list[tuple[SurfacePoints, PathError | None]]:
    """Return landmarks and path error of each rover of a mission."""
    route = planners.plan(world.area, world.prior, mission.planner, rover=mission.rover, fleet=mission.fleet)
    found = []
    for rover in range(route.n_rovers):
        alone = mission.of_rover(rover)
        recording, _ = simulate_statistical(world.terrain, route_of(route, rover), alone)
        estimate = localize(recording, alone.assumed)
        found.append((estimate.points, estimate.trajectory.error))
    return found


def mapped(
    world: World, mission: MissionConfig, drives: list[tuple[SurfacePoints, PathError | None]]
) -> MappedTerrain:
    """Map the landmarks of drives as a mission does."""
    several = SeveralDrives.of(drives)
    grid = Grid.over(world.area.bounds, _NODES_M, world.area.crs)
    return map_landmarks(
        several.points,
        grid,
        mission.reconstruction,
        prior=world.prior,
        path=several.path,
        area=world.area,
    )


def fields(reconstruction: Reconstruction) -> tuple[FloatArray, FloatArray, Grid]:
    """Return mean and standard deviation (H, W) [m], and the grid."""
    return reconstruction.mean.elevation, reconstruction.std.elevation, reconstruction.mean.grid()


def merged(maps: list[Reconstruction]) -> tuple[FloatArray, FloatArray, Grid]:
    """Merge maps as if their errors were independent: each node's mean weighted with the inverse variances."""
    weight = [1.0 / one.std.elevation**2 for one in maps]
    total: FloatArray = np.sum(weight, axis=0)
    mean = np.sum([w * one.mean.elevation for w, one in zip(weight, maps, strict=True)], axis=0) / total
    return mean, total**-0.5, maps[0].mean.grid()


def judged(world: World, mean: FloatArray, std: FloatArray, grid: Grid) -> Judged:
    """Compare a map with the real terrain inside the area."""
    error = mean.ravel() - world.terrain.at(grid.xy)
    inside = world.area.contains(grid.xy) & np.isfinite(error)
    error, sigma = error[inside], std.ravel()[inside]
    return Judged(
        float(np.sqrt(np.mean(error**2))),
        float(np.mean(np.abs(error) <= _95 * sigma)),
        float(error.mean()),
    )
