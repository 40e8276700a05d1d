"""Routes of the plan document: show it, edit it, undo and redo."""

from typing import Any

from anyio import to_thread
from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from desk.plan.document import PlanDocument
from desk.plan.history import StoredHistory
from desk.server.replies import body_of
from survey.core.config import Section, validated


class EditRequest(Section):
    """Edit as the page sends it."""

    revision: int
    """Revision that was edited."""
    title: str
    """What was done."""
    document: PlanDocument
    """Result."""


class MoveRequest(Section):
    """Undo or redo as the page sends it."""

    revision: int
    """Revision that is shown."""


def state(request: Request) -> Response:
    """Answer with the document as it stands."""
    return _state(request.app.state.workspace.store)


async def edit(request: Request) -> Response:
    """Store an edit."""
    store: StoredHistory = request.app.state.workspace.store
    given = validated(EditRequest, await body_of(request), "the edit")
    await to_thread.run_sync(store.edit, given.revision, given.title, given.document)
    return _state(store)


async def undo(request: Request) -> Response:
    """Go one step back."""
    return await _moved(request, -1)


async def redo(request: Request) -> Response:
    """Go one step forth."""
    return await _moved(request, 1)


async def _moved(request: Request, by: int) -> Response:
    store: StoredHistory = request.app.state.workspace.store
    given = validated(MoveRequest, await body_of(request), "the request")
    await to_thread.run_sync(store.move, given.revision, by)
    return _state(store)


def _state(store: StoredHistory) -> Response:
    history = store.history
    content: dict[str, Any] = {
        "revision": store.revision,
        "document": history.document.model_dump(mode="json"),
        "undo": history.undo_title,
        "redo": history.redo_title,
        "variants": [variant.name for variant in history.set_aside],
    }
    return JSONResponse(content)
