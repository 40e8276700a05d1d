"""Plans for a map class with the errors that a path shares: of a mission, or of an area with the sensors of one."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import planners
from firnline.actions.guaranteeing import found_guarantee, limit_of, prior_of, requirement_of
from firnline.actions.interface import NotMetError, Progress, Result, fact_line, no_progress
from firnline.actions.plan_request import PlanDrawing, PlanRequest, PlanResult
from survey.core import CapacityError, length_text

if TYPE_CHECKING:
    from sim.config.mission import MissionConfig
    from sim.mission.drive_prediction import PredictedSurvey


_MOST_FURTHER = 6
# A drive of this length takes some 100 s and 1.5 GB to localize.
_MOST_JOINT_M = 150_000.0
_NOT_PREDICTED = "times without vision, slip and wrong matches (firnline rehearse tries them)"


@dataclass(frozen=True)
class SurveyOptions(Result):
    """Surveys that meet a class, by numbers of swaths and stakes.

    `best`: the one with the least to drive. `options`: all that meet it. `limit_m`: largest RMSE [m].
    """

    best: "PredictedSurvey"
    options: list["PredictedSurvey"]
    limit_m: float

    def facts(self) -> dict[str, Any]:
        """Return the limit and the surveys."""
        return {"limit_m": self.limit_m, "ways": [way._asdict() for way in self.options]}

    def survey_lines(self) -> list[str]:
        """Return the surveys, the one with the least to drive first."""
        others = [fact_line("or", way) for way in self.options if way != self.best]
        return [f"least to drive: {self.best}", *others]

    def lines(self) -> list[str]:
        """Return the surveys, and what their prediction does not include."""
        return [*self.survey_lines(), fact_line("not included", _NOT_PREDICTED)]


def survey_options(
    mission: "MissionConfig", limit_m: float, probability: float, progress: Progress = no_progress
) -> SurveyOptions:
    """Return the surveys with which the map of a mission meets a class."""
    from sim.mission.capacity import require_mission
    from sim.mission.foresight import surveys_within

    progress("building the site", 0, 1)
    world = require_mission(mission)
    tried: list[PredictedSurvey] = []
    found = surveys_within(
        mission, world, limit_m=limit_m, probability=probability, progress=progress, tried=tried
    )
    options = list(found)
    return SurveyOptions(_cheapest_of(options, tried, limit_m, probability), options, limit_m)


def plan_mission_swaths(request: PlanRequest, progress: Progress = no_progress) -> SurveyOptions:
    """Return the numbers of swaths and stakes with which a mission's map meets the class."""
    from sim.mission.runs import read_mission

    mission = read_mission(request.source, request.settings)
    return survey_options(mission, limit_of(str(request.require)), request.probability, progress)


@dataclass(frozen=True, kw_only=True)
class JointPlan(PlanResult):
    """Route with the least to drive that meets a class with the errors that its path shares.

    `surveys`: surveys that meet the class. `assumed`: what the guarantee assumes.
    """

    surveys: SurveyOptions
    assumed: str

    def facts(self) -> dict[str, Any]:
        """Return files, limit and surveys."""
        return {**self.request.written, **self.surveys.facts()}

    def lines(self) -> list[str]:
        """Return the surveys, and what they rest on."""
        return [
            *self.surveys.survey_lines(),
            fact_line("assumed", self.assumed),
            fact_line("written to", self.request.written_text),
        ]


def plan_joint(request: PlanRequest, progress: Progress = no_progress) -> JointPlan:
    """Plan the route with the least to drive that meets the class with the errors that its path shares.

    No fewer swaths are tried than the guarantee needs without those errors, which simulated surveys have shown.
    """
    from sim.config.mission import MissionConfig
    from sim.mission.foresight import surveys_within
    from sim.world.site import World
    from survey.core import validated, with_overrides

    stated = validated(
        MissionConfig, with_overrides(_mission_values(request), request.settings), "the options"
    )
    area, prior = prior_of(request)
    made = found_guarantee(area, prior, requirement_of(request), progress)
    mission = stated.model_copy(update={"planner": made.config})
    limit_m, least = made.requirement.limit_m, made.config.swaths or 1
    if made.length_m > _MOST_JOINT_M:
        raise CapacityError(
            f"--joint was asked for {length_text(made.length_m)} to drive, and {length_text(_MOST_JOINT_M)} are the most; take "
            "a part of the area (--below, --select), a larger error, or leave --joint out."
        )
    tried: list[PredictedSurvey] = []
    found = surveys_within(
        mission,
        World(prior, prior, area),
        limit_m=limit_m,
        probability=request.probability,
        least_swaths=least,
        most_swaths=least + _MOST_FURTHER,
        model=planners.prior_model(prior, area, request.assumptions),
        progress=progress,
        tried=tried,
    )
    options = list(found)
    best = _cheapest_of(options, tried, limit_m, request.probability)
    config = made.config.model_copy(update={"swaths": best.swaths, "tie_lines": best.tie_lines})
    return JointPlan(
        request=request,
        route=planners.plan(area, prior, config),
        drawing=PlanDrawing(area, prior),
        surveys=SurveyOptions(best, options, limit_m),
        assumed=f"{made.assumptions}; without errors of position {least} swaths are enough",
    )


def _mission_values(request: PlanRequest) -> dict[str, object]:
    """Return what the options of the command say as a mission; the terrain is given beside it."""
    return {
        "schema_version": 1,
        "name": "plan",
        "terrain": {"source": "srtm-sample"},
        "planner": {"pattern": "lawnmower", "swaths": 4},
        "satellite": {"sigma_m": request.prior_sigma_m},
        "reconstruction": {"joint": {"satellite": {"sigma_m": max(request.prior_sigma_m, 0.01)}}},
    }


def _cheapest_of(
    options: "list[PredictedSurvey]", tried: "list[PredictedSurvey]", limit_m: float, probability: float
) -> "PredictedSurvey":
    """Return the survey with the least to drive; refuse where there is none, with the best of those tried."""
    from sim.mission.foresight import cheapest

    best = cheapest(options)
    if best is None:
        reached = max(tried, key=lambda one: one.chance, default=None)
        nearest = (
            ""
            if reached is None
            else f"; the best of them is {reached}, of which the level is {reached.site_mean_m:.2f} m"
        )
        most = max((one.swaths for one in tried), default=0)
        raise NotMetError(
            f"no survey of up to {most} swaths and 4 stakes is predicted to reach an RMSE of {limit_m:.4g} m "
            f"with {probability:.0%}{nearest}; ask for a larger error, or for better sensors."
        )
    return best
