"""``firnline plan --require``: a route that promises a map class, or a refusal that names what is reachable."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import typer

from sim.cli.outcome import NOT_MET

if TYPE_CHECKING:
    import survey
    from planners.guarantee.adaptive import AdaptiveConfig
    from planners.guarantee.guarantee import MapRequirement, Promise
    from survey.reconstruction.gp.covariance.kernels import Kernel
    from survey.reconstruction.gp.selection.kernel_search import SearchedFamily


@dataclass(frozen=True)
class Asked:
    """The options of the command that speak of a promise."""

    require: str
    probability: float
    noise_m: float
    localization_m: float
    prior_sigma_m: float
    assume: str | None
    driven: Path | None
    measured: Path | None


def limit_of(require: str) -> float:
    """Return the widest limit of a class of the paper's tables [m], or the number of metres that was given."""
    from survey.core.errors import ConfigError
    from survey.scoring.standards.standards import map_classes

    widest = {row.map_class.lower().replace(" ", "-"): row.limit_m for row in reversed(map_classes())}
    if require in widest:
        return widest[require]
    try:
        return float(require)
    except ValueError as error:
        raise ConfigError(
            f"--require {require} is no map class; take {', '.join(sorted(widest))} or an error in metres."
        ) from error


def wanted_of(asked: Asked) -> "MapRequirement":
    """Return what is to be promised."""
    from planners.guarantee.guarantee import MapRequirement

    return MapRequirement(
        limit_of(asked.require),
        asked.probability,
        noise_m=asked.noise_m,
        localization_m=asked.localization_m,
        prior_sigma_m=asked.prior_sigma_m,
        assumed=cast("SearchedFamily | None", asked.assume),
    )


def plan_promised(
    area: "survey.SurveyArea",
    prior: "survey.Dem",
    asked: Asked,
    out: Path,
    *,
    adaptive: bool,
    as_json: bool,
) -> None:
    """Plan what promises the class; end with exit code 5 and one sentence where nothing does."""
    wanted = wanted_of(asked)
    if adaptive:
        _adaptive(area, prior, asked, wanted, out, as_json=as_json)
    else:
        _beforehand(area, prior, wanted, out, as_json=as_json)


def promised(area: "survey.SurveyArea", prior: "survey.Dem", wanted: "MapRequirement") -> "Promise":
    """Return the promise; end with exit code 5 and one sentence where it does not hold."""
    from planners.guarantee.guarantee import promise, reachable_class

    made = promise(area, prior, wanted)
    if made.holds:
        return made
    best = reachable_class(made.reachable_m)
    typer.echo(
        f"firnline: an RMSE of {wanted.limit_m:.4g} m cannot be promised with {wanted.probability:.0%} by up to "
        f"{len(made.route.swaths)} swaths; with that probability they reach {made.reachable_m:.3g} m, "
        f"{'which meets ' + best if best else 'which meets no class'} ({made.assumptions}).",
        err=True,
    )
    raise typer.Exit(NOT_MET)


def _beforehand(
    area: "survey.SurveyArea", prior: "survey.Dem", wanted: "MapRequirement", out: Path, *, as_json: bool
) -> None:
    made = promised(area, prior, wanted)
    best = made.belief.likeliest
    made.route.write(out)
    draw(made.route, area, prior, out, kernel=best.kernel, noise_m=best.noise_m)
    facts = {
        "route": str(out),
        "picture": str(out.with_suffix(".png")),
        "pattern": made.config.pattern,
        "swaths": len(made.route.swaths),
        "length_m": made.route.length_m,
        "limit_m": wanted.limit_m,
        "probability": made.predicted.probability,
        "rmse_m": made.predicted.rmse_m,
        "likely_rmse_m": made.likely.rmse_m,
        "simulated_share": made.simulated_share,
        "assumed": made.assumptions,
    }
    if as_json:
        typer.echo(json.dumps(facts, indent=2))
        return
    typer.echo(
        f"{len(made.route.swaths)} {made.config.pattern} swaths, {made.route.length_m:.0f} m to drive: an RMSE within "
        f"{wanted.limit_m:.4g} m is promised with {wanted.probability:.0%}."
    )
    typer.echo(f"  assumed: {made.assumptions}")
    typer.echo(
        f"  if the terrain is as rough as that: RMSE {made.predicted.rmse_m:.2f} m, within the limit with "
        f"{made.predicted.probability:.0%} by the covariance, in {made.simulated_share:.0%} of {wanted.n_simulations} "
        "simulated surveys"
    )
    if wanted.assumed is None:
        typer.echo(
            f"  if it is as the prior makes likeliest: RMSE {made.likely.rmse_m:.2f} m, and fewer swaths would do; "
            "--adaptive finds out"
        )
    typer.echo(
        "  not in it: errors that samples share (--joint foresees them), relief unlike that of the cells"
    )
    typer.echo(f"  written to {out}, drawn in {facts['picture']}")


def _adaptive(
    area: "survey.SurveyArea",
    prior: "survey.Dem",
    asked: Asked,
    wanted: "MapRequirement",
    out: Path,
    *,
    as_json: bool,
) -> None:
    """Plan the first swaths, or the next one after what was driven and measured."""
    from planners.ground.transit import FreeGround
    from planners.guarantee.adaptive import AdaptiveConfig, first_swaths
    from planners.guarantee.guarantee import belief_of
    from planners.swaths.heading import across_marked_grain
    from survey.core.errors import ConfigError

    if (asked.driven is None) != (asked.measured is None):
        raise ConfigError("--driven and --measured belong together: the route so far, and its samples.")
    if asked.assume is not None:
        raise ConfigError("--adaptive learns the covariance from the survey; leave out --assume.")
    config = AdaptiveConfig(
        wanted.limit_m,
        wanted.probability,
        noise_m=wanted.noise_m,
        localization_m=wanted.localization_m,
        heading_deg=across_marked_grain(FreeGround(area.free), prior),
    )
    if asked.driven is not None and asked.measured is not None:
        _go_on(area, prior, asked.driven, asked.measured, config, out, as_json=as_json)
        return
    route = first_swaths(area, belief_of(area, prior, wanted), config)
    facts = {
        "swaths": len(route.swaths),
        "length_m": route.length_m,
        "next": "drive and measure them, then ask again with --driven and --measured",
    }
    _tell(_written(route, area, prior, out) | facts, as_json=as_json)


def _go_on(
    area: "survey.SurveyArea",
    prior: "survey.Dem",
    driven: Path,
    measured: Path,
    config: "AdaptiveConfig",
    out: Path,
    *,
    as_json: bool,
) -> None:
    """Plan the next swath, say that none is needed, or end with exit code 5 where none would help."""
    from planners.guarantee.adaptive import next_swath
    from survey import Route, SurfacePoints

    points = SurfacePoints.read(measured, crs=str(area.crs))
    advice = next_swath(area, Route.read(driven), points.xy, points.xyz[:, 2], config)
    if not advice.holds:
        typer.echo(
            f"firnline: no further swaths would keep {config.limit_m:.4g} m with {config.probability:.0%}; "
            f"the densest would err {advice.assured.rmse_m:.3g} m.",
            err=True,
        )
        raise typer.Exit(NOT_MET)
    facts: dict[str, Any] = {"probability": advice.assured.probability, "rmse_m": advice.assured.rmse_m}
    if advice.route is None:
        _tell({"done": "the promise holds, drive no more", **facts}, as_json=as_json)
        return
    files = _written(advice.route, area, prior, out)
    _tell({**files, "length_m": advice.route.length_m, **facts}, as_json=as_json)


def _written(
    route: "survey.Route", area: "survey.SurveyArea", prior: "survey.Dem", out: Path
) -> dict[str, Any]:
    """Write a route and its picture; return where they are."""
    route.write(out)
    draw(route, area, prior, out)
    return {"route": str(out), "picture": str(out.with_suffix(".png"))}


def draw(
    route: "survey.Route",
    area: "survey.SurveyArea",
    prior: "survey.Dem",
    out: Path,
    *,
    kernel: "Kernel | None" = None,
    noise_m: float = 0.0,
) -> None:
    """Put a picture beside the route, with the error that a covariance lets one expect."""
    import planners
    from survey import figures
    from survey.core.files import replacing

    std = None if kernel is None else planners.predict_error(route, area, kernel, noise_m=noise_m).std
    figure = figures.plan_map(area, route, terrain=prior, std=std)
    with replacing(out.with_suffix(".png")) as file:
        file.write_bytes(figures.png_bytes(figure))


def _tell(facts: dict[str, Any], *, as_json: bool) -> None:
    if as_json:
        typer.echo(json.dumps(facts, indent=2))
        return
    for name, value in facts.items():
        typer.echo(f"{name} = {value:.6g}" if isinstance(value, float) else f"{name} = {value}")
