"""Routes of jobs and of real measurements.

A job is started, followed by server-sent events and given up. Measurements are taken as files and shown.
"""

import json
from collections.abc import AsyncIterator, Callable
from typing import Any, Literal

from anyio import sleep, to_thread
from pydantic import Field
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response, StreamingResponse

from desk.jobs.job import Job
from desk.plan.document import PlanDocument, Record
from desk.server.replies import BusyError, body_of, report_file
from desk.workspace import Workspace
from survey.core import ConfigError, FloatArray, InputError, stream, validated

Work = Callable[[Job], dict[str, Any]]


def work_of(workspace: Workspace, given: "JobRequest") -> Work:
    """Return the computation that is asked for."""
    if given.kind == "replay":
        return _replay(workspace, given.run)
    document = workspace.store.document
    return lambda job: _WORKS[given.kind](workspace, document, job)


def _replay(workspace: Workspace, name: str) -> Work:
    from desk.jobs.mission import replayed_run
    from desk.runs import found_runs, run_named

    run = run_named(found_runs(workspace.folder, workspace.opened_run), name)
    return lambda job: replayed_run(run, job)


def _guarantee(workspace: Workspace, document: PlanDocument, job: Job) -> dict[str, Any]:
    from desk.jobs.computations import guaranteed

    return guaranteed(workspace.planner, document, workspace.name, job)


def _curve(workspace: Workspace, document: PlanDocument, job: Job) -> dict[str, Any]:
    from desk.jobs.computations import error_curve

    return error_curve(workspace.planner, document, job)


def _mission(workspace: Workspace, document: PlanDocument, job: Job) -> dict[str, Any]:
    from desk.jobs.mission import mission_run
    from desk.plan.exports import write_mission

    job.report("stage", stage="writing the mission", done=0, total=7)
    live = workspace.planner.exact(document)
    folder = workspace.folder / f"{workspace.name}_mission"
    model = live.plan.model
    kernel = None if model is None else model.posterior.likeliest.kernel
    return mission_run(write_mission(live, document, workspace.name, folder), kernel, job)


def _map(workspace: Workspace, document: PlanDocument, job: Job) -> dict[str, Any]:
    from desk.measured import measured_map

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
    from desk.measured import proposed_swath
    from desk.plan.dropped import SIGMA_M
    from desk.plan.request import requirement_request
    from firnline.actions.guaranteeing import requirement_of
    from survey import Route, SurfacePoints

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
    from desk.jobs.computations import watched

    return watched(workspace.folder / f"{workspace.name}.watch.jsonl", workspace.crs, job)


_WORKS: dict[str, Callable[[Workspace, PlanDocument, Job], dict[str, Any]]] = {
    "guarantee": _guarantee, "curve": _curve, "mission": _mission, "map": _map, "next": _next,
    "watch": _watch,
}  # fmt: skip


class JobRequest(Record):
    """Job that the page asks for."""

    kind: Literal["guarantee", "curve", "mission", "map", "next", "watch", "replay"]
    """What is to be computed, of the document as it stands."""
    run: str = ""
    """Run that is replayed."""


async def start(request: Request) -> Response:
    """Start a job of the document as it stands."""
    workspace: Workspace = request.app.state.workspace
    given = validated(JobRequest, await body_of(request), "the request")
    job = workspace.jobs.start(work_of(workspace, given))
    return JSONResponse({"job": job.name}, 201)


_MOST_STREAMS = 32
_POLL_S, _PATIENCE_S = 0.1, 15.0


async def events(request: Request) -> Response:
    """Answer with the events of a job as they come; no thread waits for them."""
    workspace: Workspace = request.app.state.workspace
    job = workspace.jobs.find(request.path_params["job"])
    if workspace.n_streams >= _MOST_STREAMS:
        raise BusyError(f"{_MOST_STREAMS} windows follow computations already; close one.")
    return StreamingResponse(_lines(job, workspace), media_type="text/event-stream")


def cancel(request: Request) -> Response:
    """Give a job up."""
    request.app.state.workspace.jobs.find(request.path_params["job"]).cancel()
    return JSONResponse({})


def frame(request: Request) -> Response:
    """Answer with an image of the first rover of a run: the latest one while it is simulated, one by its number after."""
    job = request.app.state.workspace.jobs.find(request.path_params["job"])
    number = request.query_params.get("number", "")
    image = job.files.get("frame")
    if number.isdecimal() and len(number) < 10 and "images" in job.files:
        file = job.files["images"][0] / f"{int(number):06d}.png"
        image = file.read_bytes() if file.is_file() else None
    if image is None:
        return PlainTextResponse("There is no such image.", 404)
    return Response(image, media_type="image/png")


def report(request: Request) -> Response:
    """Answer with a file of the report of a run; its scripts do not run here."""
    job = request.app.state.workspace.jobs.find(request.path_params["job"])
    return report_file(job.files.get("report"), request.path_params["name"])


async def _lines(job: Job, workspace: Workspace) -> AsyncIterator[str]:
    """Yield the events from the first on, and a comment at times at which nothing comes."""
    seen, waited_s = 0, 0.0
    workspace.n_streams += 1
    try:
        while True:
            is_over, fresh = job.is_over, job.events(seen)
            for event in fresh:
                yield f"data: {json.dumps(event)}\n\n"
            seen += len(fresh)
            if is_over:
                return
            waited_s = 0.0 if fresh or waited_s > _PATIENCE_S else waited_s + _POLL_S
            if waited_s > _PATIENCE_S:
                yield ": waiting\n\n"
            await sleep(_POLL_S)
    finally:
        workspace.n_streams -= 1


_ROLES: tuple[Literal["points", "checkpoints", "driven"], ...] = ("points", "checkpoints", "driven")


class CheckpointRequest(Record):
    """Number of checkpoints that are wanted."""

    n: int = Field(default=30, ge=1, le=200)
    """How many."""
    max_slope_deg: float = Field(default=10.0, gt=0.0, le=60.0)
    """Steepest ground [deg]."""
    reach_m: float | None = Field(default=None, gt=0.0)
    """Largest distance from the route [m]; anywhere in the area without one."""


async def checkpoints(request: Request) -> Response:
    """Answer with places for checkpoints over gentle ground of the area, and what of their spread could not be kept."""
    workspace: Workspace = request.app.state.workspace
    given = validated(CheckpointRequest, await body_of(request), "the request")
    places, lost = await to_thread.run_sync(_checkpoint_places, workspace, given)
    return JSONResponse({"places": places.round(2).tolist(), "note": lost})


def _checkpoint_places(workspace: Workspace, given: CheckpointRequest) -> tuple[FloatArray, str]:
    from survey.scoring.standards.checkpoints import fitting_checkpoints

    document = workspace.store.document
    area = document.survey_area(workspace.crs)
    ground: dict[str, Any] = {"terrain": workspace.planner.prior(area), "max_slope_deg": given.max_slope_deg}
    if given.reach_m is not None:
        ground |= {"route": workspace.planner.quick(document).plan.route, "reach_m": given.reach_m}
    return fitting_checkpoints(area, given.n, stream(0, "desk", "checkpoints"), **ground)


async def take(request: Request) -> Response:
    """Check a file, store it beside the plan, and answer with what it holds; the page names it in the document."""
    from desk.measured import store_measured

    workspace: Workspace = request.app.state.workspace
    content = await request.body()
    role, name = request.path_params["role"], request.query_params.get("name", "")
    found = await to_thread.run_sync(
        store_measured, role, name, content, workspace.crs, workspace.measurements
    )
    return JSONResponse(found)


def show(request: Request) -> Response:
    """Answer with the files that the document names."""
    from desk.measured import show_measured

    workspace: Workspace = request.app.state.workspace
    shown: list[dict[str, Any]] = []
    for role in _ROLES:
        file = workspace.measured_file(role)
        if file is not None and file.exists():
            shown.append(show_measured(role, file, workspace.crs))
    return JSONResponse({"files": shown})
