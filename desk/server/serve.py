"""Server of the desk on a socket of 127.0.0.1: the page is served at once, while the terrain and its plan are opened."""

import logging
import signal
import socket
import webbrowser
from asyncio import TimerHandle, shield, wrap_future
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import ExitStack, contextmanager, suppress
from functools import cache, partial
from pathlib import Path
from threading import Event, Thread
from typing import TYPE_CHECKING, Any, NamedTuple

import typer
import uvicorn
from starlette.applications import Starlette
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol

from desk.plan.lock import LOCK_SUFFIX, HeldError, held
from desk.server import gate as gates
from desk.server.gate import Gate
from survey.core import FirnlineError, InputError, printable

if TYPE_CHECKING:
    from desk.workspace import Workspace

_DEMO_FOLDER = Path("firnline-desk-demo")
_PLANS = "*.desk.json"
# Requests that a page is built with, and the longest time to wait for any other before the planners are loaded [s].
_SHOWN_WITH, _SHOWN_S = ("/api/site", "/api/plan", "/tiles/"), 2.0
# Longest time that a page which was opened already has to show why nothing can be opened [s].
_LAST_WORD_S = 5.0


STATIC = Path(__file__).resolve().parents[1] / "static"
_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
}


@cache
def asset_files() -> dict[str, Path]:
    """Return the files that are served, by their address, such as ``js/main.js``."""
    files = (file for file in STATIC.rglob("*") if file.suffix in _TYPES)
    return {file.relative_to(STATIC).as_posix(): file for file in files}


async def page(request: Request) -> Response:
    """Answer with the page, which names all its modules, so that the browser need not read one to find the next."""
    del request
    modules = (name for name in asset_files() if name.startswith("js/"))
    links = "\n".join(f'<link rel="modulepreload" href="/static/{name}">' for name in sorted(modules))
    text = (STATIC / "index.html").read_text(encoding="utf-8").replace("</head>", f"{links}\n</head>", 1)
    return Response(text, media_type=_TYPES[".html"])


async def asset(request: Request) -> Response:
    """Answer with a file of the page; no other name is looked for on the disk."""
    file = asset_files().get(request.path_params["name"])
    if file is None:
        return PlainTextResponse("The page has no such file.", 404)
    return Response(file.read_bytes(), media_type=_TYPES[file.suffix])


_FILES = (Route("/", page), Route("/static/{name:path}", asset))


def desk_app(workspace: "Workspace") -> Starlette:
    """Return the application over a workspace, without the gate that keeps others out; its imports take half a second."""
    from desk.server import job_routes as jobs
    from desk.server import map_routes as maps
    from desk.server import plan_routes as plan
    from desk.server.replies import left, refused

    routes = [
        *_FILES,
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
    ]
    handlers = {FirnlineError: refused, ClientDisconnect: left, Exception: refused}
    app = Starlette(routes=routes, exception_handlers=handlers)
    app.state.workspace = workspace
    return app


class Opened(NamedTuple):
    """What one desk serves: its workspace, the application over it, and what publishes the address to the next desk."""

    workspace: "Workspace"
    app: ASGIApp
    publish: Callable[[str], None]

    @property
    def images_from(self) -> str:
        """Origin of the map service that the page may ask for images; empty without one."""
        shown = self.workspace.tiles.background
        return shown.host if shown else ""


class Opening:
    """ASGI application of a desk that is being opened: each part of it answers as soon as it can.

    The page and its files are served at once. What the page is built with waits for the workspace (`opened`), and all
    else for the packages of the planners (`loaded`), which threads of several requests must not import at the same time.
    A request that waits for a workspace which cannot be opened is refused with the reason.
    """

    def __init__(self) -> None:
        self.opened: Future[Opened] = Future()
        self.loaded: Future[None] = Future()
        self.has_refused, self.has_shown = Event(), Event()
        self._files = Starlette(routes=list(_FILES))

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request."""
        path = scope.get("path", "/")
        if scope["type"] != "http" or path == "/" or path.startswith("/static/"):
            await self._files(scope, receive, send)
            return
        try:
            app = (await shield(wrap_future(self.opened))).app
        except Exception as error:  # whatever it is, the command ends with it
            await JSONResponse({"error": printable(str(error))}, 422)(scope, receive, send)
            self.has_refused.set()
            return
        if not path.startswith(_SHOWN_WITH):
            self.has_shown.set()
            await shield(wrap_future(self.loaded))
        await app(scope, receive, send)


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
    opens_surely = background is None and _opens_surely(_DEMO_FOLDER if demo else source, demo)
    with ExitStack() as files:
        open_source = partial(_open, files, source, demo, background)
        try:
            _serve(open_source, port, opens_browser=opens_browser, opens_surely=opens_surely)
        except HeldError as other:
            typer.echo(str(other))
            if opens_browser:
                webbrowser.open(other.address)


def _opens_surely(source: Path | None, demo: bool) -> bool:
    """Return whether a page may be shown before the source is opened: it exists, and no other desk holds a plan near it."""
    folder = Path.cwd() if source is None else source if demo else source.parent
    exists = any(folder.glob(_PLANS)) if source is None else demo or source.exists()
    return exists and not any(any(place.glob(f"*{LOCK_SUFFIX}")) for place in (folder, Path.cwd()))


def _open(files: ExitStack, source: Path | None, demo: bool, background: str | None) -> Opened:
    """Open the workspace, its background and its lock; `files` closes them."""
    from desk.terrain.background import open_background, stored_picture
    from desk.workspace import open_workspace, write_demo

    workspace = files.enter_context(open_workspace(write_demo(_DEMO_FOLDER) if demo else source, Path.cwd()))
    dropped = stored_picture(workspace.folder / workspace.name)
    named = background or (dropped and str(dropped))
    if named:
        tiles = workspace.tiles
        tiles.background = open_background(named, workspace.crs, tiles.pyramid.bounds)
    publish = files.enter_context(held(workspace.store.path))
    return Opened(workspace, desk_app(workspace), publish)


def _serve(open_source: Callable[[], Opened], port: int, *, opens_browser: bool, opens_surely: bool) -> None:
    """Serve until the server is interrupted; where the source opens surely, its page is served before."""
    app, images_from = Opening(), ""
    if not opens_surely:
        app.opened.set_result(open_source())
        images_from = app.opened.result().images_from
    listener = _listener(port)
    gate = Gate(app, listener.getsockname()[1], images_from=images_from)
    server = uvicorn.Server(server_config(gate))
    with _running(server, listener) as serving:
        typer.echo(f"firnline desk  {gate.address}")
        if opens_browser:
            webbrowser.open(gate.address)
        if opens_surely:
            try:
                app.opened.set_result(open_source())
            except Exception as error:
                app.opened.set_exception(error)
                app.has_refused.wait(_LAST_WORD_S if opens_browser else 0.0)
                raise
        opened = app.opened.result()
        gate.publish_to(opened.publish)
        _describe(opened)
        if not server.should_exit:  # by an interrupt that a callback swallowed
            app.has_shown.wait(_SHOWN_S)
            Thread(target=_load_planners, args=(app.loaded,), name="desk-loading", daemon=True).start()
        serving.join()


@contextmanager
def _running(server: uvicorn.Server, listener: socket.socket) -> Iterator[Thread]:
    """Run a server in a thread until an interrupt; the main thread is left to GDAL, whose settings then hold in all threads."""
    serving = Thread(target=server.run, kwargs={"sockets": [listener]}, name="desk-server")

    def stop(*_: object) -> None:
        server.should_exit = True  # a callback that is interrupted may swallow the exception
        raise KeyboardInterrupt

    before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    serving.start()
    try:
        with suppress(KeyboardInterrupt):
            yield serving
    finally:
        server.should_exit = True
        serving.join()
        for number, handler in before.items():
            signal.signal(number, handler)


def _describe(opened: Opened) -> None:
    workspace = opened.workspace
    typer.echo(f"plan           {workspace.store.path} (stored at every edit); Ctrl+C ends the desk")
    if opened.images_from:
        typer.echo(f"background     the page asks {opened.images_from} for images, and no other host")
    if workspace.notice:
        typer.echo(f"note           {workspace.notice}")


def server_config(gate: ASGIApp) -> uvicorn.Config:
    """Return the settings of the server."""
    return uvicorn.Config(
        gate,
        http=PatientProtocol,
        ws="none",
        log_level=logging.CRITICAL,  # faults are logged where they are answered; requests that an interrupt ends are none
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


def _load_planners(loaded: "Future[None]") -> None:
    """Import what requests need, say so, and load what the first plan has compiled."""
    try:
        import desk.measured
        import desk.plan.request
        import desk.plan.summary
        import desk.runs  # noqa: F401
        from desk.plan.live import plan_once
    finally:
        loaded.set_result(None)
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
