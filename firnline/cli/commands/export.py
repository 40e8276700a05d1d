"""``firnline export``: convert a route, map, track, area or set of points to the format of another program."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated

import typer

from firnline.actions.exporting import RouteOptions, route_with_surroundings
from firnline.actions.files import companions_of_output, refuse_existing, with_companions
from firnline.actions.interface import DryRun, end_dry_run
from firnline.cli.outcome import with_exit_codes
from firnline.cli.request import with_options_of

if TYPE_CHECKING:
    import survey
    from survey.interchange.surroundings import Surroundings

_MISSIONS = (".plan", ".waypoints")


@dataclass(frozen=True, kw_only=True)
class ExportRequest(RouteOptions):
    """Options of the command; None stands for an option that was not given."""

    source: Annotated[
        Path, typer.Argument(help="File to convert, a run folder (its route), or a log of watch (.jsonl).")
    ]
    out: Annotated[
        Path,
        typer.Argument(
            help="File to write. Routes: .geojson .gpkg .gpx .kml .kmz .plan (QGroundControl) .waypoints .csv .wkt; "
            "maps: .tif .asc .nc; points: .csv .gpkg .las .laz .ply; tracks: .tum .txt (KITTI) .gpx .gpkg; areas: .kml .shp …; "
            "run folders and logs of watch: .mcap (path, landmarks, images and map for Foxglove and rerun)."
        ),
    ]
    rover: Annotated[
        int | None,
        typer.Option(
            "--rover",
            help="Only this rover's legs, counted from 0. Without it, missions of several rovers are written "
            "one file for each: survey_rover1.plan, survey_rover2.plan …",
        ),
    ] = None
    holds: Annotated[
        str | None,
        typer.Option(
            "--as",
            help="What the file holds: route, raster, points, track or area; by default found in its content.",
        ),
    ] = None
    force: Annotated[bool, typer.Option("--force", help="Replace an existing file.")] = False
    dry_run: DryRun = False

    def check(self) -> None:
        """Refuse outputs that exist or are inputs, and names that are not known."""
        from survey.core.errors import ConfigError

        inputs = with_companions([self.source, self.area, self.dem])
        refuse_existing([self.out], force=self.force, inputs=inputs)
        refuse_existing(companions_of_output(self.out), force=self.force, inputs=[self.source])
        if self.holds not in (None, "route", "raster", "points", "track", "area"):
            raise ConfigError(
                f"--as {self.holds} is not known; one of route, raster, points, track, area was expected."
            )


@with_exit_codes
@with_options_of(ExportRequest)
def export(request: ExportRequest) -> None:
    """Write a file in the format that the other's ending names.

    For example:

      firnline export route.geojson survey.plan --autopilot ardupilot --area site.kml --dem prior.tif --speed 1.2

      firnline export results/runs/srtm-ridge/latest route.gpx

      firnline export results/runs/short-drive/latest drive.mcap

      firnline export map.tif map.asc

      firnline export trajectory.csv track.gpx --as track --crs EPSG:32608
    """
    from survey.interchange.content import kind_of
    from survey.interchange.convert import convert

    request.check()
    source, out = request.source, request.out
    if out.suffix.lower() == ".mcap" and (source.is_dir() or source.suffix == ".jsonl"):
        request.refuse_stated("the file holds path, landmarks, images and map")
        _export_mcap(request)
        return
    kind = None if source.is_dir() else request.holds or kind_of(source, out)
    if kind is None or kind == "route":
        _export_route(request)
        return
    request.refuse_stated(f"{source.name} holds none")
    with _target(request) as target:
        convert(source, target, kind, crs=request.crs)  # type: ignore[arg-type]  # checked above
    typer.echo(f"{out} written")


@contextmanager
def _target(request: ExportRequest) -> Iterator[Path]:
    """Yield the file to write; for a dry run one in a folder that is removed, and the command ends."""
    if not request.dry_run:
        yield request.out
        return
    with TemporaryDirectory() as folder:
        yield Path(folder) / request.out.name
    end_dry_run([request.out])


def _export_mcap(request: ExportRequest) -> None:
    """Write the file of a run for viewers."""
    from firnline.actions.exporting import export_mcap

    if request.dry_run:
        end_dry_run([request.out])
    export_mcap(request.source, request.out)


def _export_route(request: ExportRequest) -> None:
    """Write a route; that of a run comes with the area and the terrain of the run."""
    route, around = route_with_surroundings(request.source, request)
    _write_route(route, request, around)


def _write_route(route: "survey.Route", request: ExportRequest, around: "Surroundings") -> None:
    """Write one file, or a mission for each rover, and name what was written."""
    from survey.interchange.route_formats import write_plan

    out, rover = request.out, request.rover
    parts = {out: rover}
    if rover is None and route.n_rovers > 1 and out.suffix.lower() in _MISSIONS:
        parts = {out.with_stem(f"{out.stem}_rover{k + 1}"): k for k in range(route.n_rovers)}
        refuse_existing(parts, force=request.force)
    around.check(route)
    if request.dry_run:
        end_dry_run(parts)
    for file, part in parts.items():
        write_plan(route, file, rover=part, around=around)
    typer.echo(f"{', '.join(str(file) for file in parts)} written")
