"""Computations that take longer than a moment: guarantee of a class, error against swaths, a survey that is watched."""

from collections.abc import Iterator
from pathlib import Path
from time import sleep
from typing import Any

from pyproj import CRS

from desk.jobs.job import Job
from desk.plan.document import PlanDocument
from desk.plan.live import LivePlanner
from desk.plan.request import command_of, requirement_request
from desk.runs import layers_of
from firnline.actions.guaranteeing import refusal_text, requirement_of
from firnline.actions.watching import text_of
from live.watch.log import entered, watch_of
from live.watch.survey_watch import SurveyWatch
from planners.guarantee.guarantee import Guarantee, guarantee
from survey import ConfigError, Dem, InputError
from survey.core import length_text, parse_json, refusing_damage
from survey.core.crs import same_crs

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
    command = command_of(
        document, f"{name}_area.gpkg", planner.terrain.name, f"{name}.geojson", required=True
    )
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
        text, options = refusal_text(made), "; ".join(map(str, made.options))
        return f"{text[0].upper()}{text[1:]} Predicted are {options}."
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
        chosen.plan.route.n_lines if document.planner.get("swaths") is None else document.planner["swaths"]
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


_POLL_S = 0.5


def watched(file: Path, crs: CRS, job: Job) -> dict[str, Any]:
    """Follow a log of ``firnline watch`` until the survey ends.

    Returns: a ``sentence`` about the end of the survey.
    """
    if not file.is_file():
        raise InputError(
            f"there is no log {file.name} beside the plan; start firnline watch with --log {file.name}."
        )
    text, watch, n_samples, top_m = "", None, 0, None
    for line in _log_lines(file, job):
        with refusing_damage(file.name, "log of firnline watch", "name another one"):
            entry = parse_json(line, file.name, "name another one")
            if watch is None:
                watch = watch_of(entry)
                same_crs(crs, watch.area.crs, "the desk and the survey")
            events = entered(watch, entry) if "in" in entry else []
        if len(watch.samples) > n_samples:
            n_samples, last = len(watch.samples), watch.samples[-1]
            place = [round(last.x_m, 2), round(last.y_m, 2)]
            job.report("rover", time_s=last.time_s, place=place, battery=last.battery)
        for event in events:
            text = text_of(event)
            job.report("watch", text=text, do=event.get("do", ""))
            if event["event"] == "map":
                top_m = _report_map(event, watch, top_m, job)
        if watch.is_stopped:
            break
    return {"sentence": text}


def _report_map(event: dict[str, Any], watch: SurveyWatch, top_m: float | None, job: Job) -> float | None:
    """Report the map after an update in the colours of the first one; return the deviation at their end [m]."""
    if watch.latest_map is None:
        return top_m
    n_swaths = sum(leg.kind == "swath" for leg in watch.progress.driven)
    of = sum(leg.kind == "swath" for leg in watch.legs)
    mean, std = (Dem.on(watch.grid, field) for field in watch.latest_map)
    layers = layers_of(mean, std, top_m)
    rmse_m, time_s = event["expected_rmse_m"], event["time_s"]
    job.report("grown", time_s=time_s, swaths=n_swaths, of=of, rmse_m=rmse_m, **layers)
    return float(layers["sigma"]["limits"][1])


def _log_lines(file: Path, job: Job) -> Iterator[str]:
    """Yield the complete lines of a file as it grows, until the job is given up."""
    with file.open(encoding="utf-8") as stream:
        part = ""
        while True:
            part += stream.readline()
            if part.endswith("\n"):
                yield part
                part = ""
            else:
                job.require_wanted()
                sleep(_POLL_S)
