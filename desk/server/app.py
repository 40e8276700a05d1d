"""Application of the desk: its routes."""

from starlette.applications import Starlette
from starlette.routing import Route

from desk.server import assets, editing, files, jobs, maps, measured, planning, runs, variants
from desk.server.replies import refused
from desk.workspace import Workspace
from survey.core.errors import FirnlineError

_ROUTES = (
    Route("/", assets.page),
    Route("/static/{name:path}", assets.asset),
    Route("/api/site", maps.site),
    Route("/api/fields", maps.fields),
    Route("/api/style", maps.style),
    Route("/api/contours", maps.contours),
    Route("/api/heights", maps.heights, methods=["POST"]),
    Route("/tiles/{layer}/{zoom:int}/{column:int}/{row:int}.png", maps.tile),
    Route("/api/plan", editing.state),
    Route("/api/edit", editing.edit, methods=["POST"]),
    Route("/api/undo", editing.undo, methods=["POST"]),
    Route("/api/redo", editing.redo, methods=["POST"]),
    Route("/api/route", planning.route),
    Route("/api/error", planning.error),
    Route("/api/drive", planning.drive),
    Route("/api/export/{kind}", files.export),
    Route("/api/dropped", files.dropped_file, methods=["POST"]),
    Route("/api/variants", variants.table),
    Route("/api/variants", variants.add, methods=["POST"]),
    Route("/api/variants/{index:int}", variants.remove, methods=["DELETE"]),
    Route("/api/jobs", jobs.start, methods=["POST"]),
    Route("/api/jobs/{job}", jobs.cancel, methods=["DELETE"]),
    Route("/api/jobs/{job}/events", jobs.events),
    Route("/api/jobs/{job}/report/{name}", jobs.report),
    Route("/api/jobs/{job}/frame", jobs.frame),
    Route("/api/runs", runs.table),
    Route("/api/runs/{run}/minus/{other}", runs.difference),
    Route("/api/runs/{run}/layers/{layer}", runs.layer),
    Route("/api/runs/{run}/report/{name}", runs.report),
    Route("/api/measured", measured.show),
    Route("/api/measured/{role}", measured.take, methods=["POST"]),
    Route("/api/checkpoints", measured.checkpoints, methods=["POST"]),
)


def desk_app(workspace: Workspace) -> Starlette:
    """Return the application, without the gate that keeps others out."""
    handlers = {FirnlineError: refused, Exception: refused}
    app = Starlette(routes=list(_ROUTES), exception_handlers=handlers)
    app.state.workspace = workspace
    return app
