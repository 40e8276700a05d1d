"""Numbers of swaths and stakes that meet a map class: for a mission, or for an area with ``--joint``."""

import json
from typing import TYPE_CHECKING

import typer

from firnline.cli.facts import fact_line
from firnline.cli.outcome import NOT_MET
from firnline.cli.planning.guarantee import drawing_of, found_guarantee, prior_of, requirement_of
from firnline.cli.planning.outputs import write_plan
from firnline.cli.planning.request import PlanRequest
from sim.config.mission import MissionConfig

if TYPE_CHECKING:
    from sim.mission.foresight import PredictedSurvey

_MOST_FURTHER = 6
_ROUGHER = (
    "relief that the prior's cells do not show, beyond reconstruction.gp.nugget_m (0.15 m by default); on rough ground it "
    "is the larger error: firnline plan AREA --prior RASTER --require counts it, firnline rehearse tries it"
)


def print_options_of(mission: MissionConfig, limit_m: float, probability: float, *, as_json: bool) -> None:
    """Print the surveys that meet the class, the one with the least to drive first; exit code 5 where none does."""
    from sim.mission.capacity import require_mission
    from sim.mission.foresight import surveys_within

    world = require_mission(mission)
    options = list(surveys_within(mission, world, limit_m=limit_m, probability=probability))
    best = _best_of(options, limit_m, probability)
    if as_json:
        typer.echo(json.dumps({"limit_m": limit_m, "ways": [way._asdict() for way in options]}, indent=2))
        return
    _print_options(best, options)
    typer.echo(fact_line("not included", _ROUGHER))


def plan_joint(request: PlanRequest) -> None:
    """Write the route with the least to drive that meets the class with the errors that its path shares.

    No fewer swaths are tried than the guarantee needs without those errors: the prediction takes the terrain
    between the cells of the prior to be smooth.
    """
    import planners
    from sim.mission.foresight import surveys_within
    from sim.world.site import World
    from survey.core.config import validated, with_overrides

    stated = validated(MissionConfig, with_overrides(_stated(request), request.settings), "the options")
    area, prior = prior_of(request)
    made = found_guarantee(area, prior, requirement_of(request), quiet=request.quiet)
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
    best = _best_of(options, limit_m, request.probability, least + _MOST_FURTHER)
    route = planners.plan(
        area, prior, made.config.model_copy(update={"swaths": best.swaths, "tie_lines": best.tie_lines})
    )
    write_plan(request, route, drawing_of(area, prior))
    if request.as_json:
        facts = {**request.written, "limit_m": limit_m}
        typer.echo(json.dumps(facts | {"ways": [way._asdict() for way in options]}, indent=2))
        return
    _print_options(best, options)
    assumed = f"{made.assumptions}; without errors of position {least} swaths are enough"
    typer.echo(fact_line("assumed", assumed))
    typer.echo(fact_line("written to", request.written_text))


def _stated(request: PlanRequest) -> dict[str, object]:
    """Return what the options of the command say as a mission; the terrain is given beside it."""
    return {
        "schema_version": 1,
        "name": "plan",
        "terrain": {"source": "srtm-sample"},
        "planner": {"pattern": "lawnmower", "swaths": 4},
        "satellite": {"sigma_m": request.prior_sigma_m},
        "reconstruction": {"joint": {"satellite": {"sigma_m": max(request.prior_sigma_m, 0.01)}}},
    }


def _best_of(
    options: list["PredictedSurvey"], limit_m: float, probability: float, most_swaths: int = 8
) -> "PredictedSurvey":
    """Return the survey with the least to drive; end with exit code 5 where there is none."""
    from sim.mission.foresight import cheapest

    best = cheapest(options)
    if best is None:
        typer.echo(
            f"firnline: no survey of up to {most_swaths} swaths and 4 stakes is predicted to reach an RMSE of {limit_m:.4g} m "
            f"with {probability:.0%}; ask for a larger error, or for better sensors.",
            err=True,
        )
        raise typer.Exit(NOT_MET)
    return best


def _print_options(best: "PredictedSurvey", options: list["PredictedSurvey"]) -> None:
    typer.echo(f"least to drive: {best}")
    for way in options:
        if way != best:
            typer.echo(fact_line("or", way))
