"""The application of the desk: its routes, and how refusals are answered."""

from starlette.applications import Starlette
from starlette.requests import ClientDisconnect
from starlette.routing import Route

from desk.server import assets
from desk.server import job_routes as jobs
from desk.server import map_routes as maps
from desk.server import plan_routes as plan
from desk.server.replies import left, refused
from desk.workspace import Workspace
from survey.core import FirnlineError

_ROUTES = (
    Route("/", assets.page),
    Route("/static/{name:path}", assets.asset),
    Route("/api/site", maps.site),
    Route("/api/fields", maps.fields),
    Route("/api/style", maps.style),
    Route("/api/contours", maps.contours),
    Route("/api/heights", maps.heights, methods=["POST"]),
    Route("/tiles/{layer}/{zoom:int}/{column:int}/{row:int}.png", maps.tile),
    Route("/api/plan", plan.state),
    Route("/api/edit", plan.edit, methods=["POST"]),
    Route("/api/undo", plan.undo, methods=["POST"]),
    Route("/api/redo", plan.redo, methods=["POST"]),
    Route("/api/route", plan.route),
    Route("/api/error", plan.error),
    Route("/api/drive", plan.drive),
    Route("/api/export/{kind}", plan.export),
    Route("/api/background", maps.background, methods=["POST"]),
    Route("/api/dropped", plan.dropped_file, methods=["POST"]),
    Route("/api/variants", plan.table),
    Route("/api/variants", plan.add, methods=["POST"]),
    Route("/api/variants/{index:int}", plan.remove, methods=["DELETE"]),
    Route("/api/variants/{index:int}/beside", plan.beside),
    Route("/api/jobs", jobs.start, methods=["POST"]),
    Route("/api/jobs/{job}", jobs.cancel, methods=["DELETE"]),
    Route("/api/jobs/{job}/events", jobs.events),
    Route("/api/jobs/{job}/report/{name}", jobs.report),
    Route("/api/jobs/{job}/frame", jobs.frame),
    Route("/api/runs", maps.run_table),
    Route("/api/runs/{run}/minus/{other}", maps.run_difference),
    Route("/api/runs/{run}/layers/{layer}", maps.run_layer_of),
    Route("/api/runs/{run}/report/{name}", maps.run_report),
    Route("/api/measured", jobs.show),
    Route("/api/measured/{role}", jobs.take, methods=["POST"]),
    Route("/api/checkpoints", jobs.checkpoints, methods=["POST"]),
)


def desk_app(workspace: Workspace) -> Starlette:
    """Return the application, without the gate that keeps others out."""
    handlers = {FirnlineError: refused, ClientDisconnect: left, Exception: refused}
    app = Starlette(routes=list(_ROUTES), exception_handlers=handlers)
    app.state.workspace = workspace
    return app
