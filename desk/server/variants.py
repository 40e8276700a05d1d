"""Routes of variants: plans that were set aside, side by side."""

from typing import Any

from anyio import to_thread
from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from desk.plan.history import Variant
from desk.server.replies import body_of
from desk.workspace import Workspace
from survey.core.config import Section, validated
from survey.core.errors import FirnlineError

_SHOWN = ("length_m", "time_s", "energy_j", "n_turns", "rmse_m")


class VariantRequest(Section):
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


def remove(request: Request) -> Response:
    """Remove a variant."""
    workspace: Workspace = request.app.state.workspace
    workspace.store.drop_variant(request.path_params["index"])
    return table(request)


def _row(workspace: Workspace, variant: Variant) -> dict[str, Any]:
    """Return the numbers of a variant, or why it is refused."""
    from firnline.cli.planning.outputs import fact_texts

    content = {"name": variant.name, "document": variant.document.model_dump(mode="json")}
    try:
        prediction = workspace.planner.exact(variant.document).plan.route.prediction
    except FirnlineError as error:
        return {**content, "error": str(error)}
    texts = fact_texts({name: prediction[name] for name in _SHOWN if name in prediction})
    return {**content, "facts": {name: text for name, (_, text) in texts.items()}}
