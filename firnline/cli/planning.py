"""Commands that plan a survey: ``plan``, ``reroute``, ``export`` and ``desk``."""

from pathlib import Path
from typing import Annotated

import typer

from firnline import actions
from firnline.actions.plan_request import PlanRequest
from firnline.actions.requests import RerouteRequest
from firnline.cli.missions import run_stages
from firnline.cli.outcome import with_exit_codes
from firnline.cli.request import DryRun, Json, Printing, Quiet, SurveyStep, perform, with_options_of
from survey.core import ConfigError, InputError


@with_exit_codes
@with_options_of(PlanRequest)
def plan(request: PlanRequest, printing: Printing) -> None:
    """Plan the route of a survey.

    Every setting of the sections planner, rover and fleet of a mission file can be set with --set. Ground
    that the rover cannot reach is left out; a warning gives its share, places and reasons. Distances are
    metres on the ground. An existing route or picture is replaced with --force only.

    For example:

      firnline plan site.geojson --prior srtm.tif --swaths 6 -o route.geojson

      firnline plan site.kml --prior srtm.tif --pattern wavy --spacing 50 --max-slope 20

      firnline plan area.kml --prior copernicus.tif -o plan.pdf

      firnline plan site.geojson --no-go map/no_go.tif --swaths 6

      firnline plan site.gpkg --spacing 20 --rovers 3 --set rover.turn_radius_m=2 --set rover.battery_j=4e6

      firnline plan site.gpkg --prior srtm.tif --require class-3 --probability 0.9

      firnline plan glacier.gpkg --prior glo30.tif --require class-3 --surface bare-ice --max-swaths 60

      firnline plan site.gpkg --prior srtm.tif --require class-3 --joint --set aids.base_station=true

      firnline plan site.gpkg --prior srtm.tif --require 0.1 --lidar lidar_spacing.toml

      firnline plan site.gpkg --prior srtm.tif --require class-3 --adaptive -o first_two.geojson

      firnline plan site.gpkg --prior srtm.tif --require class-3 --adaptive --driven so_far.geojson --measured so_far.csv

      firnline plan glacier.gpkg --prior glo30.tif --season 0.3 --dates 2026-05-01,2026-09-20 --surface bare-ice

      firnline plan mine.toml

      firnline plan mine.toml --require class-3
    """
    from firnline.actions.planning import mode_of

    if request.is_mission and (printing.dry_run or request.require is None):
        mode_of(request)
        run_stages(request.source, request, "plan", printing)
        return
    perform(actions.plan, request, dry_run=printing.dry_run, as_json=printing.as_json, quiet=printing.quiet)


@with_exit_codes
@with_options_of(actions.ExportRequest)
def export(request: actions.ExportRequest, dry_run: DryRun = False) -> None:
    """Write a file in the format that the other's ending names.

    For example:

      firnline export route.geojson survey.plan --autopilot ardupilot --area site.kml --dem prior.tif --speed 1.2

      firnline export results/runs/srtm-ridge/latest route.gpx

      firnline export results/runs/short-drive/latest drive.mcap

      firnline export results/runs/short-drive/latest drive --as ros2

      firnline export results/runs/short-drive/latest drive --as euroc

      firnline export results/runs/short-drive/latest site.sdf

      firnline export map.tif map.asc

      firnline export map.tif map.json --days 2026-05-01

      firnline export trajectory.csv track.gpx --as track --crs EPSG:32608
    """
    perform(actions.export, request, dry_run=dry_run)


@with_exit_codes
@with_options_of(RerouteRequest)
def reroute(
    request: RerouteRequest, dry_run: DryRun = False, as_json: Json = False, quiet: Quiet = False
) -> None:
    """Change the route of a rover around hazards in the points that it has seen.

    Steep ground, steps, and gaps whose bottom cannot be seen are avoided where the route ahead crosses them; parts of
    swaths that no way reaches, or only a long one, are left out.

    For example:

      firnline reroute route.geojson scans.laz --at 500010,6700020

      firnline reroute route.geojson scans.csv --max-slope 20 --base 1.5 --clearance 1.2 --area site.gpkg

    Written are route.geojson (what is left of the route), probability.tif (that the rover would stand on ground beyond
    the limit), reroute.json, and the picture reroute.png.
    """
    perform(actions.reroute, request, dry_run=dry_run, as_json=as_json, quiet=quiet)


@with_exit_codes
def desk(
    source: Annotated[
        Path | None,
        typer.Argument(
            help="Raster of prior elevations, plan of the desk (.desk.json, .desk.zip), mission file (.toml) or run folder; "
            "the latest plan of this folder when left out."
        ),
    ] = None,
    port: Annotated[
        int, typer.Option("--port", min=0, max=65535, help="Port on 127.0.0.1; a free one by default.")
    ] = 0,
    no_browser: Annotated[
        bool, typer.Option("--no-browser", help="Print the address only; open no browser.")
    ] = False,
    demo: Annotated[
        bool,
        typer.Option("--demo", help="Begin with real sample elevations, in the folder firnline-desk-demo."),
    ] = False,
    background: Annotated[
        str | None,
        typer.Option(
            "--background",
            help="Picture of the ground below the map: GeoTIFF or MBTiles; or https://HOST/{z}/{x}/{y}.png, or a WMS with "
            "layers=, whose host the page then asks for images.",
        ),
    ] = None,
) -> None:
    """Draw a survey on the map of its terrain, see the predicted error, and take the route along.

    The page runs on this machine alone: it answers to 127.0.0.1, needs no network, asks no other host unless
    --background names one, and writes into the folder of the terrain. The plan is stored there at every edit. Ctrl+C ends the server. Needs firnline[desk].

    For example:

      firnline desk srtm.tif

      firnline desk srtm.tif --background orthophoto.tif

      firnline desk --demo
    """
    if demo and source is not None:
        raise ConfigError(f"--demo brings its own terrain; leave out {source}.")
    try:
        from desk.server.serve import serve
    except ModuleNotFoundError as error:
        raise InputError(
            f"the desk needs {error.name}, which is not installed; in the folder of firnline, run pipx install --force '.[desk]'."
        ) from error
    serve(source, port=port, opens_browser=not no_browser, demo=demo, background=background)


COMMANDS = {SurveyStep.PLAN: (desk, plan, reroute), SurveyStep.READ: (export,)}
"""Commands by the step of a survey that they belong to."""
