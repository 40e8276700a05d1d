"""Commands of a survey under way: ``upload``, ``download``, ``rover`` and ``watch``."""

from pathlib import Path
from typing import Annotated

import typer

from firnline import actions
from firnline.actions.interface import needs_live_extra
from firnline.actions.watching import WatchRequest
from firnline.cli.outcome import with_exit_codes
from firnline.cli.request import DryRun, Json, Quiet, SurveyStep, perform, print_result, with_options_of


@with_exit_codes
@with_options_of(actions.UploadRequest)
def upload(
    request: actions.UploadRequest, dry_run: DryRun = False, as_json: Json = False, quiet: Quiet = False
) -> None:
    """Send a route to a rover over MAVLink, read it back and compare it item by item.

    For example:

      firnline upload route.geojson udp://127.0.0.1:14550 --area site.gpkg --dem prior.tif --speed 1.2

      firnline upload results/runs/srtm-ridge/latest udp://192.168.4.1:14550

      firnline upload drawn.plan serial:///dev/ttyUSB0:57600

    With an area the rover gets a fence as well, 10 m outside its outline, with the no-go zones. The rover exchanges its
    mission when the last item has come: an upload that ends early leaves the former one. Needs firnline[live].
    """
    perform(actions.upload, request, dry_run=dry_run, as_json=as_json, quiet=quiet)


@with_exit_codes
@with_options_of(actions.DownloadRequest)
def download(request: actions.DownloadRequest, quiet: Quiet = False) -> None:
    """Read the mission that a rover holds, and write its waypoints as a route.

    For example:

      firnline download udp://127.0.0.1:14550 -o drawn.geojson

      firnline export drawn.geojson drawn.gpx

    Needs firnline[live].
    """
    perform(actions.download, request, quiet=quiet)


@with_exit_codes
def rover(
    dem: Annotated[
        Path | None, typer.Option("--dem", help="Elevation raster of the ground that it measures.")
    ] = None,
    port: Annotated[
        int, typer.Option("--port", min=0, max=65535, help="UDP port on 127.0.0.1; 0 for a free one.")
    ] = 14550,
    speed_m_s: Annotated[float, typer.Option("--speed", min=0.01, help="Speed [m/s].")] = 1.0,
    range_m: Annotated[
        float, typer.Option("--range", min=1.0, help="Distance of one battery charge [m].")
    ] = 12_000.0,
    loss: Annotated[
        float, typer.Option("--loss", min=0.0, max=0.99, help="Share of packets that the radio loses.")
    ] = 0.0,
    hasten: Annotated[
        float, typer.Option("--hasten", min=0.1, help="Seconds of driving in one second.")
    ] = 1.0,
    seed: Annotated[
        int, typer.Option("--seed", help="Seed of the errors of fixes and the losses of packets.")
    ] = 0,
) -> None:
    """Simulate a rover that missions can be uploaded to, in this process, until Ctrl+C.

    It follows its waypoints at constant speed from the first one on, stops at its fence, and reports fixes with drawn
    errors, attitude and battery. MAVSDK's servers hold its mission and its fence. Needs firnline[live].

    For example:

      firnline rover --dem srtm.tif --hasten 10
    """
    with needs_live_extra():
        import survey
        from live.rover import Radio, RoverSettings, serve_rover

        terrain = None if dem is None else survey.Dem.read(dem)
        radio = Radio("127.0.0.1", port, loss, seed)
        typer.echo(f"the rover listens at udp://127.0.0.1:{radio.port}")
        settings = RoverSettings(speed_m_s=speed_m_s, range_m=range_m, seed=seed)
        serve_rover(radio, settings, terrain, hasten=hasten)


@with_exit_codes
@with_options_of(WatchRequest)
def watch(request: WatchRequest, quiet: Quiet = False) -> None:
    """Follow a survey while it is driven: map, class with its probability, next swath, or stop.

    For example:

      firnline watch udp://127.0.0.1:14550 --area site.gpkg --route route.geojson --require 0.45 --log drive.jsonl

      firnline watch fixes.csv --area site.gpkg --route route.geojson --once

      firnline watch --replay drive.jsonl --log again.jsonl

    The survey may stop when the map meets the class with the probability. After every swath the covariance of the terrain
    is fitted again, and the swath is named after which fewest have to follow; between, the map is updated. Warnings are
    about a rover that is stuck or silent, and about the charge for the way home. Ends with exit code 5 where no further
    swath would reach the class. Telemetry needs firnline[live].
    """

    def show(line: str) -> None:
        if not quiet:
            typer.echo(line)

    print_result(actions.watch(request, show))


COMMANDS = {SurveyStep.VEHICLE: (upload, download, watch, rover)}
"""Commands by the step of a survey that they belong to."""
