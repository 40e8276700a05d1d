"""Plans for a map class with the errors that a path shares: of a mission, or of an area with the sensors of one."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import planners
from firnline.actions.guaranteeing import found_guarantee, limit_of, prior_of, requirement_of
from firnline.actions.interface import NotMetError, Progress, Result, fact_line, no_progress
from firnline.actions.plan_request import PlanDrawing, PlanRequest, PlanResult

if TYPE_CHECKING:
    from sim.config.mission import MissionConfig
    from sim.mission.foresight import PredictedSurvey


_MOST_FURTHER = 6
_ROUGHER = (
    "relief that the prior's cells do not show, beyond reconstruction.gp.nugget_m (0.15 m by default); on rough ground it "
    "is the larger error: firnline plan AREA --prior RASTER --require counts it, firnline rehearse tries it"
)


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
        return [*self.survey_lines(), fact_line("not included", _ROUGHER)]


def survey_options(mission: "MissionConfig", limit_m: float, probability: float) -> SurveyOptions:
    """Return the surveys with which the map of a mission meets a class."""
    from sim.mission.capacity import require_mission
    from sim.mission.foresight import surveys_within

    world = require_mission(mission)
    options = list(surveys_within(mission, world, limit_m=limit_m, probability=probability))
    return SurveyOptions(_cheapest_of(options, limit_m, probability), options, limit_m)


def plan_mission_swaths(request: PlanRequest, progress: Progress = no_progress) -> SurveyOptions:
    """Return the numbers of swaths and stakes with which a mission's map meets the class."""
    from sim.mission.runs import read_mission

    del progress
    mission = read_mission(request.source, request.settings)
    return survey_options(mission, limit_of(str(request.require)), request.probability)


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

    No fewer swaths are tried than the guarantee needs without those errors: the prediction takes the terrain
    between the cells of the prior to be smooth.
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
    found = surveys_within(
        mission,
        World(prior, prior, area),
        limit_m=limit_m,
        probability=request.probability,
        least_swaths=least,
        most_swaths=least + _MOST_FURTHER,
    )
    options = list(found)
    best = _cheapest_of(options, limit_m, request.probability, least + _MOST_FURTHER)
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
    options: list["PredictedSurvey"], limit_m: float, probability: float, most_swaths: int = 8
) -> "PredictedSurvey":
    """Return the survey with the least to drive; refuse where there is none."""
    from sim.mission.foresight import cheapest

    best = cheapest(options)
    if best is None:
        raise NotMetError(
            f"no survey of up to {most_swaths} swaths and 4 stakes is predicted to reach an RMSE of {limit_m:.4g} m "
            f"with {probability:.0%}; ask for a larger error, or for better sensors."
        )
    return best
