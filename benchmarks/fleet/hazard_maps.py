"""Probabilities of steep ground from the map of one rover, beside the slopes that the ground really has."""

from typing import Any

import numpy as np

from benchmarks.fleet.joint_maps import drives
from benchmarks.fleet.sites import FAMILIES, mission_on
from sim.world.site import build_world
from survey.data.grid import Grid
from survey.reconstruction.hazards import BASE_M, slope_hazard
from survey.reconstruction.joint.drives import SeveralDrives
from survey.reconstruction.mapping import map_landmarks

_NODES_M = 6.0
# Slopes over 2 m need ground that is finer: a raster of 2 m has no relief shorter than 4 m.
_GROUND_STEP_M = 0.5
_PERCENTILES = (50.0, 80.0, 95.0)
N_BINS = 5


def outcome(seed: int) -> dict[str, Any]:
    """Map a site and count, in bins of the probability, how often the slope is beyond the limit.

    The limits are percentiles of the true slopes, so that every site has ground on both sides of them.
    """
    mission = mission_on(seed, FAMILIES[seed % len(FAMILIES)], step_m=_GROUND_STEP_M)
    world = build_world(mission)
    several = SeveralDrives.of(drives(world, mission))
    grid = Grid.over(world.area.bounds, _NODES_M, world.area.crs)
    mapped = map_landmarks(
        several.points, grid, mission.reconstruction, prior=world.prior, path=several.path, area=world.area
    )
    assert mapped.solution is not None
    steps = 0.5 * BASE_M * np.eye(2)
    rises = [(world.terrain.at(grid.xy + s) - world.terrain.at(grid.xy - s)) / BASE_M for s in steps]
    slope = np.hypot(*rises)
    known = np.isfinite(slope)
    counts = np.zeros((3, N_BINS))
    for limit in np.percentile(slope[known], _PERCENTILES):
        hazard = slope_hazard(mapped.solution, grid, float(np.degrees(np.arctan(limit))))
        probability = hazard.probability.elevation.ravel()[known]
        bins = np.minimum((probability * N_BINS).astype(int), N_BINS - 1)
        beyond = (slope[known] > limit).astype(np.float64)
        counts += [np.bincount(bins, w, N_BINS) for w in (np.ones(len(bins)), probability, beyond)]
    nodes, expected, seen = counts.tolist()
    return {"seed": seed, "nodes": nodes, "expected": expected, "seen": seen}
