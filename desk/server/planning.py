"""Routes of the live plan: route and numbers, predicted error, drive in time."""

from typing import TYPE_CHECKING, Any

from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from desk.plan.history import OutdatedError
from desk.workspace import Workspace
from survey.core.errors import ConfigError

if TYPE_CHECKING:
    from desk.plan.live import LivePlan


def route(request: Request) -> Response:
    """Answer with route and numbers; ``exact=1`` waits for the covariance of the outline."""
    from desk.plan.summary import plan_summary

    workspace: Workspace = request.app.state.workspace
    live = _live(request)
    content = plan_summary(live, workspace.store.document, workspace.name, workspace.terrain.name)
    return JSONResponse({"revision": workspace.store.revision, **content})


def error(request: Request) -> Response:
    """Answer with the predicted standard deviation as an image, coarse or fine."""
    from desk.plan.error_map import error_map

    detail = request.query_params.get("detail", "coarse")
    if detail not in ("coarse", "fine"):
        raise ConfigError(f"the detail {detail!r} is not known; coarse or fine was expected.")
    live = _live(request)
    content: dict[str, Any] = {"is_provisional": live.is_provisional, "detail": detail}
    return JSONResponse(content | error_map(live.plan, detail))


def drive(request: Request) -> Response:
    """Answer with the drive of each rover in time."""
    from desk.plan.drive import drives

    workspace: Workspace = request.app.state.workspace
    return JSONResponse({"rovers": drives(_live(request), workspace.tiles.pyramid)})


def _live(request: Request) -> "LivePlan":
    """Plan the document as it stands; an outdated request is refused before any work."""
    workspace: Workspace = request.app.state.workspace
    document, revision = workspace.store.document, workspace.store.revision
    if request.query_params.get("revision", str(revision)) != str(revision):
        raise OutdatedError("the plan has changed meanwhile.")
    is_exact = request.query_params.get("exact") == "1"
    return workspace.planner.exact(document) if is_exact else workspace.planner.quick(document)
