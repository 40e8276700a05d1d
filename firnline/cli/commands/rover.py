"""Commands of a rover on a link: ``upload``, ``download`` and ``rover``."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from firnline.actions.exporting import RouteOptions, route_with_surroundings
from firnline.actions.files import refuse_existing
from firnline.actions.interface import (
    DryRun,
    Json,
    Patience,
    Quiet,
    System,
    Url,
    end_dry_run,
    fact_line,
    needs_live_extra,
)
from firnline.cli.outcome import with_exit_codes
from firnline.cli.request import with_options_of

if TYPE_CHECKING:
    from live.link.address import LinkAddress
    from live.mission.autopilot_mission import AutopilotMission


_MISSION_FILES = (".plan", ".waypoints")


@dataclass(frozen=True, kw_only=True)
class UploadRequest(RouteOptions):
    """Options of the command."""

    source: Annotated[
        Path,
        typer.Argument(
            help="Route (.geojson .gpkg .gpx .kml .csv .wkt), run folder, or mission of a ground station (.plan .waypoints), "
            "which is sent as it is."
        ),
    ]
    url: Url
    rover: Annotated[
        int | None, typer.Option("--rover", help="Rover of a route of several, counted from 0.")
    ] = None
    system: System = None
    patience_s: Patience = 15.0
    most_items: Annotated[
        int | None,
        typer.Option(
            "--most-items",
            min=1,
            help="Largest number of items that the autopilot stores.  [default: ArduPilot 724, PX4 2000, others 65535]",
        ),
    ] = None
    starts: Annotated[
        bool, typer.Option("--start", help="Arm the rover and start the mission afterwards: it drives off.")
    ] = False
    dry_run: DryRun = False
    as_json: Json = False
    quiet: Quiet = False


@with_exit_codes
@with_options_of(UploadRequest)
def upload(request: UploadRequest) -> None:
    """Send a route to a rover over MAVLink, read it back and compare it item by item.

    For example:

      firnline upload route.geojson udp://127.0.0.1:14550 --area site.gpkg --dem prior.tif --speed 1.2

      firnline upload results/runs/srtm-ridge/latest udp://192.168.4.1:14550

      firnline upload drawn.plan serial:///dev/ttyUSB0:57600

    With an area the rover gets a fence as well, 10 m outside its outline, with the no-go zones. The rover exchanges its
    mission when the last item has come: an upload that ends early leaves the former one. Needs firnline[live].
    """
    with needs_live_extra():
        from live.link.address import LinkAddress

        address, mission = LinkAddress.parsed(request.url), _mission(request)
        if request.dry_run:
            end_dry_run([], _storable_facts(mission, request.most_items) | {"would be sent to": address.text})
        _print(*_upload(request, mission, address), as_json=request.as_json)


def _mission(request: UploadRequest) -> "AutopilotMission":
    """Read the mission of one rover."""
    from live.mission.autopilot_mission import AutopilotMission
    from survey.core.files.reading import existing_file
    from survey.interchange.route_formats import part_of_rover

    if request.source.suffix.lower() in _MISSION_FILES:
        request.refuse_stated("a mission of a ground station is sent as it is")
        return AutopilotMission.read(existing_file(request.source, "the mission"))
    route, around = route_with_surroundings(request.source, request)
    return AutopilotMission.of_route(part_of_rover(route, request.rover), around)


def _storable_facts(mission: "AutopilotMission", most_items: int | None) -> dict[str, object]:
    """Return the numbers of items, and which autopilots hold them; refuse what no vehicle would hold."""
    from live.link.vehicle import ARDUPILOT, NAMES, PX4
    from live.mission.items import FENCE, MISSION
    from live.mission.limits import limits_of, require_storable

    items, fence = mission.link_items(0), mission.fence_items
    require_storable(items, MISSION, most_items or limits_of(0).items)
    require_storable(fence, FENCE, most_items or limits_of(0).fence_corners)
    facts: dict[str, object] = {"items": len(items), "fence corners": len(fence)}
    for autopilot in (ARDUPILOT, PX4):
        most = limits_of(autopilot)
        holds = len(mission.link_items(autopilot)) <= most.items and len(fence) <= most.fence_corners
        words = f"at most {most.items} items and {most.fence_corners} fence corners by default"
        facts[NAMES[autopilot]] = f"{'holds it' if holds else 'does not hold it'}: {words}"
    return facts


def _upload(
    request: UploadRequest, mission: "AutopilotMission", address: "LinkAddress"
) -> tuple[dict[str, object], str]:
    """Upload, and return what the rover holds."""
    from time import perf_counter

    from firnline.cli.progress import counted
    from live.mission.upload import upload as sent

    began = perf_counter()
    with counted(quiet=request.quiet) as progress:
        report = sent(
            mission,
            address,
            patience_s=request.patience_s,
            system=request.system,
            most_items=request.most_items,
            starts=request.starts,
            progress=progress,
        )
    facts = {**report._asdict(), "seconds": round(perf_counter() - began, 2)}
    return facts, "" if mission.fence else "the fence was left as it is; name an area with --area to send one"


def _print(facts: dict[str, object], note: str, *, as_json: bool) -> None:
    if as_json:
        typer.echo(json.dumps(facts, indent=2))
        return
    typer.echo("uploaded, read back and equal")
    for name, value in facts.items():
        typer.echo(fact_line(name.replace("_", " "), value))
    if note:
        typer.echo(fact_line("note", note))


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
        from live.link.address import LinkAddress
        from live.mission.download import downloaded_route
        from survey.interchange.route_formats import write_plan

        address = LinkAddress.parsed(url)
        with counted(quiet=quiet) as progress:
            route = downloaded_route(address, crs, patience_s=patience_s, system=system, progress=progress)
        write_plan(route, out)
    typer.echo(f"{out} written: {len(route.path())} waypoints, {route.ground_length_m:.0f} m")


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
        from live.rover.drive import RoverSettings
        from live.rover.process import serve_rover
        from live.rover.radio import Radio

        terrain = None if dem is None else survey.Dem.read(dem)
        radio = Radio("127.0.0.1", port, loss, seed)
        typer.echo(f"the rover listens at udp://127.0.0.1:{radio.port}")
        settings = RoverSettings(speed_m_s=speed_m_s, range_m=range_m, seed=seed)
        serve_rover(radio, settings, terrain, hasten=hasten)
