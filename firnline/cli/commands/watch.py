"""``firnline watch``: the map, its class and the next swath while a rover drives."""

from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from firnline.actions.files import refuse_existing, with_companions
from firnline.actions.interface import Patience, Quiet, System, needs_live_extra
from firnline.actions.watching import closing_line, text_of
from firnline.cli.outcome import NOT_MET, with_exit_codes
from firnline.cli.request import with_options_of

if TYPE_CHECKING:
    from live.watch.survey_watch import SurveyWatch


@dataclass(frozen=True, kw_only=True)
class WatchRequest:
    """Options of the command."""

    source: Annotated[
        str | None,
        typer.Argument(
            help="Telemetry (udp://HOST:PORT, udpin://…, tcp://…, serial:///dev/…), or a file that grows: points (.csv) or the "
            "log of a receiver (.nmea .txt .ubx), or the folder of a recording."
        ),
    ] = None
    area: Annotated[Path | None, typer.Option("--area", help="Area that is mapped.")] = None
    route: Annotated[
        Path | None,
        typer.Option("--route", help="Planned route, whose swaths are recognized as they are driven."),
    ] = None
    require: Annotated[
        str, typer.Option("--require", help="Map class, e.g. class-3, or the largest RMSE [m].")
    ] = "class-3"
    probability: Annotated[
        float, typer.Option("--probability", help="Probability with which the class has to hold.")
    ] = 0.95
    noise_m: Annotated[
        float, typer.Option("--noise", min=0.0, help="Standard deviation of a sample's height [m].")
    ] = 0.1
    shared_m: Annotated[
        float, typer.Option("--shared", min=0.0, help="Error of height that all samples share [m].")
    ] = 0.0
    every_m: Annotated[
        float, typer.Option("--every", min=1.0, help="Distance between updates of the map [m].")
    ] = 25.0
    antenna_m: Annotated[
        float, typer.Option("--antenna", help="Height of the antenna above the ground [m]; telemetry only.")
    ] = 0.0
    log: Annotated[
        Path | None, typer.Option("--log", help="Log to write, JSON lines, which --replay reads.")
    ] = None
    replay: Annotated[
        Path | None, typer.Option("--replay", help="Compute a log again; --log writes the same bytes.")
    ] = None
    next_route: Annotated[
        Path | None, typer.Option("--next", help="Route file that is replaced by each next swath.")
    ] = None
    map_file: Annotated[
        Path | None,
        typer.Option(
            "--map", help="GeoTIFF of the map and its standard deviation that is replaced by each update."
        ),
    ] = None
    once: Annotated[bool, typer.Option("--once", help="End with the file instead of waiting for more.")] = (
        False
    )
    system: System = None
    patience_s: Patience = 15.0
    force: Annotated[bool, typer.Option("--force", help="Replace a log that is there.")] = False
    quiet: Quiet = False

    @property
    def inputs(self) -> list[Path | None]:
        """The files and folders that are read."""
        source = None if self.source is None or "://" in self.source else Path(self.source)
        return [source, self.area, self.route, self.replay]


@with_exit_codes
@with_options_of(WatchRequest)
def watch(request: WatchRequest) -> None:
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
    inputs = with_companions(request.inputs)
    refuse_existing([file for file in (request.log,) if file], force=request.force, inputs=inputs)
    replaced = [file for file in (request.next_route, request.map_file) if file]
    refuse_existing(replaced, force=True, inputs=inputs)
    last: dict[str, Any] = {}
    counts: Counter[str] = Counter()
    with ExitStack() as stack:
        entries = _entries(request, stack)
        # Input is checked up to the first entry before a log that is there is replaced.
        first = next(entries)
        out = (
            None
            if request.log is None
            else stack.enter_context(request.log.open("w", encoding="utf-8", newline=""))
        )
        for entry in chain([first], entries):
            if out is not None:
                out.write(_line(entry))
                out.flush()
            if not request.quiet and (text := text_of(entry)):
                typer.echo(text)
            last = entry if entry.get("event") == "advice" else last
            counts[entry.get("event") or entry.get("in", "")] += 1
    typer.echo(closing_line(counts))
    if last.get("do") == "give up":
        raise typer.Exit(NOT_MET)


def _line(entry: dict[str, Any]) -> str:
    from live.watch.log import line_of

    return line_of(entry)


def _entries(request: WatchRequest, stack: ExitStack) -> Iterator[dict[str, Any]]:
    """Yield the entries of a replay, or of what arrives."""
    from live.watch.log import entered, heading_of, replayed

    if request.replay is not None:
        yield from replayed(request.replay)
        return
    watching = _watch(request)
    inputs = _inputs(request, watching, stack)
    yield heading_of(watching)
    for entry in inputs:
        yield entry
        for event in entered(watching, entry):
            yield event
            _write_map(request, watching, event)
            yield from _sent_on(request, watching, event)
        if watching.is_stopped:
            return


def _write_map(request: WatchRequest, watching: "SurveyWatch", event: dict[str, Any]) -> None:
    """Write the map and its standard deviation after an update."""
    if event["event"] != "map" or request.map_file is None or watching.latest_map is None:
        return
    from survey.io.raster.writing import write_raster

    bands = dict(zip(("elevation", "sigma"), watching.latest_map, strict=True))
    write_raster(request.map_file, bands, watching.grid.transform, watching.grid.crs)


def _sent_on(
    request: WatchRequest, watching: "SurveyWatch", event: dict[str, Any]
) -> Iterator[dict[str, Any]]:
    """Take the next swath for what will be driven, once the planned route is, and write it."""
    if event["event"] != "advice" or watching.advice is None or not watching.advice.legs:
        return
    if watching.progress.n_driven < len(watching.legs):
        return
    from live.watch.log import entered, legs_as_lists
    from survey import Route

    if request.next_route is not None:
        Route(watching.advice.legs, watching.area.crs, "adaptive").write(request.next_route)
    entry = {"in": "legs", "legs": legs_as_lists(list(watching.advice.legs))}
    entered(watching, entry)
    yield entry


def _watch(request: WatchRequest) -> "SurveyWatch":
    """Return the watch of a survey before its first sample."""
    from firnline.actions.exporting import read_route
    from firnline.actions.guaranteeing import limit_of
    from live.watch.survey_watch import SurveyWatch
    from planners.guarantee.adaptive_state import AdaptiveConfig
    from survey import SurveyArea
    from survey.core.errors import ConfigError

    if request.source is None or request.area is None or request.route is None:
        raise ConfigError(
            "a source, --area and --route are needed to watch a survey; --replay needs a log alone."
        )
    route = read_route(request.route, None)
    config = AdaptiveConfig(
        limit_of(request.require), request.probability, noise_m=request.noise_m, shared_m=request.shared_m
    )
    area = SurveyArea.read(request.area, crs=route.crs)
    return SurveyWatch(area, config, list(route.legs), request.every_m)


def _inputs(request: WatchRequest, watching: "SurveyWatch", stack: ExitStack) -> Iterator[dict[str, Any]]:
    """Return an iterator over what arrives from telemetry or a file, which is connected or found to be there."""
    source, crs = str(request.source), watching.area.crs
    if "://" not in source:
        from live.watch.growing_file import file_entries
        from survey.core.files.reading import existing_file

        file = Path(source) if Path(source).is_dir() else existing_file(source, "the samples")
        return file_entries(file, crs, follows=not request.once)
    with needs_live_extra():
        from live.link.address import LinkAddress
        from live.link.vehicle import Vehicle
        from live.watch.telemetry import TelemetryReader, buffered_entries

        link = Vehicle.connected(LinkAddress.parsed(source), request.patience_s, request.system)
        vehicle = stack.enter_context(link)
        return stack.enter_context(
            closing(buffered_entries(vehicle, TelemetryReader(crs, request.antenna_m)))
        )
