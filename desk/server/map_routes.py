"""Routes of maps: the terrain with its tiles and heights, and the runs with their layers."""

from typing import Any

import numpy as np
from anyio import to_thread
from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from desk.server.replies import body_of, report_file
from desk.terrain.background import store_picture
from desk.terrain.pyramid import heights_at
from desk.terrain.shading import ELEVATION, LARGEST_SLOPE_DEG, SLOPE, TerrainStyle, legend_colours
from desk.terrain.tiles import LAYERS, contour_lines
from desk.workspace import Workspace
from survey.core import Bounds, ConfigError
from survey.core.run_folder import RunFolder

_MOST_PLACES = 2000


def site(request: Request) -> Response:
    """Answer with what the page needs to know once: CRS, tile grid, colours."""
    workspace: Workspace = request.app.state.workspace
    return JSONResponse(
        {
            "name": workspace.name,
            "terrain": workspace.terrain.name,
            "folder": str(workspace.folder),
            "notice": workspace.notice,
            "crs": {"name": workspace.crs.name, "code": ":".join(workspace.crs.to_authority() or ("", ""))},
            "grid_per_ground": workspace.map_scale,
            "tiles": workspace.tiles.grid(),
            "style": _plain(workspace.tiles.style),
            "height_colours": legend_colours(ELEVATION),
            "slope_colours": legend_colours(SLOPE),
            "largest_slope_deg": LARGEST_SLOPE_DEG,
            "background": workspace.tiles.background and workspace.tiles.background.about,
        }
    )


async def background(request: Request) -> Response:
    """Store a dropped picture of the ground beside the plan, and answer with what the page needs to show it."""
    workspace: Workspace = request.app.state.workspace
    tiles, name, content = workspace.tiles, request.query_params.get("name", ""), await request.body()
    stem = workspace.folder / workspace.name
    tiles.background = await to_thread.run_sync(
        store_picture, stem, name, content, workspace.crs, tiles.pyramid.bounds
    )
    return JSONResponse(tiles.background.about | {"title": name[:80]})


def style(request: Request) -> Response:
    """Answer with the colours that suit the bounds that are looked at, or with those that are shown where they still do."""
    workspace: Workspace = request.app.state.workspace
    best = TerrainStyle.of(workspace.tiles.pyramid, _bounds(request))
    shown = request.query_params.get("shown")
    if shown is not None and TerrainStyle.parsed(shown).still_fits(best):
        best = TerrainStyle.parsed(shown)
    return JSONResponse(_plain(best))


def contours(request: Request) -> Response:
    """Answer with the contour lines within bounds."""
    workspace: Workspace = request.app.state.workspace
    return JSONResponse(contour_lines(workspace.tiles.pyramid, _bounds(request)))


def _plain(style: TerrainStyle) -> dict[str, Any]:
    return {"text": style.text, "low_m": style.low_m, "high_m": style.high_m}


def _bounds(request: Request) -> Bounds:
    """Return the bounds that a request names [m]."""
    try:
        west, south, east, north = (float(part) for part in request.query_params.get("bounds", "").split(","))
    except ValueError as error:
        raise ConfigError(
            "the bounds are no four numbers; west, south, east, north were expected."
        ) from error
    if not (np.isfinite([west, south, east, north]).all() and west < east and south < north):
        raise ConfigError("the bounds are not in the order west, south, east, north.")
    return west, south, east, north


def fields(request: Request) -> Response:
    """Answer with the fields of the forms; the first time it takes as long as loading the planners."""
    from desk.plan.request import settings_fields

    del request
    return JSONResponse(settings_fields())


def tile(request: Request) -> Response:
    """Answer with a tile as PNG."""
    workspace: Workspace = request.app.state.workspace
    place = request.path_params
    if place["layer"] == "background" and workspace.tiles.background is not None:
        return _image(workspace.tiles.background.png(place["zoom"], place["column"], place["row"]))
    if place["layer"] not in LAYERS:
        return JSONResponse({"error": f"the layer {place['layer']!r} is none of {', '.join(LAYERS)}."}, 404)
    given = request.query_params.get("style")
    style = None if given is None else TerrainStyle.parsed(given)
    return _image(workspace.tiles.png(place["layer"], place["zoom"], place["column"], place["row"], style))


def _image(png: bytes | None) -> Response:
    if png is None:
        return JSONResponse({"error": "the map has no such tile."}, 404)
    return Response(png, media_type="image/png", headers={"cache-control": "private, max-age=3600"})


async def heights(request: Request) -> Response:
    """Answer with the terrain's heights at places; null where none is known."""
    workspace: Workspace = request.app.state.workspace
    places = _places((await body_of(request)).get("places"))
    found = await to_thread.run_sync(heights_at, workspace.tiles.pyramid, places)
    return JSONResponse({"heights_m": [None if np.isnan(h) else round(float(h), 3) for h in found]})


def _places(given: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    try:
        places = np.asarray(given, dtype=np.float64)
    except (ValueError, TypeError) as error:
        raise ConfigError("the places are no list of eastings and northings.") from error
    if places.ndim != 2 or places.shape[1] != 2 or not 0 < len(places) <= _MOST_PLACES:
        raise ConfigError(f"1 to {_MOST_PLACES} places of an easting and a northing were expected.")
    return places


def run_table(request: Request) -> Response:
    """Answer with the runs of the working folder and what they reached."""
    from desk.runs import run_row

    return JSONResponse({"runs": [run_row(name, run) for name, run in _runs(request).items()]})


def run_layer_of(request: Request) -> Response:
    """Answer with a map of a run."""
    from desk.runs import run_layer, run_named

    workspace: Workspace = request.app.state.workspace
    run = run_named(_runs(request), request.path_params["run"])
    return JSONResponse(run_layer(run, request.path_params["layer"], workspace.crs))


def run_difference(request: Request) -> Response:
    """Answer with the map of one run minus that of another one."""
    from desk.runs import difference_layer, run_named

    workspace: Workspace = request.app.state.workspace
    runs = _runs(request)
    one, other = (run_named(runs, request.path_params[name]) for name in ("run", "other"))
    return JSONResponse(difference_layer(one, other, workspace.crs))


def run_report(request: Request) -> Response:
    """Answer with a file of the report of a run."""
    from desk.runs import run_named

    run = run_named(_runs(request), request.path_params["run"])
    return report_file(run.folder("report") if run.has("report") else None, request.path_params["name"])


def _runs(request: Request) -> dict[str, RunFolder]:
    from desk.runs import found_runs

    workspace: Workspace = request.app.state.workspace
    return found_runs(workspace.folder, workspace.opened_run)
