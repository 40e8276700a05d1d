"""Plan the route of a survey: of an area, of a mission, for a required class, or for a season."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import planners
import survey
from firnline.actions.guaranteeing import (
    plan_adaptive,
    plan_guaranteed,
    plan_lidar,
)
from firnline.actions.interface import Preview, Progress, Result, fact_line, no_progress, previewed_by
from firnline.actions.joint_planning import plan_joint, plan_mission_swaths
from firnline.actions.plan_request import PlanDrawing, PlanRequest, PlanResult, with_remarks
from firnline.actions.plan_texts import fact_texts
from firnline.actions.season import plan_season
from survey.core import ConfigError, InputError, area_text

if TYPE_CHECKING:
    from planners.prediction.error_model import ErrorModel
    from planners.routes.traversability import LeftOut


_DEFAULT_SWATHS = 4
_NOT_INCLUDED = "errors of position that grow along the path (--require with --joint predicts them)"


@dataclass(frozen=True)
class AreaPlan:
    """Route of an area with what it was planned from; `model` predicts the error of its map, if it can be predicted."""

    area: "survey.SurveyArea"
    prior: "survey.Dem | None"
    rover: "planners.Rover"
    model: "ErrorModel | None"
    route: "survey.Route"
    left_out: "tuple[LeftOut, ...]"

    @property
    def drawing(self) -> PlanDrawing:
        """What is drawn of it, with the predicted error of the map where the plan states one."""
        if self.model is None or "rmse_m" not in self.route.prediction:
            return PlanDrawing(self.area, self.prior, rover=self.rover, left_out=self.left_out)
        sentence = _assumption(self.model)
        return PlanDrawing(self.area, self.prior, self.model, self.rover, self.left_out, (sentence,))


@dataclass(frozen=True, kw_only=True)
class AreaPlanResult(PlanResult):
    """Route of an area as the options ask for it.

    `no_error_because`: why no error of the map is predicted; empty where it is, or where there is no prior.
    """

    route: "survey.Route"
    no_error_because: str = ""

    @property
    def notes(self) -> list[str]:
        """Why no error is predicted."""
        return [f"no error is predicted: {self.no_error_because}"] if self.no_error_because else []

    def facts(self) -> dict[str, Any]:
        """Return files, counts and predictions."""
        counts = {"lines": self.route.n_lines, "swaths": len(self.route.swaths)}
        work = self.request.field_work(self.route)
        cost = {} if work is None else {"field_work": work._asdict()}
        return self.request.written | counts | dict(self.route.prediction) | cost

    def lines(self) -> list[str]:
        """Return what is expected of the route."""
        from planners.swaths.reference_lines import swaths_text

        lines = [
            f"{swaths_text(self.route)}, written to {self.request.written_text}",
            *(fact_line(title, text) for title, text in fact_texts(self.route.prediction).values()),
        ]
        work = self.request.field_work(self.route)
        if work is not None:
            lines.append(fact_line("field work", work))
        if "rmse_m" in self.route.prediction:
            lines.append(fact_line("RMSE excludes", _NOT_INCLUDED))
        return lines


def plan_area(request: PlanRequest, progress: Progress = no_progress) -> AreaPlanResult:
    """Plan a route of a named pattern."""
    from planners.routes.rover import Crew, homes_of

    config = checked_options(request)
    area, dem = request.read_area()
    homes_of(area, Crew(config.rover, config.fleet))
    progress("fitting the terrain's covariance", 0, 1)
    model, refusal = (None, "") if dem is None else _model(dem, area, request.assumptions)
    progress("fitting the terrain's covariance", 1, 1)
    made = area_plan(config, area, dem, model, progress)
    return AreaPlanResult(request=request, route=made.route, drawing=made.drawing, no_error_because=refusal)


def area_plan(
    config: Any,
    area: "survey.SurveyArea",
    prior: "survey.Dem | None",
    model: "ErrorModel | None",
    progress: Progress | None = None,
) -> AreaPlan:
    """Plan a route with the sections that `checked_options` returns."""
    from planners.routes.traversability import drivable

    route = planners.plan(
        area, prior, config.planner, rover=config.rover, fleet=config.fleet, model=model, progress=progress
    )
    left_out = drivable(area, config.rover, prior).left_out
    return AreaPlan(area, prior, config.rover, model, route, left_out)


def checked_options(request: PlanRequest) -> Any:
    """Return the sections planner, rover and fleet as the options ask for them."""
    from survey.core import validated, with_overrides

    return validated(_sections_model(), with_overrides(_sections(request), request.settings), "the options")


@cache
def _sections_model() -> Any:
    """Return the class of the sections that an area is planned with; made once, which takes a while."""
    from planners.registry import PlannerConfig
    from survey.core import Section

    class Wanted(Section):
        planner: PlannerConfig
        rover: planners.Rover = planners.Rover()
        fleet: planners.Fleet = planners.Fleet()

    return Wanted


def _default_size(pattern: str) -> dict[str, int]:
    """Return the size of a pattern for which none is given; empty for a pattern that has no number of swaths."""
    from planners.registry import PLANNERS

    sized = {planner.name for planner in PLANNERS if "swaths" in planner.config.model_fields}
    return {"swaths": _DEFAULT_SWATHS} if pattern in sized else {}


def _sections(request: PlanRequest) -> dict[str, Any]:
    """Return the options as sections of a mission."""
    sizes = {
        "swaths": request.swaths,
        "spacing_m": request.spacing,
        "budget_m": request.budget,
        "rmse_m": request.rmse,
    }
    given = {name: value for name, value in sizes.items() if value is not None}
    name = request.pattern or "lawnmower"
    sections: dict[str, Any] = {"planner": {"pattern": name} | (given or _default_size(name))}
    if request.rovers is not None:
        sections["fleet"] = {"rovers": request.rovers}
    limits = {
        "max_pitch_deg": request.max_slope,
        "max_roll_deg": request.max_slope,
        "slope_product": request.product,
    }
    sections["rover"] = {name: value for name, value in limits.items() if value is not None}
    return sections


def _model(
    dem: "survey.Dem", area: "survey.SurveyArea", assumed: "planners.MapAssumptions"
) -> "tuple[ErrorModel | None, str]":
    """Return the predictor of errors; None, with the reason, where the prior is too coarse."""
    try:
        return planners.prior_model(dem, area, assumed), ""
    except InputError as error:
        return None, str(error)


def _assumption(model: "ErrorModel") -> str:
    """Return in a sentence what the predicted error rests on."""
    families = " or ".join(one.cell.family for one in model.posterior.kernels)
    return (
        f"Predicted error: map of the samples and of the prior; terrain as rough as the prior makes likely ({families}), "
        f"samples with noise of {model.errors.noise_m:g} m and {model.errors.shared_m:g} m that they share; without {_NOT_INCLUDED}."
    )


_OF_A_MISSION = (
    "swaths", "spacing", "budget", "rmse", "prior", "crs", "no_go", "rovers", "max_slope", "product", "pattern",
)  # fmt: skip
_OF_AN_AREA = (
    "joint",
    "lidar",
    "adaptive",
    "driven",
    "measured",
    "assume",
    "force",
    "no_pictures",
    "pictures",
    "rates",
    "season",
    "dates",
    "select",
    "above",
    "below",
)
_DECIDED = ("pattern", "swaths", "spacing", "budget", "rmse", "rovers", "max_slope", "product")


def preview_plan(request: PlanRequest) -> Preview:
    """Read and check the inputs of a plan, and return what would be planned and written."""
    mode_of(request)
    return Preview.of(request.files.values(), _facts(request))


@previewed_by(preview_plan)
def plan(request: PlanRequest, progress: Progress = no_progress) -> Result:
    """Plan the route of a survey, or find the surveys with which the map of a mission meets a class.

    Parameters
    ----------
    request : PlanRequest
        Area or mission file, options and output. A mission file needs ``require``; its route is planned by
        `firnline.actions.missions.run_until`.
    progress : callable
        Called with what is done, how many are done, and how many there are.

    Returns
    -------
    PlanResult or SurveyOptions
        The plan; `PlanResult.write` writes its files.

    Raises
    ------
    NotMetError
        The class or error that is required cannot be reached.
    ConfigError
        Options that contradict one another.
    InputError
        Input that cannot be used, or an output that exists.
    """
    return with_remarks(lambda: mode_of(request)(request, progress))


def check_mission_plan(request: PlanRequest) -> None:
    """Refuse options that a mission file decides."""
    stated = request.given(*_OF_A_MISSION)
    if stated:
        raise ConfigError(
            f"{request.source} is a mission file, which sets {', '.join(stated)} itself; change it with --set, "
            "as in --set planner.swaths=6."
        )
    foreign = request.given(*_OF_AN_AREA)
    if foreign:
        raise ConfigError(
            f"{', '.join(foreign)} goes with an area, but {request.source} is a mission file; leave it out."
        )


def mode_of(request: PlanRequest) -> Callable[[PlanRequest, Progress], Result]:
    """Return the function that carries out a request."""
    if request.require is not None:
        from planners.guarantee.requirement import require_probability

        require_probability(request.probability)
    if request.is_mission:
        check_mission_plan(request)
        return plan_mission_swaths
    mode = _mode_of_area(request)
    request.check_outputs()
    return mode


def _mode_of_area(request: PlanRequest) -> Callable[[PlanRequest, Progress], PlanResult]:
    """Return the function for an area."""
    if request.given("season", "dates"):
        return _season_mode(request)
    if request.require is not None:
        return _guarantee_mode(request)
    stated = request.given("joint", "lidar", "adaptive", "driven", "measured", "assume")
    if stated:
        raise ConfigError(
            f"{', '.join(stated)} goes with --require; give the class or error that is required."
        )
    return plan_area


def _season_mode(request: PlanRequest) -> Callable[[PlanRequest, Progress], PlanResult]:
    """Return the function for a season; options that contradict it are refused."""
    if request.season is None or request.dates is None:
        raise ConfigError(
            "--season and --dates belong together: the wanted error, and the days of both surveys."
        )
    stated = request.given(*_DECIDED, "require", "joint", "lidar", "adaptive", "assume", "settings", "rates")
    if stated:
        raise ConfigError(f"--season chooses swaths, stakes and days itself; leave out {', '.join(stated)}.")
    if request.out.suffix.lower() not in (".geojson", ".gpkg"):
        raise ConfigError(f"--season writes a route (.geojson, .gpkg), not {request.out}; choose another -o.")
    return plan_season


def _guarantee_mode(request: PlanRequest) -> Callable[[PlanRequest, Progress], PlanResult]:
    """Return the function for a required class; options that contradict it are refused."""
    stated = [
        name
        for name in request.given(*_DECIDED, "rates")
        if name != "--pattern" or request.pattern != "lawnmower"
    ]
    if request.settings and not (request.joint or request.lidar):
        stated.append("--set (which goes with --joint and --lidar)")
    if stated:
        raise ConfigError(
            f"--require chooses pattern, swaths and spacing itself, for one rover; leave out {', '.join(stated)}."
        )
    if request.joint and request.adaptive:
        raise ConfigError("--joint predicts a complete survey beforehand; leave out --adaptive.")
    if request.lidar is not None:
        stated = request.given("joint", "adaptive", "max_swaths")
        if stated:
            raise ConfigError(
                f"--lidar chooses the spacing by what the scanner sees; leave out {', '.join(stated)}."
            )
        return plan_lidar
    if request.joint:
        return plan_joint
    return plan_adaptive if request.adaptive else plan_guaranteed


def _facts(request: PlanRequest) -> dict[str, Any]:
    """Return area, pattern and prior of a request."""
    pattern, config = "chosen for the guarantee" if request.season is None else "chosen for the season", None
    if request.require is None and request.season is None:
        config = checked_options(request)
        pattern = f"{config.planner.pattern}, {config.fleet.rovers} rover{'s' * (config.fleet.rovers > 1)}"
    area, prior = request.read_area()
    if config is not None:
        from planners.routes.rover import Crew, homes_of

        homes_of(area, Crew(config.rover, config.fleet))
    facts = {
        "area": f"{request.source}, {area_text(area.ground_area_m2)}, {area.crs.name}",
        "pattern": pattern,
    }
    if prior is not None:
        rows, columns = prior.shape
        facts["prior"] = f"{request.prior}, {rows} × {columns} cells of {prior.step_m:g} m"
    return facts
