"""``firnline plan AREA``: a route as the options ask for it, with its picture."""

import json
from typing import TYPE_CHECKING, Any

import typer

from sim.cli.planning.drawing import PlanDrawing
from sim.cli.planning.outputs import fact_lines, plan_facts, write_plan
from sim.cli.planning.request import PlanRequest

if TYPE_CHECKING:
    import planners
    import survey
    from survey.reconstruction.gp.covariance.kernels import Kernel

_DEFAULT_SWATHS = 4
_NOISE_M = 0.1


def plan_area(request: PlanRequest) -> None:
    """Plan a route of a named pattern, write it with its picture, and print what is expected of it."""
    import planners
    from planners.driving.rover import Crew, homes_of
    from sim.cli.progress import counted

    config = checked_options(request)
    area, dem = request.read_area()
    homes_of(area, Crew(config.rover, config.fleet))
    with counted(quiet=request.quiet) as progress:
        progress("fitting the terrain's covariance", 0, 1)
        kernel = None if dem is None else _kernel(dem, area)
        progress("fitting the terrain's covariance", 1, 1)
        route = planners.plan(
            area,
            dem,
            config.planner,
            rover=config.rover,
            fleet=config.fleet,
            kernel=kernel,
            progress=progress,
        )
    left_out = planners.drivable(area, config.rover, dem).left_out
    write_plan(request, route, _drawing(route, area, dem, kernel, config.rover, left_out))
    _print_route(request, route)


def checked_options(request: PlanRequest) -> Any:
    """Return the sections planner, rover and fleet as the options ask for them.

    Raises
    ------
    ConfigError
        A setting that is unknown or wrong.
    """
    import planners
    from survey.core.config import Section, validated, with_overrides

    class Wanted(Section):
        planner: planners.PlannerConfig
        rover: planners.Rover = planners.Rover()
        fleet: planners.Fleet = planners.Fleet()

    return validated(Wanted, with_overrides(_sections(request), request.settings), "the options")


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
    import planners
    from planners.prediction.prior_cover import covered_share
    from survey.core.errors import InputError

    if covered_share(area, dem) == 0.0:
        return None  # the plan refuses it
    try:
        return planners.terrain_kernel(dem, area)
    except InputError as error:
        typer.echo(f"firnline: no error is predicted: {error}", err=True)
        return None


def _drawing(
    route: "survey.Route",
    area: "survey.SurveyArea",
    dem: "survey.Dem | None",
    kernel: "Kernel | None",
    rover: "planners.Rover",
    left_out: "tuple[planners.LeftOut, ...]",
) -> PlanDrawing:
    """Return what is drawn, with the predicted error of the map where the plan states one."""
    if kernel is None or "rmse_m" not in route.prediction:
        return PlanDrawing(area, dem, rover=rover, left_out=left_out)
    from survey.reconstruction.gp.covariance.kernels import KINDS

    family = next((name for name, kind in KINDS.items() if type(kernel) is kind), str(kernel))
    sentence = (
        f"Predicted error: terrain with the covariance that the prior makes likeliest ({family}), samples with "
        f"noise of {_NOISE_M:g} m; errors of the rover's position are not included."
    )
    return PlanDrawing(area, dem, kernel, _NOISE_M, rover, left_out, (sentence,))


def _print_route(request: PlanRequest, route: "survey.Route") -> None:
    """Print what is expected of the route, for people or as JSON."""
    from planners.swaths.counting import swaths_text

    if request.as_json:
        typer.echo(json.dumps(plan_facts(request, route), indent=2))
        return
    typer.echo(f"{swaths_text(route)}, written to {request.written_text}")
    for line in fact_lines(route.prediction):
        typer.echo(line)
