"""``firnline plan --require``: a route that guarantees a map class, or a refusal that names what is reachable."""

import json
from typing import TYPE_CHECKING, Any, cast

import typer

from sim.cli.outcome import NOT_MET
from sim.cli.planning.drawing import PlanDrawing
from sim.cli.planning.outputs import write_plan
from sim.cli.planning.request import PlanRequest

if TYPE_CHECKING:
    import survey
    from planners.guarantee.guarantee import Guarantee
    from planners.guarantee.requirement import MapRequirement
    from survey.reconstruction.gp.covariance.kernels import Kernel


def limit_of(require: str) -> float:
    """Return the widest limit of a class of the paper's tables [m], or the number of metres that was given."""
    from survey.core.errors import ConfigError
    from survey.scoring.standards.map_classes import map_classes

    widest = {row.map_class.lower().replace(" ", "-"): row.limit_m for row in reversed(map_classes())}
    if require in widest:
        return widest[require]
    try:
        return float(require)
    except ValueError as error:
        raise ConfigError(
            f"--require {require} is no map class; take {', '.join(sorted(widest))} or an error in metres."
        ) from error


def requirement_of(request: PlanRequest) -> "MapRequirement":
    """Return what the map has to meet."""
    from planners.guarantee.requirement import MapRequirement

    return MapRequirement(
        limit_of(str(request.require)),
        request.probability,
        noise_m=request.noise_m,
        localization_m=request.localization_m,
        prior_sigma_m=request.prior_sigma_m,
        assumed=request.assume,
    )


def prior_of(request: PlanRequest) -> "tuple[survey.SurveyArea, survey.Dem]":
    """Read the area and the prior that a guarantee needs."""
    from survey.core.errors import InputError

    if request.prior is None:
        raise InputError("a guarantee needs the roughness of the terrain; give a coarse DEM with --prior.")
    area, prior = request.read_area()
    return area, cast("survey.Dem", prior)


def found_guarantee(
    area: "survey.SurveyArea", prior: "survey.Dem", requirement: "MapRequirement"
) -> "Guarantee":
    """Return the guarantee; end with exit code 5 and one sentence where it does not hold."""
    from planners.guarantee.guarantee import guarantee
    from planners.guarantee.requirement import reachable_class

    made = guarantee(area, prior, requirement)
    if made.holds:
        return made
    best = reachable_class(made.reachable_m)
    typer.echo(
        f"firnline: an RMSE of {requirement.limit_m:.4g} m cannot be guaranteed with {requirement.probability:.0%} by up to "
        f"{made.config.swaths} swaths; with that probability they reach {made.reachable_m:.3g} m, "
        f"{'which meets ' + best if best else 'which meets no class'} ({made.assumptions}).",
        err=True,
    )
    raise typer.Exit(NOT_MET)


def plan_guaranteed(request: PlanRequest) -> None:
    """Write the shortest route that guarantees the class, and print what it rests on."""
    requirement = requirement_of(request)
    area, prior = prior_of(request)
    made = found_guarantee(area, prior, requirement)
    best = made.posterior.likeliest
    write_plan(request, made.route, drawing_of(area, prior, kernel=best.kernel, noise_m=best.noise_m))
    if request.as_json:
        typer.echo(json.dumps(_facts(request, made), indent=2))
    else:
        _print_guarantee(request, made)


def _facts(request: PlanRequest, made: "Guarantee") -> dict[str, Any]:
    from planners.swaths.counting import count_lines

    return {
        **request.written,
        "pattern": made.config.pattern,
        "lines": count_lines(made.route),
        "swaths": len(made.route.swaths),
        "length_m": made.length_m,
        "limit_m": made.requirement.limit_m,
        "probability": made.predicted.probability,
        "rmse_m": made.predicted.rmse_m,
        "likely_rmse_m": made.likely.rmse_m,
        "likely_swaths": made.likely_swaths,
        "simulated_share": made.simulated_share,
        "assumed": made.assumptions,
    } | {
        name: value
        for name, value in made.route.prediction.items()
        if name in ("map_scale", "prior_covered_share")
    }


def _print_guarantee(request: PlanRequest, made: "Guarantee") -> None:
    from planners.swaths.counting import swaths_text

    requirement = made.requirement
    typer.echo(
        f"{made.config.pattern} pattern, {swaths_text(made.route)}, {made.length_m:.0f} m to drive: an RMSE within "
        f"{requirement.limit_m:.4g} m is guaranteed with {requirement.probability:.0%}."
    )
    typer.echo(f"  assumed: {made.assumptions}")
    typer.echo(
        f"  with that covariance: RMSE {made.predicted.rmse_m:.2f} m, within the limit with "
        f"{made.predicted.probability:.0%} by prediction, in {made.simulated_share:.0%} of {requirement.n_simulations} "
        "simulated surveys"
    )
    if requirement.assumed is None:
        fewer = made.likely_swaths < (made.config.swaths or 0)
        remedy = f", and {made.likely_swaths} swaths are enough; --adaptive finds out" if fewer else ""
        typer.echo(f"  with the likeliest covariance of the prior: RMSE {made.likely.rmse_m:.2f} m{remedy}")
    typer.echo(
        "  not included: errors that samples share (--joint predicts them), relief unlike that of the cells"
    )
    typer.echo(f"  written to {request.written_text}")


def drawing_of(
    area: "survey.SurveyArea",
    prior: "survey.Dem",
    *,
    kernel: "Kernel | None" = None,
    noise_m: float = 0.0,
) -> PlanDrawing:
    """Return what is drawn of a route, with the predicted error of the map where a covariance is given."""
    return PlanDrawing(area, prior, kernel, noise_m)
