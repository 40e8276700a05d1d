"""``firnline download``: read the mission of a rover as a route."""

from pathlib import Path
from typing import Annotated

import typer

from firnline.cli.live.options import Patience, System, Url, needs_live_extra
from firnline.cli.options import Quiet
from firnline.cli.outcome import with_exit_codes
from firnline.cli.outputs import refuse_existing


@with_exit_codes
def download(
    url: Url,
    out: Annotated[
        Path, typer.Option("--out", "-o", help="Route to write: .geojson .gpkg .gpx .kml .csv .wkt .plan …")
    ] = Path("downloaded.geojson"),
    crs: Annotated[
        str | None, typer.Option("--crs", help="Projected CRS of the route; its UTM zone when left out.")
    ] = None,
    system: System = None,
    patience_s: Patience = 15.0,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing file.")] = False,
    quiet: Quiet = False,
) -> None:
    """Read the mission that a rover holds, and write its waypoints as a route.

    For example:

      firnline download udp://127.0.0.1:14550 -o drawn.geojson

      firnline export drawn.geojson drawn.gpx

    Needs firnline[live].
    """
    refuse_existing([out], force=force, inputs=[])
    with needs_live_extra():
        from firnline.cli.progress import counted
        from live.link import LinkAddress
        from live.mission_transfer import downloaded_route
        from survey.interchange.route_formats import write_plan

        address = LinkAddress.parsed(url)
        with counted(quiet=quiet) as progress:
            route = downloaded_route(address, crs, patience_s=patience_s, system=system, progress=progress)
        write_plan(route, out)
    typer.echo(f"{out} written: {len(route.path())} waypoints, {route.ground_length_m:.0f} m")
