"""``firnline upload``: send a route to a rover as a mission with its fence."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from firnline.cli.facts import end_dry_run, fact_line
from firnline.cli.live.options import Patience, System, Url, needs_live_extra
from firnline.cli.options import DryRun, Json, Quiet
from firnline.cli.outcome import with_exit_codes
from firnline.cli.request import with_options_of
from firnline.cli.route_source import RouteOptions, route_with_surroundings

if TYPE_CHECKING:
    from live.link import LinkAddress
    from live.mission_items import AutopilotMission

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
        from live.link import LinkAddress

        address, mission = LinkAddress.parsed(request.url), _mission(request)
        if request.dry_run:
            end_dry_run([], _storable_facts(mission, request.most_items) | {"would be sent to": address.text})
        _print(*_upload(request, mission, address), as_json=request.as_json)


def _mission(request: UploadRequest) -> "AutopilotMission":
    """Read the mission of one rover."""
    from live.mission_items import AutopilotMission
    from survey.core.files import existing_file
    from survey.interchange.route_formats import part_of_rover

    if request.source.suffix.lower() in _MISSION_FILES:
        request.refuse_stated("a mission of a ground station is sent as it is")
        return AutopilotMission.read(existing_file(request.source, "the mission"))
    route, around = route_with_surroundings(request.source, request)
    return AutopilotMission.of_route(part_of_rover(route, request.rover), around)


def _storable_facts(mission: "AutopilotMission", most_items: int | None) -> dict[str, object]:
    """Return the numbers of items, and which autopilots hold them; refuse what no vehicle would hold."""
    from live.link import ARDUPILOT, NAMES, PX4
    from live.mission_items import FENCE, MISSION, limits_of, require_storable

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
    from live.mission_transfer import upload as sent

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
