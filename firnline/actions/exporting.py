"""Convert routes, maps, tracks, areas and points to the formats of other programs."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from firnline.actions.interface import needs_live_extra

if TYPE_CHECKING:
    import survey
    from survey.interchange.surroundings import Surroundings


@dataclass(frozen=True, kw_only=True)
class RouteOptions:
    """Options of what goes along with a route; None stands for an option that was not given."""

    autopilot: Annotated[
        str | None, typer.Option("--autopilot", help="Missions: ardupilot or px4.  [default: px4]")
    ] = None
    area: Annotated[
        Path | None,
        typer.Option(
            "--area",
            help="Area of the route: the fence of a mission, 10 m outside its outline, with its no-go zones; polygons of "
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
    crs: Annotated[
        str | None,
        typer.Option(
            "--crs",
            help="CRS of files that carry none; of areas and of plans of other tools, the one to write in, by default their UTM zone.",
        ),
    ] = None

    def refuse_stated(self, reason: str) -> None:
        """Refuse options that only routes have.

        Parameters
        ----------
        reason : str
            Why they do not apply.
        """
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
            raise ConfigError(f"{', '.join(stated)} goes with routes; {reason}, leave it out.")


def route_with_surroundings(source: Path, options: RouteOptions) -> "tuple[survey.Route, Surroundings]":
    """Read a route; that of a run comes with the area and the terrain of the run.

    Parameters
    ----------
    source : pathlib.Path
        File of a route, or a run folder.
    options : RouteOptions
        What the user named.

    Returns
    -------
    tuple of Route and Surroundings
        In the CRS of the route.
    """
    import survey
    from survey.core.runs.store import RunFolder

    if not source.is_dir():
        route = read_route(source, options.crs)
        return route, _surroundings(route, options)
    stage = RunFolder.find(source).verified("plan")
    route = survey.Route.read(stage / "route.geojson")
    of_run = replace(
        options, area=options.area or stage / "area.gpkg", dem=options.dem or stage / "prior.tif"
    )
    around = _surroundings(route, of_run)
    return route, around if options.dem is not None else _with_known_heights(route, around)


def read_route(source: Path, crs: str | None) -> "survey.Route":
    """Read a route of firnline as it is; a plan of another tool, or into a named CRS, in any format.

    Parameters
    ----------
    source : pathlib.Path
        Any format of routes.
    crs : str or None
        Projected CRS of the route.

    Returns
    -------
    Route
        Of one or several rovers.
    """
    import survey
    from survey.interchange.route_formats import read_plan
    from survey.io.vector import read_features

    if crs is None and source.suffix.lower() in (".geojson", ".gpkg", ".json"):
        columns = read_features(source, what="the route").attributes
        if "pattern" in columns:
            return survey.Route.read(source)
    return read_plan(source, crs)


def _surroundings(route: "survey.Route", options: RouteOptions) -> "Surroundings":
    """Read what the export takes along, in the CRS of the route."""
    import numpy as np

    import survey
    from firnline.actions.files import read_about
    from survey.core.errors import ConfigError
    from survey.interchange.surroundings import Surroundings

    area, dem, autopilot = options.area, options.dem, options.autopilot
    if autopilot not in (None, "ardupilot", "px4"):
        raise ConfigError(f"--autopilot {autopilot} is not known; ardupilot or px4 was expected.")
    places = np.vstack([leg.xy for leg in route.legs])
    bounds = (*places.min(axis=0).tolist(), *places.max(axis=0).tolist())
    return Surroundings(
        None if area is None else survey.SurveyArea.read(area, crs=route.crs),
        None if dem is None else read_about(dem, bounds, route.crs, "the elevation raster"),
        "ardupilot" if autopilot == "ardupilot" else "px4",
        options.speed_m_s,
        options.returns,
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


def export_mcap(source: Path, out: Path) -> None:
    """Write the MCAP file of a run, or of a survey that was watched.

    Parameters
    ----------
    source : pathlib.Path
        Run folder, or log of ``firnline watch``.
    out : pathlib.Path
        Ends in ``.mcap``.
    """
    from survey.core.runs.store import RunFolder

    with needs_live_extra():
        from live.export.drive_mcap import write_drive_mcap
        from live.export.run_mcap import write_run_mcap

        is_run = source.is_dir()
        counts = write_run_mcap(RunFolder.find(source), out) if is_run else write_drive_mcap(source, out)
    typer.echo(f"{out} written: " + ", ".join(f"{topic} {n}" for topic, n in counts.items()))
