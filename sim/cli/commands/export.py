"""``firnline export``: convert a route, map, track, area or set of points to the format of another program."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated

import typer

from sim.cli.facts import end_dry_run
from sim.cli.options import DryRun
from sim.cli.outcome import with_exit_codes
from sim.cli.outputs import companions_of_output, refuse_existing, with_companions
from sim.cli.request import with_options_of

if TYPE_CHECKING:
    import survey
    from survey.interchange.surroundings import Surroundings

_MISSIONS = (".plan", ".waypoints")


@dataclass(frozen=True, kw_only=True)
class ExportRequest:
    """Options of the command; None stands for an option that was not given."""

    source: Annotated[Path, typer.Argument(help="File to convert, or a run folder (its route).")]
    out: Annotated[
        Path,
        typer.Argument(
            help="File to write. Routes: .geojson .gpkg .gpx .kml .kmz .plan (QGroundControl) .waypoints .csv .wkt; "
            "maps: .tif .asc .nc; points: .csv .gpkg .las .laz .ply; tracks: .tum .txt (KITTI) .gpx .gpkg; areas: .kml .shp …"
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
    autopilot: Annotated[
        str | None, typer.Option("--autopilot", help="Missions: ardupilot or px4.  [default: px4]")
    ] = None
    area: Annotated[
        Path | None,
        typer.Option(
            "--area",
            help="Area of the route: the fence of a .plan, 10 m outside its outline, with its no-go zones; polygons of "
            "KML. Of a run folder, its own.",
        ),
    ] = None
    dem: Annotated[
        Path | None,
        typer.Option(
            "--dem",
            help="Elevation raster: heights of waypoints (GPX, KML, GeoJSON, missions) and of the home position. Of a run folder, its prior.",
        ),
    ] = None
    speed_m_s: Annotated[
        float | None, typer.Option("--speed", help="Missions: speed that the rover is set to [m/s].")
    ] = None
    returns: Annotated[
        bool, typer.Option("--return", help="Missions: end with a return to launch, straight to the start.")
    ] = False
    holds: Annotated[
        str | None,
        typer.Option(
            "--as",
            help="What the file holds: route, raster, points, track or area; by default found in its content.",
        ),
    ] = None
    crs: Annotated[
        str | None,
        typer.Option(
            "--crs",
            help="CRS of files that carry none; of areas and of plans of other tools, the one to write in, by default their UTM zone.",
        ),
    ] = None
    force: Annotated[bool, typer.Option("--force", help="Replace a file that is there.")] = False
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

    def refuse_route_options(self) -> None:
        """Refuse options that only routes have."""
        from survey.core.errors import ConfigError

        given = {
            "--autopilot": self.autopilot,
            "--area": self.area,
            "--dem": self.dem,
            "--speed": self.speed_m_s,
            "--return": self.returns or None,
        }
        stated = [name for name, value in given.items() if value is not None]
        if stated:
            raise ConfigError(f"{', '.join(stated)} goes with routes; leave it out.")


@with_exit_codes
@with_options_of(ExportRequest)
def export(request: ExportRequest) -> None:
    """Write a file in the format that the other's ending names.

    For example:

      firnline export route.geojson survey.plan --autopilot ardupilot --area site.kml --dem prior.tif --speed 1.2

      firnline export results/runs/srtm-ridge/latest route.gpx

      firnline export map.tif map.asc

      firnline export trajectory.csv track.gpx --as track --crs EPSG:32608
    """
    from survey.interchange.content import kind_of
    from survey.interchange.convert import convert

    request.check()
    source, out = request.source, request.out
    kind = None if source.is_dir() else request.holds or kind_of(source, out)
    if kind is None or kind == "route":
        _export_route(request)
        return
    request.refuse_route_options()
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


def _export_route(request: ExportRequest) -> None:
    """Write a route; that of a run comes with the area and the terrain of the run."""
    import survey
    from survey.core.runs.store import RunFolder

    if not request.source.is_dir():
        route = _read_route(request.source, request.crs)
        _write_route(route, request, _surroundings(route, request))
        return
    stage = RunFolder.find(request.source).verified("plan")
    route = survey.Route.read(stage / "route.geojson")
    of_run = replace(
        request, area=request.area or stage / "area.gpkg", dem=request.dem or stage / "prior.tif"
    )
    around = _surroundings(route, of_run)
    _write_route(route, request, around if request.dem is not None else _with_known_heights(route, around))


def _read_route(source: Path, crs: str | None) -> "survey.Route":
    """Read a route of firnline as it is; a plan of another tool, or into a named CRS, in any format."""
    import survey
    from survey.interchange.route_formats import read_plan
    from survey.io.vector import read_features

    if crs is None and source.suffix.lower() in (".geojson", ".gpkg", ".json"):
        columns = read_features(source, what="the route").attributes
        if "pattern" in columns:
            return survey.Route.read(source)
    return read_plan(source, crs)


def _surroundings(route: "survey.Route", request: ExportRequest) -> "Surroundings":
    """Read what the export takes along, in the CRS of the route."""
    import numpy as np

    import survey
    from sim.cli.rasters import read_about
    from survey.core.errors import ConfigError
    from survey.interchange.surroundings import Surroundings

    area, dem, autopilot = request.area, request.dem, request.autopilot
    if autopilot not in (None, "ardupilot", "px4"):
        raise ConfigError(f"--autopilot {autopilot} is not known; ardupilot or px4 was expected.")
    places = np.vstack([leg.xy for leg in route.legs])
    bounds = (*places.min(axis=0).tolist(), *places.max(axis=0).tolist())
    return Surroundings(
        None if area is None else survey.SurveyArea.read(area, crs=route.crs),
        None if dem is None else read_about(dem, bounds, route.crs, "the elevation raster"),
        "ardupilot" if autopilot == "ardupilot" else "px4",
        request.speed_m_s,
        request.returns,
    )


def _with_known_heights(route: "survey.Route", around: "Surroundings") -> "Surroundings":
    """Leave the prior of a run out, and print that, where it does not know the height of every waypoint."""
    import numpy as np

    places = np.vstack([leg.xy for leg in route.legs])
    if around.terrain is None or np.isfinite(around.terrain.at(places)).all():
        return around
    typer.echo(
        "firnline: the prior of the run has voids on the route; heights are left out (--dem).", err=True
    )
    return replace(around, terrain=None)


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
