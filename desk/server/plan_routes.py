"""Routes of the plan: its document, its route and predicted error, variants, exports, and dropped files."""

from collections.abc import Mapping
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from anyio import to_thread
from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from desk.plan.document import PlanDocument, Record
from desk.plan.history import OutdatedError, Variant
from desk.plan.history_file import StoredHistory
from desk.server.replies import body_of
from desk.workspace import Workspace
from survey.core import ConfigError, FirnlineError, InputError, validated

if TYPE_CHECKING:
    from desk.plan.live import LivePlan


class EditRequest(Record):
    """Edit as the page sends it."""

    revision: int
    """Revision that was edited."""
    title: str
    """What was done."""
    document: PlanDocument
    """Result."""


class MoveRequest(Record):
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


def route(request: Request) -> Response:
    """Answer with route and numbers; ``exact=1`` waits for the covariance of the outline."""
    from desk.plan.summary import plan_summary

    workspace: Workspace = request.app.state.workspace
    live = _live(request)
    content = plan_summary(live, workspace.store.document, workspace.name, workspace.terrain.name)
    return JSONResponse({"revision": workspace.store.revision, **content})


def error(request: Request) -> Response:
    """Answer with the predicted standard deviation as an image, coarse or fine."""
    from desk.plan.summary import error_layer

    detail = request.query_params.get("detail", "coarse")
    if detail not in ("coarse", "fine"):
        raise ConfigError(f"the detail {detail!r} is not known; coarse or fine was expected.")
    live = _live(request)
    content: dict[str, Any] = {"is_provisional": live.is_provisional, "detail": detail}
    return JSONResponse(content | error_layer(live.plan, detail))


def drive(request: Request) -> Response:
    """Answer with the drive of each rover in time."""
    from desk.plan.summary import drives

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


_SHOWN = ("length_m", "time_s", "energy_j", "n_turns", "rmse_m")


class VariantRequest(Record):
    """Name under which the document is set aside."""

    name: str
    """Of 1 to 80 letters."""


def table(request: Request) -> Response:
    """Answer with the variants and their numbers."""
    workspace: Workspace = request.app.state.workspace
    return JSONResponse(
        {"variants": [_row(workspace, variant) for variant in workspace.store.history.set_aside]}
    )


async def add(request: Request) -> Response:
    """Set the document aside under a name; one of the same name is replaced."""
    workspace: Workspace = request.app.state.workspace
    name = validated(VariantRequest, await body_of(request), "the variant").name.strip()
    await to_thread.run_sync(workspace.store.set_aside, name)
    return await to_thread.run_sync(table, request)


def beside(request: Request) -> Response:
    """Answer with the plan and a variant side by side."""
    from desk.plan.summary import plans_beside

    workspace: Workspace = request.app.state.workspace
    document, variants = workspace.store.document, workspace.store.history.set_aside
    index = request.path_params["index"]
    if index >= len(variants):
        raise InputError("there is no such variant any more; reload the page.")
    other = variants[index].document
    plans = workspace.planner.exact(document), workspace.planner.exact(other)
    return JSONResponse({"name": variants[index].name, **plans_beside(*plans, document, other)})


def remove(request: Request) -> Response:
    """Remove a variant."""
    workspace: Workspace = request.app.state.workspace
    workspace.store.drop_variant(request.path_params["index"])
    return table(request)


def _row(workspace: Workspace, variant: Variant) -> dict[str, Any]:
    """Return the numbers of a variant, or why it is refused."""
    from firnline.actions.plan_texts import fact_texts

    content = {"name": variant.name, "document": variant.document.model_dump(mode="json")}
    try:
        prediction = workspace.planner.exact(variant.document).plan.route.prediction
    except FirnlineError as error:
        return {**content, "error": str(error)}
    texts = fact_texts({name: prediction[name] for name in _SHOWN if name in prediction})
    return {**content, "facts": {name: text for name, (_, text) in texts.items()}}


def export(request: Request) -> Response:
    """Answer with a file of the plan."""
    from desk.plan.exports import MissionOptions, PlanExport, known_kind

    workspace: Workspace = request.app.state.workspace
    kind, document = known_kind(request.path_params["kind"]), workspace.store.document
    missions = validated(MissionOptions, _parsed(request.query_params), "the mission")
    plan = PlanExport(
        workspace.planner.exact(document), document, workspace.name, workspace.terrain, missions
    )
    file = plan.file(kind)
    ascii_name = file.name.encode("ascii", "replace").decode().replace('"', "_").replace("\\", "_")
    headers = {"content-disposition": f'attachment; filename="{ascii_name}"'}
    return Response(file.content, media_type="application/octet-stream", headers=headers)


def _parsed(given: Mapping[str, str]) -> dict[str, Any]:
    """Return the values of an address: numbers, ``true`` and ``false`` as what they are, others as text."""
    values: dict[str, Any] = {}
    for name, text in given.items():
        values[name] = {"true": True, "false": False}.get(text, text)
        with suppress(ValueError):
            values[name] = float(text)
    return values


async def dropped_file(request: Request) -> Response:
    """Answer with what a dropped file holds."""
    from desk.plan.dropped import dropped

    workspace: Workspace = request.app.state.workspace
    content = await request.body()
    name = request.query_params.get("name", "")
    select = request.query_params.getlist("select")
    return JSONResponse(await to_thread.run_sync(dropped, name, content, workspace.crs, select))
