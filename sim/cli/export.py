"""``firnline export``: a planned route for a GIS, a hand-held GPS or an autopilot."""

from pathlib import Path
from typing import Annotated

import typer

from sim.cli.outcome import refusals_told


@refusals_told
def export(
    source: Annotated[Path, typer.Argument(help="Route file, or a run folder that holds one.")],
    out: Annotated[
        Path,
        typer.Argument(
            help="File to write: .geojson .gpkg .gpx .kml .plan (QGroundControl) .waypoints .csv .wkt"
        ),
    ],
    rover: Annotated[
        int | None, typer.Option("--rover", help="Only this rover's legs, counted from 0.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace a file that is there.")] = False,
) -> None:
    """Write a route in the format that the file's ending names.

    For example:

      firnline export route.geojson survey.plan

      firnline export results/runs/srtm-ridge/latest route.gpx
    """
    import survey
    from survey.errors import InputError
    from survey.io.plans import write_plan
    from survey.store import RunFolder

    if out.exists() and not force:
        raise InputError(f"{out} exists; choose another name or add --force to replace it.")
    file = RunFolder.find(source).folder("plan") / "route.geojson" if source.is_dir() else source
    write_plan(survey.Route.read(file), out, rover=rover)
    typer.echo(f"{out} written")
