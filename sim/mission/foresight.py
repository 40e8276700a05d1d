"""How wrong the map of a mission will be, errors of the rover's place included, before it is driven.

The mission is rehearsed on the prior: where landmarks will lie and how their errors will be
shared follows from the route and the sensors alone. The joint estimate's covariance needs no
heights; those of the rehearsal only give the slopes.
"""

from collections.abc import Iterable, Iterator
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.special import gammainc

import planners
from planners.guarantee.assurance import fewest
from sim.config.mission import MissionConfig
from sim.simulate.aiding import with_way_home
from sim.simulate.statistical import simulate_statistical
from sim.world.site import World
from survey.core.arrays import FloatArray
from survey.core.errors import ConfigError, InputError
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.data.route import Route
from survey.reconstruction import GaussianProcessConfig
from survey.reconstruction.gp.selection.families import likeliest
from survey.reconstruction.joint.joint_map import JointTerrain
from survey.reconstruction.joint.solution import JointSolution
from vision_slam import localize

_NODES_ALONG = 20
_BEYOND_M = 60.0
_STEP_M = 5.0
_UNSTATED_SIGMA_M, _UNSTATED_NUGGET_M = 1.0, 0.15
_N_LEAST = 9
# Where the search for a number of swaths begins.
_FIRST_TRIED = 4


class Foreseen(NamedTuple):
    """What a mission promises: expected RMSE [m], that of the site's mean height [m], chance of meeting the limit, drive [m]."""

    swaths: int
    stakes: int
    rmse_m: float
    site_mean_m: float
    chance: float
    length_m: float

    def __str__(self) -> str:
        stakes = f" with {self.stakes} stakes" if self.stakes else ""
        return f"{self.swaths} swaths{stakes}: {self.rmse_m:.2f} m, {100 * self.chance:.0f} %, {self.length_m:.0f} m to drive"


def foresee(mission: MissionConfig, world: World, *, limit_m: float) -> Foreseen:
    r"""Predict the error of the map of a mission, with all that its landmarks share.

    With the joint covariance C of M nodes the mean squared error has the mean tr C / M and
    the variance 2 tr C² / M²; the chance to stay within the limit is that of the gamma
    distribution with these moments (Satterthwaite 1946).

    Parameters
    ----------
    mission : MissionConfig
        Pattern, sensors, aids and what is assumed of them.
    world : World
        Its area and prior are used, and nothing else.
    limit_m : float
        RMSE that is wanted [m].

    Raises
    ------
    InputError
        A prior that does not tell a length scale, or no landmark in sight.
    ConfigError
        A mission that has no landmarks to share errors.

    Notes
    -----
    As good as the covariance that is read from the prior, and the stated sensors. Relief
    finer than the prior can tell is taken for 0.15 m, or ``reconstruction.gp.nugget_m``.
    """
    if mission.fidelity == "ideal":
        raise ConfigError(
            "the ideal fidelity has no errors of place to foresee; set fidelity = 'statistical'."
        )
    solution, route = _rehearsed(mission, world)
    xmin, ymin, xmax, ymax = world.area.bounds
    step = max(xmax - xmin, ymax - ymin) / _NODES_ALONG
    nodes = Grid(
        (xmin + step / 2, ymin + step / 2, xmax - step / 2, ymax - step / 2), step, world.area.crs
    ).xy
    nodes = nodes[world.area.contains(nodes)]
    if not len(nodes):
        raise InputError("the area is too narrow for a grid of 20 nodes along it; foresee a larger one.")
    return _promised(solution.covariance(nodes), limit_m, mission, route)


def ways_to_meet(
    mission: MissionConfig,
    world: World,
    *,
    limit_m: float,
    chance: float = 0.9,
    least_swaths: int = 2,
    most_swaths: int = 8,
) -> Iterator[Foreseen]:
    """Yield, for 0, 2 and 4 stakes, the fewest swaths that meet the limit with the wanted chance, if any do."""
    if not isinstance(mission.planner, planners.LawnmowerConfig | planners.WavyConfig):
        raise ConfigError(
            f"stakes and swaths are weighed for the patterns lawnmower and wavy, not {mission.planner.pattern}; take one of them."
        )
    first = min(max(least_swaths, _FIRST_TRIED), most_swaths)
    for stakes in (0, 2, 4):
        aids = mission.aids.model_copy(update={"stakes": stakes})
        staked = mission.model_copy(update={"aids": aids})
        found = _fewest_swaths(
            staked, world, limit_m, chance, counts=range(least_swaths, most_swaths + 1), first=first
        )
        if found is not None:
            first = found.swaths
            yield found


def _fewest_swaths(
    mission: MissionConfig, world: World, limit_m: float, chance: float, *, counts: range, first: int
) -> Foreseen | None:
    """Return the fewest swaths that are foreseen to be enough, sought from `first` on."""

    @cache
    def foreseen(swaths: int) -> Foreseen:
        sized = mission.planner.model_copy(update={"swaths": swaths, "spacing_m": None})
        return foresee(mission.model_copy(update={"planner": sized}), world, limit_m=limit_m)

    nth = fewest(
        lambda n: foreseen(counts[n - 1]).chance >= chance, first=counts.index(first) + 1, most=len(counts)
    )
    return None if nth is None else foreseen(counts[nth - 1])


def cheapest(ways: Iterable[Foreseen]) -> Foreseen | None:
    """Return the way with the least to drive, and of those the one with the fewest stakes."""
    return min(ways, key=lambda way: (round(way.length_m), way.stakes), default=None)


def _rehearsed(mission: MissionConfig, world: World) -> tuple[JointSolution, Route]:
    """Drive the mission over the prior, localize, and solve for what would be known."""
    ground = _read_beyond(world.prior, world.area.bounds)
    route = planners.plan(world.area, world.prior, mission.planner)
    if mission.aids.way_home:
        route = with_way_home(route, world.area)
    recording, _ = simulate_statistical(ground, route, mission)
    localized = localize(recording, mission.assumed)
    path, points = localized.trajectory, localized.points
    if path.error is None:
        raise ConfigError("the mission has no odometry, so that nothing is known of shared errors; add it.")
    joint = mission.reconstruction.joint
    sigma_m = joint.satellite.sigma_m or _UNSTATED_SIGMA_M
    nugget_m = mission.reconstruction.gp.nugget_m
    nugget_m = _UNSTATED_NUGGET_M if nugget_m is None else nugget_m
    config = _covariance_of(world.prior, world.area.bounds, sigma_m, nugget_m)
    stated = joint.satellite.model_copy(update={"sigma_m": sigma_m})
    prior = world.prior if mission.reconstruction.use_prior else None
    model = JointTerrain(path.error, prior, config, joint.model_copy(update={"satellite": stated}))
    return model.solved(points, world.area.bounds), route


def _covariance_of(
    prior: Dem, bounds: tuple[float, float, float, float], sigma_m: float, nugget_m: float
) -> GaussianProcessConfig:
    """Read the likeliest smooth covariance about a plane from the cells, whose own error is no terrain."""
    xy, height = prior.xy, prior.elevation.ravel()
    near = ((xy >= bounds[:2]) & (xy <= bounds[2:])).all(axis=1) & np.isfinite(height)
    if near.sum() < _N_LEAST:
        raise InputError(
            f"{int(near.sum())} known cells of the prior lie on the area; {_N_LEAST} are needed to tell how it varies."
        )
    columns = np.column_stack([np.ones(int(near.sum())), xy[near] - xy[near].mean(axis=0)])
    rest = height[near] - columns @ np.linalg.lstsq(columns, height[near], rcond=None)[0]
    asked = GaussianProcessConfig(family="squared-exponential", nugget_m=0.0)
    kernel = likeliest(xy[near], rest, np.full(len(rest), sigma_m**2), asked).kernel
    return GaussianProcessConfig(
        fit=False, variance_m2=kernel.variance_m2, length_scale_m=kernel.length_scales_m[0], nugget_m=nugget_m
    )


def _read_beyond(prior: Dem, bounds: tuple[float, float, float, float]) -> Dem:
    """Read the prior on 5 m, and what a camera sees beyond it as its nearest cell."""
    xmin, ymin, xmax, ymax = bounds
    grid = Grid.over(
        (xmin - _BEYOND_M, ymin - _BEYOND_M, xmax + _BEYOND_M, ymax + _BEYOND_M), _STEP_M, prior.crs
    )
    low, high = np.array(prior.bounds[:2]), np.array(prior.bounds[2:])
    heights = prior.at(np.clip(grid.xy, low + 1e-6, high - 1e-6))
    level = float(np.nanmean(prior.elevation))
    return Dem.on(
        grid, np.where(np.isfinite(heights), heights, level).reshape(grid.shape), prior.vertical_datum
    )


def _promised(covariance: FloatArray, limit_m: float, mission: MissionConfig, route: Route) -> Foreseen:
    n = len(covariance)
    mean, variance = float(np.trace(covariance)) / n, 2.0 * float(np.sum(covariance**2)) / n**2
    chance = float(gammainc(mean**2 / variance, mean * limit_m**2 / variance))
    site_mean = float(np.sqrt(covariance.mean()))
    return Foreseen(
        len(route.swaths), mission.aids.stakes, float(np.sqrt(mean)), site_mean, chance, route.length_m
    )
