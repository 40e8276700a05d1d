"""Answers of the server: plain values as JSON, refusals as one sentence."""

import json
import logging
from typing import Any

from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from desk.plan.history import OutdatedError
from survey.core.errors import CapacityError, ConfigError, FirnlineError
from survey.core.text import printable

_STATUS = ((OutdatedError, 409), (CapacityError, 413), (FirnlineError, 422))
_MOST_DEPTH_ERROR = "the request is no JSON object; it was not made by this page."


def refused(request: Request, error: Exception) -> Response:
    """Answer an exception with one sentence; an internal fault is logged with its traceback."""
    for kind, status in _STATUS:
        if isinstance(error, kind):
            return JSONResponse({"error": printable(str(error))}, status)
    logging.getLogger("firnline").error("%s failed", request.url.path, exc_info=error)
    sentence = f"internal fault, {type(error).__name__}: {error}; report it with the log of the server."
    return JSONResponse({"error": printable(sentence)}, 500)


async def body_of(request: Request) -> dict[str, Any]:
    """Return the object that a request carries.

    Raises
    ------
    ConfigError
        It is no JSON object.
    """
    body = await request.body()
    try:
        content = json.loads(body)
    except (ValueError, RecursionError) as error:
        raise ConfigError(_MOST_DEPTH_ERROR) from error
    if not isinstance(content, dict):
        raise ConfigError(_MOST_DEPTH_ERROR)
    return content
