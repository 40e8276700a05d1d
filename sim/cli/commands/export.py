"""``firnline export``: convert a route, map, track, area or set of points to the format of another program."""

from pathlib import Path
from typing import Annotated

import typer

from sim.cli.outcome import with_exit_codes
from sim.cli.outputs import companions_of_output, refuse_existing, with_companions


@with_exit_codes
def export(
    source: Annotated[Path, typer.Argument(help="File to convert, or a run folder (its route).")],
    out: Annotated[
        Path,
        typer.Argument(
            help="File to write. Routes: .geojson .gpkg .gpx .kml .plan (QGroundControl) .waypoints .csv .wkt; "
            "maps: .tif .asc .nc; points: .csv .gpkg .las .laz .ply; tracks: .tum .txt (KITTI) .gpx .gpkg; areas: .kml .shp …"
        ),
    ],
    rover: Annotated[
        int | None, typer.Option("--rover", help="Only this rover's legs, counted from 0.")
    ] = None,
    holds: Annotated[
        str | None,
        typer.Option(
            "--as", help="What the file holds where its ending leaves it open: route, points, track, area."
        ),
    ] = None,
    crs: Annotated[
        str | None, typer.Option("--crs", help="CRS of files that carry none; of areas, the one to write in.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace a file that is there.")] = False,
) -> None:
    """Write a file in the format that the other's ending names.

    For example:

      firnline export route.geojson survey.plan

      firnline export results/runs/srtm-ridge/latest route.gpx

      firnline export map.tif map.asc

      firnline export trajectory.csv track.gpx --as track --crs EPSG:32608
    """
    import survey
    from survey.core.errors import ConfigError
    from survey.core.runs.store import RunFolder
    from survey.interchange.convert import convert, kind_of
    from survey.interchange.route_formats import write_plan

    refuse_existing([out], force=force, inputs=with_companions([source]))
    refuse_existing(companions_of_output(out), force=force, inputs=[source])
    if holds not in (None, "route", "raster", "points", "track", "area"):
        raise ConfigError(
            f"--as {holds} is not known; one of route, raster, points, track, area was expected."
        )
    kind = None if source.is_dir() else holds or kind_of(source, out)
    if kind is not None and kind != "route":
        convert(source, out, kind, crs=crs)  # type: ignore[arg-type]  # checked above
        typer.echo(f"{out} written")
        return
    file = RunFolder.find(source).verified("plan") / "route.geojson" if source.is_dir() else source
    write_plan(survey.Route.read(file), out, rover=rover)
    typer.echo(f"{out} written")
