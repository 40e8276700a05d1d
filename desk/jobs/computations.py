"""Computations of a plan that take longer than a moment: guarantee of a class, error against swaths."""

from collections.abc import Iterator
from typing import Any

from desk.jobs.job import Job
from desk.plan.document import PlanDocument
from desk.plan.live import LivePlanner
from desk.plan.request import command_of, requirement_request
from firnline.cli.planning.guarantee import refusal_text, requirement_of
from planners.guarantee.guarantee import Guarantee, guarantee
from survey.core.errors import ConfigError, InputError
from survey.core.text import length_text

_FACTORS = (0.25, 0.4, 0.5, 0.65, 0.8, 1.0, 1.25, 1.5, 2.0, 2.5, 3.0)
_MOST_SWATHS = 120


def guaranteed(planner: LivePlanner, document: PlanDocument, name: str, job: Job) -> dict[str, Any]:
    """Find the shortest survey that meets the requirement of a document.

    Returns: ``holds``, a ``sentence``, and where it holds the settings of the pattern.
    """
    if not document.requirement.get("require"):
        raise ConfigError("no class is required; choose one, or an RMSE in metres.")
    requirement = requirement_of(requirement_request(document, planner.terrain))
    area = document.survey_area(planner.crs)
    made = guarantee(area, planner.prior(area), requirement, progress=job.progress)
    command = command_of(document, f"{name}.gpkg", planner.terrain.name, f"{name}.geojson", required=True)
    return {"holds": made.holds, "sentence": _sentence(made), "command": command} | (
        {
            "planner": made.config.model_dump(mode="json", exclude_defaults=True)
            | {"pattern": made.config.pattern}
        }
        if made.holds
        else {}
    )


def _sentence(made: Guarantee) -> str:
    if not made.holds:
        text = refusal_text(made)
        return text[0].upper() + text[1:]
    required = made.requirement
    return (
        f"{made.config.swaths} swaths of the {made.config.pattern} pattern, {length_text(made.length_m)} to drive: an RMSE "
        f"within {required.limit_m:.4g} m is guaranteed with {required.probability:.0%} (predicted "
        f"{made.predicted.rmse_m:.2f} m; met in {made.simulated_share:.0%} of the simulated surveys; {made.assumptions})."
    )


def error_curve(planner: LivePlanner, document: PlanDocument, job: Job) -> dict[str, Any]:
    """Plan with fewer and more swaths, and report length and predicted error of each."""
    chosen = planner.exact(document)
    if "rmse_m" not in chosen.plan.route.prediction:
        raise InputError(
            chosen.no_error_because or "no error is predicted for this pattern; choose lawnmower or wavy."
        )
    n_chosen = (
        len(chosen.plan.route.swaths)
        if document.planner.get("swaths") is None
        else document.planner["swaths"]
    )
    numbers = list(_numbers(n_chosen))
    for done, n in enumerate(numbers):
        settings = {k: v for k, v in document.planner.items() if k not in ("spacing_m", "budget_m", "rmse_m")}
        plan = planner.exact(document.model_copy(update={"planner": settings | {"swaths": n}})).plan
        facts = plan.route.prediction
        job.report(
            "point", swaths=n, rmse_m=facts["rmse_m"], length_m=facts["length_m"], time_s=facts["time_s"],
            is_chosen=n == n_chosen, done=done + 1, total=len(numbers),
        )  # fmt: skip
    return {"n_points": len(numbers)}


def _numbers(chosen: Any) -> Iterator[int]:
    """Yield numbers of swaths about the chosen one, it itself first."""
    if not isinstance(chosen, int) or chosen < 1:
        raise ConfigError(f"the number of swaths is {chosen}; a whole number above 0 was expected.")
    yield chosen
    others = {max(1, round(factor * chosen)) for factor in _FACTORS} - {chosen}
    yield from (n for n in sorted(others) if n <= _MOST_SWATHS)
