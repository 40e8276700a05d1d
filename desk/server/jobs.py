"""Routes of jobs: start, follow by server-sent events, give up, open the report of a run."""

import json
from collections.abc import Iterator
from typing import Literal

from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response, StreamingResponse

from desk.jobs.job import Event, Job
from desk.server.replies import body_of, report_file
from desk.server.works import work_of
from desk.workspace import Workspace
from survey.core.config import Section, validated


class JobRequest(Section):
    """Job that the page asks for."""

    kind: Literal["guarantee", "curve", "mission", "map", "next", "watch"]
    """What is to be computed, of the document as it stands."""


async def start(request: Request) -> Response:
    """Start a job of the document as it stands."""
    workspace: Workspace = request.app.state.workspace
    given = validated(JobRequest, await body_of(request), "the request")
    job = workspace.jobs.start(work_of(workspace, given.kind))
    return JSONResponse({"job": job.name}, 201)


def events(request: Request) -> Response:
    """Answer with the events of a job as they come."""
    job = request.app.state.workspace.jobs.find(request.path_params["job"])
    return StreamingResponse(_lines(job), media_type="text/event-stream")


def cancel(request: Request) -> Response:
    """Give a job up."""
    request.app.state.workspace.jobs.find(request.path_params["job"]).cancel()
    return JSONResponse({})


def frame(request: Request) -> Response:
    """Answer with the latest image of a run that is being simulated."""
    job = request.app.state.workspace.jobs.find(request.path_params["job"])
    image = job.files.get("frame")
    if image is None:
        return PlainTextResponse("There is no image yet.", 404)
    return Response(image, media_type="image/png")


def report(request: Request) -> Response:
    """Answer with a file of the report of a run; its scripts do not run here."""
    job = request.app.state.workspace.jobs.find(request.path_params["job"])
    return report_file(job.files.get("report"), request.path_params["name"])


def _lines(job: Job) -> Iterator[str]:
    for event in job.events():
        yield ": waiting\n\n" if event is None else _line(event)


def _line(event: Event) -> str:
    return f"data: {json.dumps(event)}\n\n"
