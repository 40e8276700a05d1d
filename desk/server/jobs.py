"""Routes of jobs: start, follow by server-sent events, give up, open the report of a run."""

import json
from collections.abc import Callable, Iterator
from typing import Any, Literal

from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response, StreamingResponse

from desk.jobs.job import Event, Job
from desk.server.replies import body_of
from desk.workspace import Workspace
from survey.core.config import Section, validated

_REPORT_POLICY = "default-src 'none'; img-src 'self' data:; style-src 'unsafe-inline'; font-src data:; frame-ancestors 'none'; sandbox"
_TYPES = {".html": "text/html; charset=utf-8", ".png": "image/png", ".svg": "image/svg+xml"}


class JobRequest(Section):
    """Job that the page asks for."""

    kind: Literal["guarantee", "curve", "mission"]
    """What is to be computed, of the document as it stands."""


async def start(request: Request) -> Response:
    """Start a job of the document as it stands."""
    workspace: Workspace = request.app.state.workspace
    given = validated(JobRequest, await body_of(request), "the request")
    job = workspace.jobs.start(_work(workspace, given.kind))
    return JSONResponse({"job": job.name}, 201)


def events(request: Request) -> Response:
    """Answer with the events of a job as they come."""
    job = request.app.state.workspace.jobs.find(request.path_params["job"])
    return StreamingResponse(_lines(job), media_type="text/event-stream")


def cancel(request: Request) -> Response:
    """Give a job up."""
    request.app.state.workspace.jobs.find(request.path_params["job"]).cancel()
    return JSONResponse({})


def report(request: Request) -> Response:
    """Answer with a file of the report of a run; its scripts do not run here."""
    job = request.app.state.workspace.jobs.find(request.path_params["job"])
    folder = job.files.get("report")
    known = {} if folder is None else {file.name: file for file in folder.iterdir() if file.is_file()}
    file = known.get(request.path_params["name"])
    if file is None or file.suffix not in _TYPES:
        return PlainTextResponse("The report has no such file.", 404)
    headers = {"content-security-policy": _REPORT_POLICY}
    return Response(file.read_bytes(), media_type=_TYPES[file.suffix], headers=headers)


def _work(workspace: Workspace, kind: str) -> Callable[[Job], dict[str, Any]]:
    """Return the computation of the document as it stands now."""
    document, planner, name = workspace.store.document, workspace.planner, workspace.name

    def work(job: Job) -> dict[str, Any]:
        from desk.jobs.computations import error_curve, guaranteed
        from desk.jobs.mission import mission_run
        from desk.plan.mission_files import write_mission

        if kind == "guarantee":
            return guaranteed(planner, document, name, job)
        if kind == "curve":
            return error_curve(planner, document, job)
        job.report("stage", stage="writing the mission", done=0, total=7)
        folder = workspace.folder / f"{name}_mission"
        return mission_run(write_mission(planner.exact(document), document, name, folder), job)

    return work


def _lines(job: Job) -> Iterator[str]:
    for event in job.events():
        yield ": waiting\n\n" if event is None else _line(event)


def _line(event: Event) -> str:
    return f"data: {json.dumps(event)}\n\n"
