"""``firnline plan MISSION.toml --require``: how many swaths, and how many stakes, would meet a map class."""

import json

import typer

from sim.cli.outcome import NOT_MET
from sim.cli.plan_promise import limit_of
from sim.config import MissionConfig


def tell_ways(mission: MissionConfig, require: str, probability: float, *, as_json: bool) -> None:
    """Print the ways to meet the class, the cheapest first said; end with exit code 5 where none does."""
    from sim.foresight import cheapest, ways_to_meet
    from sim.world import build_world

    limit_m = limit_of(require)
    ways = list(ways_to_meet(mission, build_world(mission), limit_m=limit_m, chance=probability))
    best = cheapest(ways)
    if best is None:
        typer.echo(
            f"firnline: an RMSE of {limit_m:.4g} m is not foreseen with {probability:.0%} by up to 8 swaths and 4 stakes; "
            "ask for less, or for better sensors.",
            err=True,
        )
        raise typer.Exit(NOT_MET)
    if as_json:
        typer.echo(json.dumps({"limit_m": limit_m, "ways": [way._asdict() for way in ways]}, indent=2))
        return
    typer.echo(f"least to drive: {best}")
    for way in ways:
        if way != best:
            typer.echo(f"            or: {way}")
