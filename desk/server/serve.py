"""Start of the desk on a socket of 127.0.0.1."""

import logging
import socket
import webbrowser
from asyncio import TimerHandle
from collections.abc import Callable
from pathlib import Path
from threading import Thread
from typing import Any

import typer
import uvicorn
from starlette.types import ASGIApp
from uvicorn.protocols.http.h11_impl import H11Protocol

from desk.plan.lock import HeldError, held
from desk.server import gate as gates
from desk.server.app import desk_app
from desk.server.gate import Gate
from desk.terrain.background import open_background, stored_picture
from desk.workspace import Workspace, open_workspace, write_demo
from survey.core import InputError

_DEMO_FOLDER = Path("firnline-desk-demo")


def serve(
    source: Path | None,
    *,
    port: int = 0,
    opens_browser: bool = True,
    demo: bool = False,
    background: str | None = None,
) -> None:
    """Serve the desk until it is interrupted.

    `background`: picture of the ground or address of a map service; without one, the picture that was dropped before.
    """
    with open_workspace(write_demo(_DEMO_FOLDER) if demo else source, Path.cwd()) as workspace:
        dropped = stored_picture(workspace.folder / workspace.name)
        named = background or (dropped and str(dropped))
        if named:
            tiles = workspace.tiles
            tiles.background = open_background(named, workspace.crs, tiles.pyramid.bounds)
        try:
            with held(workspace.store.path) as publish:
                _serve(workspace, port, publish, opens_browser=opens_browser)
        except HeldError as other:
            typer.echo(f"the plan {workspace.store.path} is open already; join it at  {other}")
            if opens_browser:
                webbrowser.open(str(other))


def _serve(workspace: Workspace, port: int, publish: Callable[[str], None], *, opens_browser: bool) -> None:
    listener = _listener(port)
    shown = workspace.tiles.background
    gate = Gate(desk_app(workspace), listener.getsockname()[1], publish, shown.host if shown else "")
    typer.echo(f"firnline desk  {gate.address}")
    typer.echo(f"plan           {workspace.store.path} (stored at every edit); Ctrl+C ends the desk")
    if shown is not None and shown.host:
        typer.echo(f"background     the page asks {shown.host} for images, and no other host")
    if workspace.notice:
        typer.echo(f"note           {workspace.notice}")
    if opens_browser:
        webbrowser.open(gate.address)
    Thread(target=_load_planners, name="desk-loading", daemon=True).start()
    uvicorn.Server(server_config(gate)).run(sockets=[listener])


def server_config(gate: ASGIApp) -> uvicorn.Config:
    """Return the settings of the server."""
    return uvicorn.Config(
        gate,
        http=PatientProtocol,
        log_level=logging.WARNING,
        access_log=False,
        server_header=False,
        timeout_graceful_shutdown=2,
    )


class PatientProtocol(H11Protocol):
    """HTTP/1.1 that closes a connection on which the head of a request does not arrive in time."""

    _waiting: TimerHandle | None = None

    def connection_made(self, transport: Any) -> None:
        """Begin to wait for the first request."""
        super().connection_made(transport)
        self._await_head()

    def data_received(self, data: bytes) -> None:
        """Go on waiting while the head of a request is incomplete."""
        super().data_received(data)
        self._await_head()

    def _await_head(self) -> None:
        if self.cycle is not None and not self.cycle.response_complete:
            if self._waiting is not None:
                self._waiting.cancel()
            self._waiting = None
        elif self._waiting is None:
            self._waiting = self.loop.call_later(gates.REQUEST_S, self.timeout_keep_alive_handler)


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
