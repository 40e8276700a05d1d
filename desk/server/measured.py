"""Routes of real measurements: propose checkpoints, take a file, show those that were taken."""

from typing import Any, Literal

from anyio import to_thread
from pydantic import Field
from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from desk.server.replies import body_of
from desk.workspace import Workspace
from survey.core.arrays import FloatArray
from survey.core.config import Section, validated
from survey.core.streams import stream

_ROLES: tuple[Literal["points", "checkpoints", "driven"], ...] = ("points", "checkpoints", "driven")


class CheckpointRequest(Section):
    """Number of checkpoints that are wanted."""

    n: int = Field(default=30, ge=1, le=200)
    """How many."""


async def checkpoints(request: Request) -> Response:
    """Answer with places for checkpoints, well spread over gentle ground of the area."""
    workspace: Workspace = request.app.state.workspace
    given = validated(CheckpointRequest, await body_of(request), "the request")
    places = await to_thread.run_sync(_places, workspace, given.n)
    return JSONResponse({"places": places.round(2).tolist()})


def _places(workspace: Workspace, n: int) -> FloatArray:
    from survey.scoring import design_checkpoints

    area = workspace.store.document.survey_area(workspace.crs)
    terrain = workspace.planner.prior(area)
    return design_checkpoints(area, n, stream(0, "desk", "checkpoints"), terrain=terrain)


async def take(request: Request) -> Response:
    """Check a file, store it beside the plan, and answer with what it holds; the page names it in the document."""
    from desk.measured.files import store_measured

    workspace: Workspace = request.app.state.workspace
    content = await request.body()
    role, name = request.path_params["role"], request.query_params.get("name", "")
    found = await to_thread.run_sync(
        store_measured, role, name, content, workspace.crs, workspace.measurements
    )
    return JSONResponse(found)


def show(request: Request) -> Response:
    """Answer with the files that the document names."""
    from desk.measured.files import show_measured

    workspace: Workspace = request.app.state.workspace
    shown: list[dict[str, Any]] = []
    for role in _ROLES:
        file = workspace.measured_file(role)
        if file is not None and file.exists():
            shown.append(show_measured(role, file, workspace.crs))
    return JSONResponse({"files": shown})
