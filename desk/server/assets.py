"""Files of the page."""

from functools import cache
from pathlib import Path

from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response

STATIC = Path(__file__).resolve().parents[1] / "static"
_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
}


@cache
def asset_files() -> dict[str, Path]:
    """Return the files that are served, by their address.

    Returns: addresses such as ``js/main.js``.
    """
    files = (file for file in STATIC.rglob("*") if file.suffix in _TYPES)
    return {file.relative_to(STATIC).as_posix(): file for file in files}


async def page(request: Request) -> Response:
    """Answer with the page."""
    del request
    return Response((STATIC / "index.html").read_bytes(), media_type=_TYPES[".html"])


async def asset(request: Request) -> Response:
    """Answer with a file of the page; no other name is looked for on the disk."""
    file = asset_files().get(request.path_params["name"])
    if file is None:
        return PlainTextResponse("The page has no such file.", 404)
    return Response(file.read_bytes(), media_type=_TYPES[file.suffix])
