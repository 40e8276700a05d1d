"""How many swaths, and how many stakes, would meet a map class: of a mission, or of an area with ``--joint``."""

import json
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from sim.cli.outcome import NOT_MET
from sim.cli.plan_promise import Asked, draw, limit_of, promised, wanted_of
from sim.config.mission import MissionConfig

if TYPE_CHECKING:
    import survey
    from sim.mission.foresight import Foreseen

_MOST_FURTHER = 6


def tell_ways(mission: MissionConfig, require: str, probability: float, *, as_json: bool) -> None:
    """Print the ways to meet the class, the cheapest first said; end with exit code 5 where none does."""
    from sim.mission.foresight import ways_to_meet
    from sim.world.site import build_world

    limit_m = limit_of(require)
    ways = list(ways_to_meet(mission, build_world(mission), limit_m=limit_m, chance=probability))
    best = _best_of(ways, limit_m, probability)
    if as_json:
        typer.echo(json.dumps({"limit_m": limit_m, "ways": [way._asdict() for way in ways]}, indent=2))
        return
    _say(best, ways)


def plan_joint(
    area: "survey.SurveyArea",
    prior: "survey.Dem",
    asked: Asked,
    settings: list[str],
    out: Path,
    *,
    as_json: bool,
) -> None:
    """Write the route with the least to drive that meets the class with the errors that its path shares.

    No fewer swaths are tried than the promise needs without those errors: what is foreseen takes the terrain between
    the cells of the prior for smooth.
    """
    import planners
    from sim.mission.foresight import ways_to_meet
    from sim.world.site import World
    from survey.core.config import validated, with_overrides

    made = promised(area, prior, wanted_of(asked))
    mission = validated(MissionConfig, with_overrides(_stated(asked), settings), "the options")
    mission = mission.model_copy(update={"planner": made.config})
    limit_m, least = made.wanted.limit_m, made.config.swaths or 1
    found = ways_to_meet(
        mission,
        World(prior, prior, area),
        limit_m=limit_m,
        chance=asked.probability,
        least_swaths=least,
        most_swaths=least + _MOST_FURTHER,
    )
    ways = list(found)
    best = _best_of(ways, limit_m, asked.probability, least + _MOST_FURTHER)
    route = planners.plan(area, prior, made.config.model_copy(update={"swaths": best.swaths}))
    route.write(out)
    draw(route, area, prior, out)
    if as_json:
        facts = {"route": str(out), "picture": str(out.with_suffix(".png")), "limit_m": limit_m}
        typer.echo(json.dumps(facts | {"ways": [way._asdict() for way in ways]}, indent=2))
        return
    _say(best, ways)
    typer.echo(f"  assumed: {made.assumptions}; without errors of place {least} swaths would do")
    typer.echo(f"written to {out}, drawn in {out.with_suffix('.png')}")


def _stated(asked: Asked) -> dict[str, object]:
    """Return what the options of the command say as a mission; the terrain is given beside it."""
    return {
        "schema_version": 1,
        "name": "plan",
        "terrain": {"source": "srtm-sample"},
        "planner": {"pattern": "lawnmower", "swaths": 4},
        "satellite": {"sigma_m": asked.prior_sigma_m},
        "reconstruction": {"joint": {"satellite": {"sigma_m": max(asked.prior_sigma_m, 0.01)}}},
    }


def _best_of(ways: list["Foreseen"], limit_m: float, probability: float, most_swaths: int = 8) -> "Foreseen":
    """Return the way with the least to drive; end with exit code 5 where there is none."""
    from sim.mission.foresight import cheapest

    best = cheapest(ways)
    if best is None:
        typer.echo(
            f"firnline: an RMSE of {limit_m:.4g} m is not foreseen with {probability:.0%} by up to {most_swaths} swaths and 4 stakes; "
            "ask for less, or for better sensors.",
            err=True,
        )
        raise typer.Exit(NOT_MET)
    return best


def _say(best: "Foreseen", ways: list["Foreseen"]) -> None:
    typer.echo(f"least to drive: {best}")
    for way in ways:
        if way != best:
            typer.echo(f"            or: {way}")
