"""``firnline plan --require --adaptive``: the first swaths of a survey, or the next one after what was measured."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from firnline.cli.facts import fact_line
from firnline.cli.outcome import NOT_MET
from firnline.cli.planning.guarantee import drawing_of, prior_of, requirement_of
from firnline.cli.planning.outputs import write_plan
from firnline.cli.planning.request import PlanRequest
from survey.core.text import length_text

if TYPE_CHECKING:
    import survey
    from planners.guarantee.adaptive import AdaptiveConfig

_TEXTS: dict[str, Callable[[Any], str]] = {
    "length_m": length_text,
    "probability": "{:.0%}".format,
    "rmse_m": "{:.2f} m".format,
}
"""Facts that people read in other units than machines."""


def plan_adaptive(request: PlanRequest) -> None:
    """Plan the first swaths, or the next one after what was driven and measured."""
    from planners.guarantee.adaptive import AdaptiveConfig
    from planners.swaths.heading import across_marked_grain
    from survey.core.errors import ConfigError

    if (request.driven is None) != (request.measured is None):
        raise ConfigError("--driven and --measured belong together: the route so far, and its samples.")
    if request.assume is not None:
        raise ConfigError("--adaptive fits the covariance to the survey; leave out --assume.")
    requirement = requirement_of(request)
    area, prior = prior_of(request)
    config = AdaptiveConfig.of(requirement, across_marked_grain(area.free, prior))
    if request.driven is not None and request.measured is not None:
        _continue(request, request.driven, request.measured, area, prior, config)
    else:
        _begin(request, area, prior, config)


def _begin(
    request: PlanRequest, area: "survey.SurveyArea", prior: "survey.Dem", config: "AdaptiveConfig"
) -> None:
    """Write the first swaths."""
    from planners.guarantee.adaptive import first_swaths
    from planners.guarantee.guarantee import posterior_of

    route = first_swaths(area, posterior_of(area, prior, requirement_of(request)), config)
    write_plan(request, route, drawing_of(area, prior))
    step = "drive and measure them, then run this again with --driven and --measured"
    _print(_files(request, route) | {"swaths": len(route.swaths), "next": step}, request)


def _continue(
    request: PlanRequest,
    driven: Path,
    measured: Path,
    area: "survey.SurveyArea",
    prior: "survey.Dem",
    config: "AdaptiveConfig",
) -> None:
    """Write the next swath, say that none is needed, or end with exit code 5 where none would help."""
    from planners.guarantee.adaptive import next_swath
    from survey import Route, SurfacePoints

    points = SurfacePoints.read(measured, crs=area.crs.to_wkt())
    advice = next_swath(area, Route.read(driven), points.xy, points.xyz[:, 2], config)
    if not advice.holds:
        typer.echo(
            f"firnline: no further swaths would reach {config.limit_m:.4g} m with {config.probability:.0%}; "
            f"the densest survey is predicted to err {advice.predicted.rmse_m:.3g} m.",
            err=True,
        )
        raise typer.Exit(NOT_MET)
    facts = {"probability": advice.predicted.probability, "rmse_m": advice.predicted.rmse_m}
    if advice.route is None:
        _print({"done": "the guarantee holds, no more driving is needed", **facts}, request)
        return
    write_plan(request, advice.route, drawing_of(area, prior))
    _print(_files(request, advice.route) | facts, request)


def _files(request: PlanRequest, route: "survey.Route") -> dict[str, Any]:
    return {**request.written, "length_m": route.ground_length_m}


def _print(facts: dict[str, Any], request: PlanRequest) -> None:
    if request.as_json:
        typer.echo(json.dumps(facts, indent=2))
        return
    for name, value in facts.items():
        text = _TEXTS.get(name, str)(value)
        typer.echo(fact_line(name.removesuffix("_m").replace("rmse", "predicted RMSE"), text))
