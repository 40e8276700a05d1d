"""Numbers of swaths and stakes with which the map of a mission is predicted to meet a limit, and the LiDAR that a plan assumes."""

from collections.abc import Callable, Iterable, Iterator
from functools import cache
from itertools import product

import planners
from planners.guarantee.survey_lines import smallest_sufficient
from planners.planning import require_cover
from planners.prediction.error_model import ErrorModel
from planners.swaths.lidar_spacing import LidarSurvey
from sim.config.mission import MissionConfig
from sim.instruments.lidar import scanner_of
from sim.mission.drive_prediction import PredictedSurvey, error_model_of, planned_mission, predict_survey
from sim.world.site import World
from survey import ConfigError
from survey.core import Progress

# Patterns whose number of swaths can be varied, with everything else fixed before the drive.
_SIZED = (planners.LawnmowerConfig, planners.WavyConfig)
# Where the search for a number of swaths begins, and how many it tries for each number of stakes, about.
_FIRST_TRIED, _TRIED_EACH = 4, 3


def surveys_within(
    mission: MissionConfig,
    world: World,
    *,
    limit_m: float,
    probability: float = 0.9,
    least_swaths: int = 2,
    most_swaths: int = 8,
    model: ErrorModel | None = None,
    progress: Progress | None = None,
    tried: list[PredictedSurvey] | None = None,
) -> Iterator[PredictedSurvey]:
    """Yield, for 0, 2 and 4 stakes, the fewest swaths that meet the limit with a probability, if any do.

    On moving ice the limit is that of the map at its epoch, and each is tried with two lines that cross the swaths, too, and
    with every second swath driven first: ground that is seen at different times shows the motion.

    `limit_m`: largest RMSE [m]. `model`: as of `predict_survey`. `tried`: list that all predictions are added to.
    """
    if type(mission.planner) not in _SIZED:
        names = " and ".join(kind.model_fields["pattern"].default for kind in _SIZED)
        raise ConfigError(
            f"numbers of swaths and stakes are compared for the patterns {names}, not {mission.planner.pattern}; take one of them."
        )
    require_cover(world.area, world.prior)
    counts = range(least_swaths, most_swaths + 1)
    first = min(max(least_swaths, _FIRST_TRIED), most_swaths)
    choices = list(product((0, 2, 4), _ways(mission, world)))
    found_model, made = model or error_model_of(mission, world), [] if tried is None else tried

    def predict(one: MissionConfig) -> PredictedSurvey:
        if progress is not None:
            progress("predicting surveys", len(made), max(_TRIED_EACH * len(choices), len(made) + 1))
        made.append(predict_survey(one, world, limit_m=limit_m, model=found_model))
        return made[-1]

    for stakes, way in choices:
        aids = mission.aids.model_copy(update={"stakes": stakes})
        staked = way.model_copy(update={"aids": aids})
        found = _fewest_swaths(staked, predict, probability, counts=counts, first=first)
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
        planned_mission(ways[-1], world)
    except ConfigError:
        return ways[:-1]
    return ways


def _fewest_swaths(
    mission: MissionConfig,
    predict: Callable[[MissionConfig], PredictedSurvey],
    probability: float,
    *,
    counts: range,
    first: int,
) -> tuple[int, PredictedSurvey] | None:
    """Return the smallest number of swaths that is predicted to be enough, sought from `first` on."""

    @cache
    def predicted(swaths: int) -> PredictedSurvey:
        sized = mission.planner.model_copy(update={"swaths": swaths, "spacing_m": None})
        return predict(mission.model_copy(update={"planner": sized}))

    nth = smallest_sufficient(
        lambda n: predicted(counts[n - 1]).chance >= probability,
        first=counts.index(first) + 1,
        most=len(counts),
    )
    return None if nth is None else (counts[nth - 1], predicted(counts[nth - 1]))


def cheapest(surveys: Iterable[PredictedSurvey]) -> PredictedSurvey | None:
    """Return the survey with the least to drive, and of those the one with the fewest stakes."""
    return min(surveys, key=lambda one: (round(one.length_m), one.stakes), default=None)


def lidar_survey(mission: MissionConfig) -> LidarSurvey:
    """Return what a plan assumes of a mission's LiDAR; refuse a mission that has none."""
    config, limits = mission.sensors.lidar, mission.reconstruction.scans
    if config.beams == 0:
        raise ConfigError(
            f"the mission {mission.name} has no LiDAR; set its number of beams (--set sensors.lidar.beams=32)."
        )
    return LidarSurvey(
        scanner=scanner_of(config),
        scan_step_m=mission.rover.speed_m_s / config.rate_hz,
        nearest_m=limits.nearest_m,
        farthest_m=min(limits.farthest_m, config.range_m),
        reach_m=config.reach_m,
        mounting_sigma_deg=config.mounting_sigma_deg,
        node_step_m=mission.reconstruction.grid_step_m,
    )
