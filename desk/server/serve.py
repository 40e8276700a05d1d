"""Application of the desk, its socket on 127.0.0.1, and the browser."""

import logging
import socket
import webbrowser
from pathlib import Path
from threading import Thread

import typer
import uvicorn
from starlette.applications import Starlette
from starlette.routing import Route

from desk.server import job_routes as jobs
from desk.server import map_routes as maps
from desk.server import plan_routes as plan
from desk.server import replies
from desk.server.gate import Gate
from desk.server.replies import refused
from desk.sources import open_workspace, write_demo
from desk.workspace import Workspace
from survey.core.errors import FirnlineError, InputError

_ROUTES = (
    Route("/", replies.page),
    Route("/static/{name:path}", replies.asset),
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
    Route("/api/dropped", plan.dropped_file, methods=["POST"]),
    Route("/api/variants", plan.table),
    Route("/api/variants", plan.add, methods=["POST"]),
    Route("/api/variants/{index:int}", plan.remove, methods=["DELETE"]),
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
    handlers = {FirnlineError: refused, Exception: refused}
    app = Starlette(routes=list(_ROUTES), exception_handlers=handlers)
    app.state.workspace = workspace
    return app


_DEMO_FOLDER = Path("firnline-desk-demo")


def serve(source: Path | None, *, port: int = 0, opens_browser: bool = True, demo: bool = False) -> None:
    """Serve the desk until it is interrupted."""
    with open_workspace(write_demo(_DEMO_FOLDER) if demo else source, Path.cwd()) as workspace:
        listener = _listener(port)
        gate = Gate(desk_app(workspace), listener.getsockname()[1])
        typer.echo(f"firnline desk  {gate.address}")
        typer.echo(f"plan           {workspace.store.path} (stored at every edit); Ctrl+C ends the desk")
        if opens_browser:
            webbrowser.open(gate.address)
        config = uvicorn.Config(
            gate,
            log_level=logging.WARNING,
            access_log=False,
            server_header=False,
            timeout_graceful_shutdown=2,
        )
        Thread(target=_load_planners, name="desk-loading", daemon=True).start()
        uvicorn.Server(config).run(sockets=[listener])


def _load_planners() -> None:
    """Import what the first plan needs, and load what it has compiled, while the page is opened."""
    import desk.plan.request
    import desk.plan.summary  # noqa: F401
    from desk.plan.live import plan_once

    plan_once()


def _listener(port: int) -> socket.socket:
    """Return a listening socket of this machine alone."""
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind(("127.0.0.1", port))
    except OSError as error:
        listener.close()
        raise InputError(
            f"port {port} of 127.0.0.1 cannot be used ({error.strerror}); choose another --port, or none."
        ) from error
    listener.listen(128)
    return listener
