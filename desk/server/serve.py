"""Server of the desk: its routes, its start, and the gate in front of it.

`Gate` checks the address and the key of each request and limits its size, and gives every answer the same protective
headers. The socket is open on 127.0.0.1 only.
"""

import hmac
import logging
import secrets
import socket
import webbrowser
from asyncio import TimerHandle
from collections.abc import Callable, Iterable
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from threading import Thread
from typing import Any
from urllib.parse import parse_qs

import typer
import uvicorn
from anyio import current_time, move_on_after
from starlette.applications import Starlette
from starlette.requests import ClientDisconnect
from starlette.responses import HTMLResponse, PlainTextResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol

from desk.plan.history_file import HeldError, held
from desk.server import job_routes as jobs
from desk.server import map_routes as maps
from desk.server import plan_routes as plan
from desk.server import replies
from desk.server.replies import SlowRequestError, left, refused
from desk.terrain.background import open_background, stored_picture
from desk.workspace import Workspace, open_workspace, write_demo
from survey.core import CapacityError, FirnlineError, InputError

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


REQUEST_S = 30.0
"""Longest time that a request takes to arrive: its head, and its body [s]."""


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
            self._waiting = self.loop.call_later(REQUEST_S, self.timeout_keep_alive_handler)


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


LARGEST_BODY_BYTES = 64 * 2**20
"""Largest body of a request: a file that is dropped onto the page."""
_TOO_LARGE = f"at most {LARGEST_BODY_BYTES // 2**20} MB can be sent at once; choose a smaller file."
_READING = ("GET", "HEAD")
_METHODS = (*_READING, "POST", "DELETE")
_HEADERS = {
    "content-security-policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; connect-src 'self'; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "cache-control": "no-store",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
}
# A redirect would be the second half of a navigation from outside, for which a strict cookie is not sent.
_WELCOME = (
    '<!doctype html><html lang="en"><meta charset="utf-8"><title>firnline desk</title>'
    '<link rel="icon" href="data:,">'
    '<meta http-equiv="refresh" content="0;url=/"><p><a href="/">Open the desk</a></p></html>'
)


class TooLargeError(CapacityError):
    """A body beyond `LARGEST_BODY_BYTES`, found while it arrives."""


class Gate:
    """ASGI middleware that lets only the page of this server ask.

    The first visit needs a token, which is valid once and is exchanged for a cookie. The host has to be
    that of the server, against DNS rebinding. The origin, where the browser states one, has to be that of the
    page, against requests of other pages; requests that change something have to state it.

    `app`: what is behind the gate. `port`: port of the server on 127.0.0.1. `publish`: takes the address with the next
    token each time that one is used up; without it there is one token only. `images_from`: origin of a map service, the
    only other host that the page may ask for images; it learns the origin of the page, which tile servers want to know.

    >>> gate = Gate(lambda *_: None, 8000)
    >>> gate.address.startswith("http://127.0.0.1:8000/?token=")
    True
    """

    def __init__(
        self,
        app: ASGIApp,
        port: int,
        publish: Callable[[str], None] | None = None,
        images_from: str = "",
    ) -> None:
        self._app = app
        self._headers = dict(_HEADERS)
        if images_from:
            policy = _HEADERS["content-security-policy"].replace("blob:;", f"blob: {images_from};")
            self._headers |= {"content-security-policy": policy, "referrer-policy": "origin"}
        self._host = f"127.0.0.1:{port}"
        self._origin = f"http://{self._host}"
        self._cookie = f"firnline_desk_{port}"
        self._publish = publish
        self._token: str | None = self._new_token()
        self._session = secrets.token_urlsafe(32)

    def _new_token(self) -> str:
        token = secrets.token_urlsafe(32)
        if self._publish is not None:
            self._publish(f"{self._origin}/?token={token}")
        return token

    @property
    def address(self) -> str:
        """Address of the first visit, with the token."""
        return f"{self._origin}/?token={self._token}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or pass it on."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        if scope["type"] != "http":
            await send({"type": "websocket.close", "code": 1008})
            return
        answer = self._refusal(scope) or self._first_visit(scope) or self._without_session(scope)
        send = _protected(send, self._headers)
        if answer is not None:
            await answer(scope, receive, send)
            return
        await self._app(scope, _limited(receive), send)

    def _refusal(self, scope: Scope) -> Response | None:
        """Return an answer to a request from elsewhere, or of a kind that the page does not make."""
        headers = _headers(scope)
        if headers.get("host") != self._host:
            return PlainTextResponse(f"This server is {self._host}, not the host that was asked.", 421)
        if scope["method"] not in _METHODS:
            return PlainTextResponse(f"The method {scope['method']} is not used here.", 405)
        origin = headers.get("origin")
        states_no_origin = origin is None and scope["method"] in _READING
        if not (origin == self._origin or states_no_origin):
            return PlainTextResponse("The request comes from another page.", 403)
        if headers.get("sec-fetch-site", "none") not in ("same-origin", "none"):
            return PlainTextResponse("The request comes from another site.", 403)
        size = headers.get("content-length", "0")
        return _too_large() if not size.isdigit() or int(size) > LARGEST_BODY_BYTES else None

    def _first_visit(self, scope: Scope) -> Response | None:
        """Exchange the token for the cookie; a token is accepted once."""
        given = parse_qs(scope["query_string"].decode("latin-1")).get("token")
        if scope["path"] != "/" or scope["method"] != "GET" or not given:
            return None
        if self._token is None or not _equal(given[0], self._token):
            return None if self._has_session(scope) else _locked()
        self._token = None if self._publish is None else self._new_token()
        answer = HTMLResponse(_WELCOME)
        answer.set_cookie(self._cookie, self._session, path="/", httponly=True, samesite="strict")
        return answer

    def _without_session(self, scope: Scope) -> Response | None:
        return None if self._has_session(scope) else _locked()

    def _has_session(self, scope: Scope) -> bool:
        try:
            found = SimpleCookie(_headers(scope).get("cookie", "")).get(self._cookie)
        except CookieError:
            return False
        return found is not None and _equal(found.value, self._session)


def _locked() -> Response:
    return PlainTextResponse(
        "This desk belongs to another window; open the address that firnline desk printed, or start it again.",
        401,
    )


def _too_large() -> Response:
    return PlainTextResponse(_TOO_LARGE, 413)


def _headers(scope: Scope) -> dict[str, str]:
    """Return the headers; of one that stands twice, both values, which no check accepts."""
    found: dict[str, str] = {}
    pairs: Iterable[tuple[bytes, bytes]] = scope["headers"]
    for raw_name, raw in pairs:
        name, value = raw_name.decode("latin-1").lower(), raw.decode("latin-1")
        found[name] = f"{found[name]}, {value}" if name in found else value
    return found


def _equal(given: str, expected: str) -> bool:
    return hmac.compare_digest(given.encode("utf-8", "surrogateescape"), expected.encode())


def _limited(receive: Receive) -> Receive:
    """Count the bytes that arrive, and do not rely on the header; end a body that does not arrive in time."""
    arrived, is_complete = 0, False
    until = current_time() + REQUEST_S

    async def counted() -> Message:
        nonlocal arrived, is_complete
        if is_complete:
            return await receive()
        with move_on_after(until - current_time()) as waiting:
            message = await receive()
        if waiting.cancelled_caught:
            raise SlowRequestError(f"the request did not arrive within {REQUEST_S:g} s; send it again.")
        is_complete = not message.get("more_body", False)
        arrived += len(message.get("body", b""))
        if arrived > LARGEST_BODY_BYTES:
            raise TooLargeError(_TOO_LARGE)
        return message

    return counted


def _protected(send: Send, headers: dict[str, str]) -> Send:
    """Add the protective headers to an answer."""

    async def with_headers(message: Message) -> None:
        if message["type"] == "http.response.start":
            # Of two policies a browser obeys both: what an answer states itself stands alone.
            stated = {name.lower() for name, _ in message["headers"]}
            added = ((name.encode(), value.encode()) for name, value in headers.items())
            message["headers"] = [*message["headers"], *(pair for pair in added if pair[0] not in stated)]
        await send(message)

    return with_headers
