"""``firnline export``: convert a route, map, track, area or set of points to the format of another program."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sim.cli.outcome import with_exit_codes
from sim.cli.outputs import companions_of_output, refuse_existing, with_companions

if TYPE_CHECKING:
    import survey
    from survey.interchange.surroundings import Surroundings

_MISSIONS = (".plan", ".waypoints")


@with_exit_codes
def export(
    source: Annotated[Path, typer.Argument(help="File to convert, or a run folder (its route).")],
    out: Annotated[
        Path,
        typer.Argument(
            help="File to write. Routes: .geojson .gpkg .gpx .kml .kmz .plan (QGroundControl) .waypoints .csv .wkt; "
            "maps: .tif .asc .nc; points: .csv .gpkg .las .laz .ply; tracks: .tum .txt (KITTI) .gpx .gpkg; areas: .kml .shp …"
        ),
    ],
    rover: Annotated[
        int | None,
        typer.Option(
            "--rover",
            help="Only this rover's legs, counted from 0. Without it, missions of several rovers are written "
            "one file for each: survey_rover1.plan, survey_rover2.plan …",
        ),
    ] = None,
    autopilot: Annotated[
        str | None, typer.Option("--autopilot", help="Missions: ardupilot or px4.  [default: px4]")
    ] = None,
    area: Annotated[
        Path | None,
        typer.Option(
            "--area",
            help="Area of the route: the fence of a .plan, 10 m outside its outline, with its no-go zones; polygons of "
            "KML. Of a run folder, its own.",
        ),
    ] = None,
    dem: Annotated[
        Path | None,
        typer.Option(
            "--dem",
            help="Elevation raster: heights of waypoints (GPX, KML, GeoJSON, missions) and of the home position. Of a run folder, its prior.",
        ),
    ] = None,
    speed: Annotated[
        float | None, typer.Option("--speed", help="Missions: speed that the rover is set to [m/s].")
    ] = None,
    returns: Annotated[
        bool, typer.Option("--return", help="Missions: end with a return to launch, straight to the start.")
    ] = False,
    holds: Annotated[
        str | None,
        typer.Option(
            "--as",
            help="What the file holds: route, raster, points, track or area; by default found in its content.",
        ),
    ] = None,
    crs: Annotated[
        str | None,
        typer.Option(
            "--crs",
            help="CRS of files that carry none; of areas and of plans of other tools, the one to write in, by default their UTM zone.",
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace a file that is there.")] = False,
) -> None:
    """Write a file in the format that the other's ending names.

    For example:

      firnline export route.geojson survey.plan --autopilot ardupilot --area site.kml --dem prior.tif --speed 1.2

      firnline export results/runs/srtm-ridge/latest route.gpx

      firnline export map.tif map.asc

      firnline export trajectory.csv track.gpx --as track --crs EPSG:32608
    """
    from survey.core.errors import ConfigError
    from survey.interchange.content import kind_of
    from survey.interchange.convert import convert

    refuse_existing([out], force=force, inputs=with_companions([source, area, dem]))
    refuse_existing(companions_of_output(out), force=force, inputs=[source])
    if holds not in (None, "route", "raster", "points", "track", "area"):
        raise ConfigError(
            f"--as {holds} is not known; one of route, raster, points, track, area was expected."
        )
    kind = None if source.is_dir() else holds or kind_of(source, out)
    if kind is not None and kind != "route":
        _refuse_route_options(autopilot, area, dem, speed, returns=returns)
        convert(source, out, kind, crs=crs)  # type: ignore[arg-type]  # checked above
        typer.echo(f"{out} written")
        return
    is_named = dem is not None
    route, area, dem = _route_of(source, area, dem, crs)
    around = _surroundings(route, autopilot, area, dem, speed, returns=returns)
    if source.is_dir() and not is_named:
        around = _with_known_heights(route, around)
    _write_route(route, out, rover, around, force=force)


def _refuse_route_options(
    autopilot: str | None, area: Path | None, dem: Path | None, speed: float | None, *, returns: bool
) -> None:
    from survey.core.errors import ConfigError

    given = {
        "--autopilot": autopilot,
        "--area": area,
        "--dem": dem,
        "--speed": speed,
        "--return": returns or None,
    }
    stated = [name for name, value in given.items() if value is not None]
    if stated:
        raise ConfigError(f"{', '.join(stated)} goes with routes; leave it out.")


def _route_of(
    source: Path, area: Path | None, dem: Path | None, crs: str | None
) -> "tuple[survey.Route, Path | None, Path | None]":
    """Return a route with the files of its area and terrain; a run has both."""
    import survey
    from survey.core.runs.store import RunFolder

    if not source.is_dir():
        return _read_route(source, crs), area, dem
    stage = RunFolder.find(source).verified("plan")
    return survey.Route.read(stage / "route.geojson"), area or stage / "area.gpkg", dem or stage / "prior.tif"


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


def _surroundings(
    route: "survey.Route",
    autopilot: str | None,
    area: Path | None,
    dem: Path | None,
    speed: float | None,
    *,
    returns: bool,
) -> "Surroundings":
    """Read what the export takes along, in the CRS of the route."""
    import numpy as np

    import survey
    from sim.cli.rasters import read_about
    from survey.core.errors import ConfigError
    from survey.interchange.surroundings import Surroundings

    if autopilot not in (None, "ardupilot", "px4"):
        raise ConfigError(f"--autopilot {autopilot} is not known; ardupilot or px4 was expected.")
    places = np.vstack([leg.xy for leg in route.legs])
    bounds = (*places.min(axis=0).tolist(), *places.max(axis=0).tolist())
    return Surroundings(
        None if area is None else survey.SurveyArea.read(area, crs=route.crs),
        None if dem is None else read_about(dem, bounds, route.crs, "the elevation raster"),
        "ardupilot" if autopilot == "ardupilot" else "px4",
        speed,
        returns,
    )


def _with_known_heights(route: "survey.Route", around: "Surroundings") -> "Surroundings":
    """Leave the prior of a run out, and print that, where it does not know the height of every waypoint."""
    from dataclasses import replace

    import numpy as np

    places = np.vstack([leg.xy for leg in route.legs])
    if around.terrain is None or np.isfinite(around.terrain.at(places)).all():
        return around
    typer.echo(
        "firnline: the prior of the run has voids on the route; heights are left out (--dem).", err=True
    )
    return replace(around, terrain=None)


def _write_route(
    route: "survey.Route", out: Path, rover: int | None, around: "Surroundings", *, force: bool
) -> None:
    """Write one file, or a mission for each rover, and name what was written."""
    from survey.interchange.route_formats import write_plan

    parts = {out: rover}
    if rover is None and route.n_rovers > 1 and out.suffix.lower() in _MISSIONS:
        parts = {out.with_stem(f"{out.stem}_rover{k + 1}"): k for k in range(route.n_rovers)}
        refuse_existing(parts, force=force)
    around.check(route)
    for file, part in parts.items():
        write_plan(route, file, rover=part, around=around)
    typer.echo(f"{', '.join(str(file) for file in parts)} written")
