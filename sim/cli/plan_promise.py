"""``firnline plan --require``: a route that promises a map class, or a refusal that names what is reachable."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from sim.cli.outcome import NOT_MET

if TYPE_CHECKING:
    import survey
    from planners.promise import Wanted


@dataclass(frozen=True)
class Asked:
    """The options of the command that speak of a promise."""

    require: str
    probability: float
    noise_m: float
    localization_m: float
    prior_sigma_m: float
    driven: Path | None
    measured: Path | None


def limit_of(require: str) -> float:
    """Return the widest limit of a class of the paper's tables [m], or the number of metres that was given."""
    from survey.errors import ConfigError
    from survey.scoring.standards import map_classes

    widest = {row.map_class.lower().replace(" ", "-"): row.limit_m for row in reversed(map_classes())}
    if require in widest:
        return widest[require]
    try:
        return float(require)
    except ValueError as error:
        raise ConfigError(
            f"--require {require} is no map class; take {', '.join(sorted(widest))} or an error in metres."
        ) from error


def plan_promised(
    area: "survey.SurveyArea",
    prior: "survey.Dem | None",
    asked: Asked,
    out: Path,
    *,
    adaptive: bool,
    as_json: bool,
) -> None:
    """Plan what promises the class; end with exit code 5 and one sentence where nothing does."""
    from planners.promise import Wanted
    from survey.errors import InputError

    if prior is None:
        raise InputError("a promise needs to know how the terrain varies; give a coarse DEM with --prior.")
    wanted = Wanted(
        limit_of(asked.require),
        asked.probability,
        noise_m=asked.noise_m,
        localization_m=asked.localization_m,
        prior_sigma_m=asked.prior_sigma_m,
    )
    if adaptive:
        _adaptive(area, prior, asked, wanted, out, as_json=as_json)
    else:
        _beforehand(area, prior, wanted, out, as_json=as_json)


def _beforehand(
    area: "survey.SurveyArea", prior: "survey.Dem", wanted: "Wanted", out: Path, *, as_json: bool
) -> None:
    from planners.promise import promise, reachable_class

    made = promise(area, prior, wanted)
    if not made.holds:
        best = reachable_class(made.reachable_m)
        typer.echo(
            f"firnline: an RMSE of {wanted.limit_m:.4g} m cannot be promised with {wanted.probability:.0%} by up to "
            f"{len(made.route.swaths)} swaths; with that probability they reach {made.reachable_m:.3g} m, "
            f"{'which meets ' + best if best else 'which meets no class'} ({made.assumptions}).",
            err=True,
        )
        raise typer.Exit(NOT_MET)
    made.route.write(out)
    facts = {
        "route": str(out),
        "pattern": made.config.pattern,
        "swaths": len(made.route.swaths),
        "length_m": made.route.length_m,
        "limit_m": wanted.limit_m,
        "probability": made.predicted.probability,
        "rmse_m": made.predicted.rmse_m,
        "simulated_share": made.simulated_share,
        "assumed": made.assumptions,
    }
    _tell(facts, as_json=as_json)


def _adaptive(
    area: "survey.SurveyArea",
    prior: "survey.Dem",
    asked: Asked,
    wanted: "Wanted",
    out: Path,
    *,
    as_json: bool,
) -> None:
    """Plan the first swaths, or the next one after what was driven and measured."""
    from planners.adaptive import AdaptiveConfig, first_swaths, next_swath
    from planners.promise import belief_of
    from survey import Route, SurfacePoints
    from survey.errors import ConfigError

    if (asked.driven is None) != (asked.measured is None):
        raise ConfigError("--driven and --measured belong together: the route so far, and its samples.")
    config = AdaptiveConfig(
        wanted.limit_m, wanted.probability, noise_m=wanted.noise_m, localization_m=wanted.localization_m
    )
    if asked.driven is None or asked.measured is None:
        route = first_swaths(area, belief_of(area, prior, wanted), config)
        route.write(out)
        _tell({"route": str(out), "swaths": len(route.swaths), "length_m": route.length_m}, as_json=as_json)
        return
    points = SurfacePoints.read(asked.measured, crs=str(area.crs))
    advice = next_swath(area, Route.read(asked.driven), points.xy, points.xyz[:, 2], config)
    if not advice.holds:
        typer.echo(
            f"firnline: no further swaths would keep {wanted.limit_m:.4g} m with {wanted.probability:.0%}; "
            f"the densest would err {advice.assured.rmse_m:.3g} m.",
            err=True,
        )
        raise typer.Exit(NOT_MET)
    facts: dict[str, Any] = {"probability": advice.assured.probability, "rmse_m": advice.assured.rmse_m}
    if advice.route is None:
        _tell({"done": "the promise holds, drive no more", **facts}, as_json=as_json)
        return
    advice.route.write(out)
    _tell({"route": str(out), "length_m": advice.route.length_m, **facts}, as_json=as_json)


def _tell(facts: dict[str, Any], *, as_json: bool) -> None:
    if as_json:
        typer.echo(json.dumps(facts, indent=2))
        return
    for name, value in facts.items():
        typer.echo(f"{name} = {value:.6g}" if isinstance(value, float) else f"{name} = {value}")
