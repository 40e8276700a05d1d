"""Prediction of the map error of a mission before it is driven, errors of the rover's position included.

The mission is simulated on the prior: the places of landmarks, and how their errors are shared, follow from the
route and the sensors alone. The covariance of the joint estimate needs no heights; those of the simulated drive
only give the slopes.
"""

from collections.abc import Iterable, Iterator
from functools import cache
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.special import gammainc

import planners
from planners.guarantee.survey_lines import smallest_sufficient
from planners.planning import planned_on, require_cover
from planners.prediction.places import spread_places
from planners.prediction.prior_kernels import covariance_of_cells
from planners.routes.replanning import with_way_home
from planners.routes.rover import Crew
from planners.routes.traversability import drivable
from sim.config.mission import MissionConfig
from sim.mission.localization import localize_recording
from sim.simulate.simulation import simulate_statistical
from sim.world.moving_ice import in_ice_order
from sim.world.site import World
from survey import ConfigError, Dem, Grid, Route, SurfacePoints
from survey.reconstruction.joint.joint_map import JointTerrain

_N_NODES = 400
_BEYOND_M = 60.0
_STEP_M = 5.0
_UNSTATED_SIGMA_M, _UNSTATED_NUGGET_M = 1.0, 0.15
# Patterns whose number of swaths can be varied, with everything else fixed before the drive.
_SIZED = (planners.LawnmowerConfig, planners.WavyConfig)
# Where the search for a number of swaths begins.
_FIRST_TRIED = 4


class PredictedSurvey(NamedTuple):
    """A mission before it is driven.

    ``swaths`` is the number of lines, ``stakes`` that of the stakes, ``rmse_m`` the expected error of the map,
    ``site_mean_m`` the standard deviation of the site's mean height, ``chance`` the probability of meeting the limit,
    ``length_m`` the distance to drive on the ground, ``pieces`` the number of swaths that the lines are cut into,
    ``tie_lines`` the number of lines that cross the swaths, ``order`` that of the swaths (``ice.swath_order``).
    """

    swaths: int
    stakes: int
    rmse_m: float
    site_mean_m: float
    chance: float
    length_m: float
    pieces: int
    tie_lines: int = 0
    order: str = "adjacent"

    def __str__(self) -> str:
        """Return one line with the numbers and the probability."""
        stakes = f" and {self.tie_lines} lines across" if self.tie_lines else ""
        stakes += f" with {self.stakes} stakes" if self.stakes else ""
        stakes += ", every second swath first" if self.order == "alternate" else ""
        lines = (
            f"{self.swaths} swaths"
            if self.pieces == self.swaths
            else f"{self.swaths} lines in {self.pieces} pieces"
        )
        return (
            f"{lines}{stakes}: {self.rmse_m:.2f} m, {100 * self.chance:.0f} %, {self.length_m:.0f} m to drive"
        )


def predict_survey(mission: MissionConfig, world: World, *, limit_m: float) -> PredictedSurvey:
    r"""Predict the error of the map of a mission, with all that its landmarks share.

    With the joint covariance C of M nodes the mean squared error has the mean tr C / M and
    the variance 2 tr C² / M²; the probability of staying within the limit is that of the gamma
    distribution with these moments (Satterthwaite 1946).

    `limit_m`: largest RMSE [m].

    The prediction is as good as the covariance fitted to the prior and the stated sensors. Relief
    finer than the prior's cells counts as 0.15 m, or as ``reconstruction.gp.nugget_m``.
    """
    if mission.fidelity == "ideal":
        raise ConfigError(
            "the ideal fidelity has no errors of position to predict; set fidelity = 'statistical'."
        )
    model, points, route = _model_of(mission, world)
    covariance = model.solve(points, world.area.bounds).terrain.covariance(
        spread_places(world.area, _N_NODES)
    )
    n = len(covariance)
    mean, variance = float(np.trace(covariance)) / n, 2.0 * float(np.sum(covariance**2)) / n**2
    tie_lines = mission.planner.tie_lines if isinstance(mission.planner, _SIZED) else 0
    return PredictedSurvey(
        route.n_lines - tie_lines,
        mission.aids.stakes,
        float(np.sqrt(mean)),
        float(np.sqrt(covariance.mean())),
        float(gammainc(mean**2 / variance, mean * limit_m**2 / variance)),
        route.ground_length_m,
        len(route.swaths) - tie_lines,
        tie_lines,
        "adjacent" if mission.ice is None else mission.ice.swath_order,
    )


def surveys_within(
    mission: MissionConfig,
    world: World,
    *,
    limit_m: float,
    probability: float = 0.9,
    least_swaths: int = 2,
    most_swaths: int = 8,
) -> Iterator[PredictedSurvey]:
    """Yield, for 0, 2 and 4 stakes, the fewest swaths that meet the limit with a probability, if any do.

    On moving ice the limit is that of the map at its epoch, and each is tried with two lines that cross the swaths, too, and
    with every second swath driven first: ground that is seen at different times shows the motion.

    `limit_m`: largest RMSE [m].
    """
    if type(mission.planner) not in _SIZED:
        names = " and ".join(kind.model_fields["pattern"].default for kind in _SIZED)
        raise ConfigError(
            f"numbers of swaths and stakes are compared for the patterns {names}, not {mission.planner.pattern}; take one of them."
        )
    require_cover(world.area, world.prior)
    counts = range(least_swaths, most_swaths + 1)
    first = min(max(least_swaths, _FIRST_TRIED), most_swaths)
    for stakes, way in product((0, 2, 4), _ways(mission, world)):
        aids = mission.aids.model_copy(update={"stakes": stakes})
        staked = way.model_copy(update={"aids": aids})
        found = _fewest_swaths(staked, world, limit_m, probability, counts=counts, first=first)
        if found is not None:
            first, survey = found
            yield survey


def _ways(mission: MissionConfig, world: World) -> list[MissionConfig]:
    """Return the ways to drive that are compared: on moving ice without and with lines across, and every second swath first."""
    if mission.ice is None:
        return [mission]
    ways = []
    for tie_lines, order in ((0, "adjacent"), (2, "adjacent"), (0, "alternate")):
        planner = mission.planner.model_copy(update={"tie_lines": tie_lines})
        ice = mission.ice.model_copy(update={"swath_order": order})
        ways.append(mission.model_copy(update={"planner": planner, "ice": ice}))
    try:
        _planned(ways[-1], world)
    except ConfigError:
        return ways[:-1]
    return ways


def _fewest_swaths(
    mission: MissionConfig, world: World, limit_m: float, probability: float, *, counts: range, first: int
) -> tuple[int, PredictedSurvey] | None:
    """Return the smallest number of swaths that is predicted to be enough, sought from `first` on."""

    @cache
    def predicted(swaths: int) -> PredictedSurvey:
        sized = mission.planner.model_copy(update={"swaths": swaths, "spacing_m": None})
        return predict_survey(mission.model_copy(update={"planner": sized}), world, limit_m=limit_m)

    nth = smallest_sufficient(
        lambda n: predicted(counts[n - 1]).chance >= probability,
        first=counts.index(first) + 1,
        most=len(counts),
    )
    return None if nth is None else (counts[nth - 1], predicted(counts[nth - 1]))


def cheapest(surveys: Iterable[PredictedSurvey]) -> PredictedSurvey | None:
    """Return the survey with the least to drive, and of those the one with the fewest stakes."""
    return min(surveys, key=lambda one: (round(one.length_m), one.stakes), default=None)


def _model_of(mission: MissionConfig, world: World) -> tuple[JointTerrain, SurfacePoints, Route]:
    """Drive the mission over the prior and localize; return the joint model, its landmarks and the route."""
    ground = _read_beyond(world.prior, world.area.bounds)
    route = _planned(mission, world)
    recording, _ = simulate_statistical(ground, route, mission)
    found = localize_recording(recording, mission)
    path, points = found.trajectory, found.points
    if path.error is None:
        raise ConfigError("the mission has no odometry, so that shared errors are not known; add it.")
    joint = mission.reconstruction.joint
    sigma_m = joint.satellite.sigma_m or _UNSTATED_SIGMA_M
    nugget_m = mission.reconstruction.gp.nugget_m
    nugget_m = _UNSTATED_NUGGET_M if nugget_m is None else nugget_m
    config = covariance_of_cells(world.prior, world.area.bounds, sigma_m, nugget_m)
    stated = joint.satellite.model_copy(update={"sigma_m": sigma_m})
    prior = world.prior if mission.reconstruction.use_prior else None
    model = JointTerrain(path.error, prior, config, joint.model_copy(update={"satellite": stated}))
    return model, points, route


def _planned(mission: MissionConfig, world: World) -> Route:
    """Return the route of a mission on ground that can be driven everywhere."""
    route = planned_on(drivable(world.area), world.area, mission.planner, crew=Crew(dem=world.prior))
    route = in_ice_order(route, mission, world)
    return with_way_home(route, world.area) if mission.aids.way_home else route


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
