"""``firnline plan --require``: a route that guarantees a map class, or a refusal that names what is reachable."""

import json
from typing import TYPE_CHECKING, Any, cast

import typer

from firnline.cli.facts import fact_line
from firnline.cli.outcome import NOT_MET
from firnline.cli.planning.drawing import PlanDrawing
from firnline.cli.planning.outputs import write_plan
from firnline.cli.planning.request import PlanRequest

if TYPE_CHECKING:
    import survey
    from planners.guarantee.guarantee import Guarantee
    from planners.guarantee.requirement import MapRequirement, Surface
    from survey.reconstruction.gp.kernels import Kernel


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
        surface=cast("Surface", request.surface),
        micro_relief_m=request.micro_relief_m,
        shared_m=request.shared_m,
        max_swaths=request.max_swaths,
    )


def prior_of(request: PlanRequest) -> "tuple[survey.SurveyArea, survey.Dem]":
    """Read the area and the prior that a guarantee needs."""
    from survey.core.errors import InputError

    if request.prior is None:
        raise InputError("a guarantee needs the roughness of the terrain; give a coarse DEM with --prior.")
    area, prior = request.read_area()
    return area, cast("survey.Dem", prior)


def found_guarantee(
    area: "survey.SurveyArea", prior: "survey.Dem", requirement: "MapRequirement", *, quiet: bool
) -> "Guarantee":
    """Return the guarantee; end with exit code 5 and one sentence where it does not hold."""
    from firnline.cli.progress import counted
    from planners.guarantee.guarantee import guarantee

    with counted(quiet=quiet) as progress:
        made = guarantee(area, prior, requirement, progress=progress)
    if not made.holds:
        typer.echo(f"firnline: {refusal_text(made)}", err=True)
        raise typer.Exit(NOT_MET)
    return made


def refusal_text(made: "Guarantee") -> str:
    """Return why a guarantee does not hold, and what can be reached, in one sentence."""
    from planners.guarantee.requirement import reachable_class

    requirement = made.requirement
    reason = f" {contradiction_text(made)}; " if made.is_contradicted else " "
    if made.predicted.probability >= requirement.probability:
        return (
            f"an RMSE of {requirement.limit_m:.4g} m cannot be guaranteed: {made.config.swaths} swaths are predicted "
            f"to reach it with {made.predicted.probability:.0%}, but {len(made.simulated.rmse_m)} simulated surveys of other "
            f"ground do in {made.simulated_share:.0%}, which shows {made.simulated_bound:.0%} at least ({_shares(made)});"
            f"{reason}--adaptive learns how rough the ground is from its first swaths."
        )
    best = reachable_class(made.reachable_m)
    return (
        f"an RMSE of {requirement.limit_m:.4g} m cannot be guaranteed with {requirement.probability:.0%} by up to "
        f"{made.config.swaths} swaths; with that probability they reach {made.reachable_m:.3g} m, "
        f"{'which meets ' + best if best else 'which meets no class'} ({made.assumptions});{reason}--adaptive "
        "learns how rough the ground is from its first swaths."
    )


def contradiction_text(made: "Guarantee") -> str:
    """Return by how much the relief of the prior contradicts the stated class of surface."""
    without = "" if made.unstated_m is None else f", where the densest survey reaches {made.unstated_m:.3g} m"
    return (
        f"the relief of the prior contradicts surface {made.requirement.surface}: repeated at a smaller scale it gives "
        f"{made.resampled_ratio:.1f} times the error predicted for that class; leave --surface out{without}"
    )


def _shares(made: "Guarantee") -> str:
    """Return the share of simulated surveys that met the limit, by kind of ground."""
    limit_m = made.requirement.limit_m
    names = dict.fromkeys(made.simulated.grounds)
    return ", ".join(f"{name} {made.simulated.share(limit_m, name):.0%}" for name in names)


def plan_guaranteed(request: PlanRequest) -> None:
    """Write the shortest route that guarantees the class, and print what it rests on."""
    requirement = requirement_of(request)
    area, prior = prior_of(request)
    made = found_guarantee(area, prior, requirement, quiet=request.quiet)
    best = made.posterior.likeliest
    write_plan(request, made.route, drawing_of(area, prior, kernel=best.kernel, noise_m=best.noise_m))
    if request.as_json:
        typer.echo(json.dumps(_facts(request, made), indent=2))
    else:
        _print_guarantee(request, made)


def _facts(request: PlanRequest, made: "Guarantee") -> dict[str, Any]:
    from planners.swaths.reference_lines import count_lines

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
        "simulated_bound": made.simulated_bound,
        "simulated_shares": {
            name: made.simulated.share(made.requirement.limit_m, name)
            for name in dict.fromkeys(made.simulated.grounds)
        },
        "stakes": None if made.stakes is None else str(made.stakes),
        "assumed": made.assumptions,
    } | {
        name: value
        for name, value in made.route.prediction.items()
        if name in ("map_scale", "prior_covered_share")
    }


def _print_guarantee(request: PlanRequest, made: "Guarantee") -> None:
    from planners.swaths.reference_lines import swaths_text
    from survey.core.text import length_text

    requirement = made.requirement
    typer.echo(
        f"{made.config.pattern} pattern, {swaths_text(made.route)}, {length_text(made.length_m)} to drive: an RMSE within "
        f"{requirement.limit_m:.4g} m is guaranteed with {requirement.probability:.0%}."
    )
    facts = {
        "assumed": made.assumptions,
        "predicted": f"RMSE {made.predicted.rmse_m:.2f} m, within the limit with {made.predicted.probability:.0%}; in "
        f"{made.simulated_share:.0%} of {len(made.simulated.rmse_m)} simulated surveys of other ground "
        f"({_shares(made)}), which shows {made.simulated_bound:.0%} at least",
    }
    if made.is_contradicted:
        facts["but"] = contradiction_text(made)
    if made.likely_swaths < (made.config.swaths or 0):
        facts["likeliest ground"] = (
            f"RMSE {made.likely.rmse_m:.2f} m, and {made.likely_swaths} swaths are enough; --adaptive finds out"
        )
    if made.stakes is not None:
        facts["or"] = str(made.stakes)
    facts["not included"] = "errors of position that grow along the path (--joint predicts them)"
    facts["written to"] = request.written_text
    for name, text in facts.items():
        typer.echo(fact_line(name, text))


def drawing_of(
    area: "survey.SurveyArea",
    prior: "survey.Dem",
    *,
    kernel: "Kernel | None" = None,
    noise_m: float = 0.0,
) -> PlanDrawing:
    """Return what is drawn of a route, with the predicted error of the map where a covariance is given."""
    return PlanDrawing(area, prior, kernel, noise_m)
