"""Computations that jobs do, of the document as it stands when they are started."""

from collections.abc import Callable
from typing import Any

from desk.jobs.job import Job
from desk.plan.document import PlanDocument
from desk.workspace import Workspace
from survey.core.errors import ConfigError, InputError

Work = Callable[[Job], dict[str, Any]]


def work_of(workspace: Workspace, kind: str) -> Work:
    """Return the computation of a kind of job."""
    document = workspace.store.document
    return lambda job: _WORKS[kind](workspace, document, job)


def _guarantee(workspace: Workspace, document: PlanDocument, job: Job) -> dict[str, Any]:
    from desk.jobs.computations import guaranteed

    return guaranteed(workspace.planner, document, workspace.name, job)


def _curve(workspace: Workspace, document: PlanDocument, job: Job) -> dict[str, Any]:
    from desk.jobs.computations import error_curve

    return error_curve(workspace.planner, document, job)


def _mission(workspace: Workspace, document: PlanDocument, job: Job) -> dict[str, Any]:
    from desk.jobs.mission import mission_run
    from desk.plan.mission_files import write_mission

    job.report("stage", stage="writing the mission", done=0, total=7)
    live = workspace.planner.exact(document)
    folder = workspace.folder / f"{workspace.name}_mission"
    return mission_run(write_mission(live, document, workspace.name, folder), live.plan.kernel, job)


def _map(workspace: Workspace, document: PlanDocument, job: Job) -> dict[str, Any]:
    from desk.measured.mapping import measured_map

    points = workspace.measured_file("points")
    if points is None:
        raise InputError("no measured points were taken; choose their file first.")
    return measured_map(
        document.survey_area(workspace.crs),
        points,
        workspace.terrain,
        workspace.measurements,
        checkpoints=workspace.measured_file("checkpoints"),
        progress=job.progress,
    )


def _next(workspace: Workspace, document: PlanDocument, job: Job) -> dict[str, Any]:
    from desk.measured.files import SIGMA_M
    from desk.measured.next_swath import proposed_swath
    from desk.plan.request import requirement_request
    from firnline.cli.planning.guarantee import requirement_of
    from survey.data.route import Route
    from survey.data.surface_points import SurfacePoints

    points, driven = workspace.measured_file("points"), workspace.measured_file("driven")
    if points is None:
        raise InputError("no measured points were taken; choose their file first.")
    if not document.requirement.get("require"):
        raise ConfigError("no class is required; choose one, or an RMSE in metres, under Require.")
    job.progress("fitting the terrain to the measurements", 1, 2)
    area = document.survey_area(workspace.crs)
    route = workspace.planner.exact(document).plan.route if driven is None else Route.read(driven)
    found = proposed_swath(
        area,
        workspace.planner.prior(area),
        route,
        SurfacePoints.read(points, crs=workspace.crs, sigma_m=SIGMA_M),
        requirement=requirement_of(requirement_request(document, workspace.terrain)),
        file=workspace.measurements / "next.geojson",
    )
    assumed = " The route of the plan counts as driven." if driven is None else ""
    return {**found, "sentence": found["sentence"] + assumed}


def _watch(workspace: Workspace, _: PlanDocument, job: Job) -> dict[str, Any]:
    from desk.jobs.watched import watched

    return watched(workspace.folder / f"{workspace.name}.watch.jsonl", workspace.crs, job)


_WORKS: dict[str, Callable[[Workspace, PlanDocument, Job], dict[str, Any]]] = {
    "guarantee": _guarantee,
    "curve": _curve,
    "mission": _mission,
    "map": _map,
    "next": _next,
    "watch": _watch,
}
