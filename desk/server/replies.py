"""Answers of the server: plain values as JSON, refusals as one sentence, files of the page and of reports."""

import logging
from pathlib import Path
from typing import Any

from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response

from desk.plan.history import OutdatedError
from desk.server.gate import SlowRequestError
from survey.core import CapacityError, ConfigError, FirnlineError, InputError, parse_json, printable

_REPORT_POLICY = "default-src 'none'; img-src 'self' data:; style-src 'unsafe-inline'; font-src data:; frame-ancestors 'none'; sandbox"
_REPORT_TYPES = {".html": "text/html; charset=utf-8", ".png": "image/png", ".svg": "image/svg+xml"}


class BusyError(FirnlineError):
    """More than is answered at once."""


_STATUS = (
    (OutdatedError, 409), (SlowRequestError, 408), (BusyError, 429), (CapacityError, 413), (FirnlineError, 422),
)  # fmt: skip
_NO_OBJECT = "the request is no JSON object; it was not made by this page."


def refused(request: Request, error: Exception) -> Response:
    """Answer an exception with one sentence; an internal fault is logged with its traceback."""
    for kind, status in _STATUS:
        if isinstance(error, kind):
            return JSONResponse({"error": printable(str(error))}, status)
    logging.getLogger("firnline").error("%s failed", request.url.path, exc_info=error)
    sentence = f"internal fault, {type(error).__name__}: {error}; report it with the log of the server."
    return JSONResponse({"error": printable(sentence)}, 500)


def left(request: Request, error: Exception) -> Response:
    """Answer a client that is gone before its request has arrived; it is no fault of the server."""
    del request, error
    return PlainTextResponse("The request did not arrive.", 400)


async def body_of(request: Request) -> dict[str, Any]:
    """Return the object that a request carries."""
    body = await request.body()
    try:
        content = parse_json(body, "the request")
    except InputError as error:
        raise ConfigError(_NO_OBJECT) from error
    if not isinstance(content, dict):
        raise ConfigError(_NO_OBJECT)
    return content


def report_file(folder: Path | None, name: str) -> Response:
    """Answer with a file of the report of a run; its scripts do not run here."""
    known = {} if folder is None else {file.name: file for file in folder.iterdir() if file.is_file()}
    file = known.get(name)
    if file is None or file.suffix not in _REPORT_TYPES:
        return PlainTextResponse("The report has no such file.", 404)
    headers = {"content-security-policy": _REPORT_POLICY}
    return Response(file.read_bytes(), media_type=_REPORT_TYPES[file.suffix], headers=headers)
