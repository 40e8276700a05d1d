"""Routes of files: export of the plan, files that are dropped onto the page."""

from anyio import to_thread
from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from desk.workspace import Workspace


def export(request: Request) -> Response:
    """Answer with a file of the plan."""
    from desk.plan.exports import PlanExport

    workspace: Workspace = request.app.state.workspace
    document = workspace.store.document
    live = workspace.planner.exact(document)
    plan = PlanExport(live, document, workspace.name, workspace.terrain)
    file = plan.file(request.path_params["kind"])
    ascii_name = file.name.encode("ascii", "replace").decode().replace('"', "_").replace("\\", "_")
    headers = {"content-disposition": f'attachment; filename="{ascii_name}"'}
    return Response(file.content, media_type="application/octet-stream", headers=headers)


async def dropped_file(request: Request) -> Response:
    """Answer with what a dropped file holds."""
    from desk.plan.dropped import dropped

    workspace: Workspace = request.app.state.workspace
    content = await request.body()
    name = request.query_params.get("name", "")
    return JSONResponse(await to_thread.run_sync(dropped, name, content, workspace.crs))
