"""``firnline plan AREA``: a route as the options ask for it, with its picture."""

import json
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import typer

from firnline.cli.facts import fact_line
from firnline.cli.planning.drawing import PlanDrawing
from firnline.cli.planning.outputs import fact_lines, plan_facts, write_plan
from firnline.cli.planning.request import PlanRequest

if TYPE_CHECKING:
    import planners
    import survey
    from planners.routes.traversability import LeftOut
    from survey.core.arrays import Progress
    from survey.reconstruction.gp.kernels import Kernel

_DEFAULT_SWATHS = 4
_NOISE_M = 0.1
_NOT_INCLUDED = "relief finer than the prior's cells and errors of the rover's position"


@dataclass(frozen=True)
class AreaPlan:
    """Route of an area with what it was planned from; `kernel` is the covariance of the terrain, if one is known."""

    area: "survey.SurveyArea"
    prior: "survey.Dem | None"
    rover: "planners.Rover"
    kernel: "Kernel | None"
    route: "survey.Route"
    left_out: "tuple[LeftOut, ...]"

    @property
    def drawing(self) -> PlanDrawing:
        """What is drawn of it, with the predicted error of the map where the plan states one."""
        if self.kernel is None or "rmse_m" not in self.route.prediction:
            return PlanDrawing(self.area, self.prior, rover=self.rover, left_out=self.left_out)
        sentence = _assumption(self.kernel)
        return PlanDrawing(
            self.area, self.prior, self.kernel, _NOISE_M, self.rover, self.left_out, (sentence,)
        )


def plan_area(request: PlanRequest) -> None:
    """Plan a route of a named pattern, write it with its picture, and print what is expected of it."""
    from firnline.cli.progress import counted
    from planners.routes.rover import Crew, homes_of

    config = checked_options(request)
    area, dem = request.read_area()
    homes_of(area, Crew(config.rover, config.fleet))
    with counted(quiet=request.quiet) as progress:
        progress("fitting the terrain's covariance", 0, 1)
        kernel = None if dem is None else _kernel(dem, area)
        progress("fitting the terrain's covariance", 1, 1)
        made = area_plan(config, area, dem, kernel, progress)
    write_plan(request, made.route, made.drawing)
    _print_route(request, made.route)


def area_plan(
    config: Any,
    area: "survey.SurveyArea",
    prior: "survey.Dem | None",
    kernel: "Kernel | None",
    progress: "Progress | None" = None,
) -> AreaPlan:
    """Plan a route with the sections that `checked_options` returns."""
    import planners
    from planners.routes.traversability import drivable

    route = planners.plan(
        area,
        prior,
        config.planner,
        rover=config.rover,
        fleet=config.fleet,
        kernel=kernel,
        progress=progress,
    )
    left_out = drivable(area, config.rover, prior).left_out
    return AreaPlan(area, prior, config.rover, kernel, route, left_out)


def checked_options(request: PlanRequest) -> Any:
    """Return the sections planner, rover and fleet as the options ask for them."""
    from survey.core.config import validated, with_overrides

    return validated(_sections_model(), with_overrides(_sections(request), request.settings), "the options")


@cache
def _sections_model() -> Any:
    """Return the class of the sections that an area is planned with; made once, which takes a while."""
    import planners
    from planners.registry import PlannerConfig
    from survey.core.config import Section

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
    if request.max_slope is not None:
        sections["rover"] = {"max_pitch_deg": request.max_slope, "max_roll_deg": request.max_slope}
    return sections


def _kernel(dem: "survey.Dem", area: "survey.SurveyArea") -> "Kernel | None":
    """Return the likeliest covariance of the prior; None, with the reason on stderr, where it is too coarse."""
    from survey import InputError

    try:
        return prior_kernel(dem, area)
    except InputError as error:
        typer.echo(f"firnline: no error is predicted: {error}", err=True)
        return None


def prior_kernel(dem: "survey.Dem", area: "survey.SurveyArea") -> "Kernel | None":
    """Return the likeliest covariance of the prior; None where it lies off the area, which the plan refuses."""
    import planners
    from planners.planning import prior_covered_share

    return None if prior_covered_share(area, dem) == 0.0 else planners.terrain_kernel(dem, area)


def _assumption(kernel: "Kernel") -> str:
    """Return in a sentence what the predicted error rests on."""
    from survey.reconstruction.gp.kernels import KINDS

    family = next((name for name, kind in KINDS.items() if type(kernel) is kind), str(kernel))
    return (
        f"Predicted error: terrain with the covariance that the prior makes likeliest ({family}), samples with "
        f"noise of {_NOISE_M:g} m; {_NOT_INCLUDED} are not included."
    )


def _print_route(request: PlanRequest, route: "survey.Route") -> None:
    """Print what is expected of the route, for people or as JSON."""
    from planners.swaths.reference_lines import swaths_text

    if request.as_json:
        typer.echo(json.dumps(plan_facts(request, route), indent=2))
        return
    typer.echo(f"{swaths_text(route)}, written to {request.written_text}")
    for line in fact_lines(route.prediction):
        typer.echo(line)
    if "rmse_m" in route.prediction:
        remedy = "--require counts the first, --require with --joint the second"
        typer.echo(fact_line("RMSE excludes", f"{_NOT_INCLUDED} ({remedy})"))
