"""Start of the desk: a socket on 127.0.0.1, the server, the browser."""

import logging
import socket
import webbrowser
from pathlib import Path
from threading import Thread

import typer
import uvicorn

from desk.demo import write_demo
from desk.server.app import desk_app
from desk.server.gate import Gate
from desk.sources import open_workspace
from survey.core.errors import InputError

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
    import desk.plan.error_map
    import desk.plan.fields
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
