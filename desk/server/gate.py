"""The gate in front of the desk: the address and the key of each request, its size, the protective headers of each answer."""

import hmac
import secrets
from collections.abc import Callable, Iterable
from http.cookies import CookieError, SimpleCookie
from threading import Lock
from urllib.parse import parse_qs

from anyio import current_time, move_on_after
from starlette.responses import HTMLResponse, PlainTextResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from survey.core import CapacityError, FirnlineError

REQUEST_S = 30.0
"""Longest time that a request takes to arrive: its head, and its body [s]."""
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


class SlowRequestError(FirnlineError):
    """A request that does not arrive in time."""


class TooLargeError(CapacityError):
    """A body beyond `LARGEST_BODY_BYTES`, found while it arrives."""


class Gate:
    """ASGI middleware that lets only the page of this server ask.

    The first visit needs a token, which is valid once and is exchanged for a cookie. The host has to be
    that of the server, against DNS rebinding. The origin, where the browser states one, has to be that of the
    page, against requests of other pages; requests that change something have to state it.

    `app`: what is behind the gate. `port`: port of the server on 127.0.0.1. `images_from`: origin of a map service, the
    only other host that the page may ask for images; it learns the origin of the page, which tile servers want to know.
    There is one token, until `publish_to` takes what publishes further ones.

    >>> gate = Gate(lambda *_: None, 8000)
    >>> gate.address.startswith("http://127.0.0.1:8000/?token=")
    True
    """

    def __init__(
        self,
        app: ASGIApp,
        port: int,
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
        self._publish: Callable[[str], None] | None = None
        self._token: str | None = secrets.token_urlsafe(32)
        self._changing = Lock()
        self._session = secrets.token_urlsafe(32)

    def publish_to(self, publish: Callable[[str], None]) -> None:
        """Publish the address with the next token, now and each time that one is used up."""
        with self._changing:
            self._publish = publish
            self._token = self._token or secrets.token_urlsafe(32)
            publish(self.address)

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
        with self._changing:
            self._token = None
        if self._publish is not None:
            self.publish_to(self._publish)
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
