"""Follow a survey while it is driven: its map, its class and the next swath."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import survey
from firnline.actions.exporting import read_route
from firnline.actions.guaranteeing import limit_of
from firnline.actions.interface import (
    Argument,
    Option,
    Result,
    chosen_area,
    needs_live_extra,
    read_about,
    refuse_existing,
    with_companions,
)
from firnline.actions.requests import Patience, Select, System
from survey.core import duration_text

if TYPE_CHECKING:
    from live.watch.survey_watch import SurveyWatch


@dataclass(frozen=True, kw_only=True)
class WatchRequest:
    """Survey to follow."""

    source: Annotated[
        str | None,
        Argument(
            help="Telemetry (udp://HOST:PORT, udpin://…, tcp://…, serial:///dev/…), or a file that grows: points (.csv) or the "
            "log of a receiver (.nmea .txt .ubx), or the folder of a recording."
        ),
    ] = None
    area: Annotated[Path | None, Option("--area", help="Area that is mapped.")] = None
    select: Select = field(default_factory=list)
    route: Annotated[
        Path | None, Option("--route", help="Planned route, whose swaths are recognized as they are driven.")
    ] = None
    prior: Annotated[
        Path | None,
        Option(
            "--prior", help="Coarse elevation raster; map and advice take its cells, as plan --adaptive does."
        ),
    ] = None
    require: Annotated[str, Option("--require", help="Map class, e.g. class-3, or the largest RMSE [m].")] = (
        "class-3"
    )
    probability: Annotated[
        float, Option("--probability", help="Probability with which the class has to hold.")
    ] = 0.95
    noise_m: Annotated[
        float, Option("--noise", min=0.0, help="Standard deviation of a sample's height [m].")
    ] = 0.1
    shared_m: Annotated[
        float, Option("--shared", min=0.0, help="Error of height that all samples share [m].")
    ] = 0.0
    every_m: Annotated[float, Option("--every", min=1.0, help="Distance between updates of the map [m].")] = (
        25.0
    )
    antenna_m: Annotated[
        float, Option("--antenna", help="Height of the antenna above the ground [m]; telemetry only.")
    ] = 0.0
    log: Annotated[Path | None, Option("--log", help="Log to write, JSON lines, which --replay reads.")] = (
        None
    )
    replay: Annotated[
        Path | None, Option("--replay", help="Compute a log again; --log writes the same bytes.")
    ] = None
    next_route: Annotated[
        Path | None, Option("--next", help="Route file that is replaced by each next swath.")
    ] = None
    map_file: Annotated[
        Path | None,
        Option(
            "--map", help="GeoTIFF of the map and its standard deviation that is replaced by each update."
        ),
    ] = None
    once: Annotated[bool, Option("--once", help="End with the file instead of waiting for more.")] = False
    system: System = None
    patience_s: Patience = 15.0
    force: Annotated[bool, Option("--force", help="Replace a log that is there.")] = False

    @property
    def inputs(self) -> list[Path | None]:
        """The files and folders that are read."""
        source = None if self.source is None or "://" in self.source else Path(self.source)
        return [source, self.area, self.route, self.prior, self.replay]


@dataclass(frozen=True)
class WatchResult(Result):
    """Survey that was followed to its end.

    Parameters
    ----------
    counts : mapping of str to int
        Numbers of inputs and events by kind.
    advice : dict
        The last advice.
    """

    counts: Mapping[str, int]
    advice: dict[str, Any]

    @property
    def is_met(self) -> bool:
        """Whether further swaths would reach the class, or it is reached."""
        return self.advice.get("do") != "give up"

    def facts(self) -> dict[str, Any]:
        """Return the numbers of inputs and events, and the last advice."""
        return {"counts": dict(self.counts), "advice": self.advice}

    def lines(self) -> list[str]:
        """Return what arrived, and why there is no map where there is none."""
        return [closing_line(self.counts)]


def watch(request: WatchRequest, show: Callable[[str], None] = lambda _: None) -> WatchResult:
    """Follow a survey while it is driven; log, next route and map are written as it goes.

    Parameters
    ----------
    request : WatchRequest
        Source, area, route, requirement and outputs.
    show : callable
        Called with a line about each event.

    Returns
    -------
    WatchResult
        What arrived, and the last advice.

    Raises
    ------
    InputError
        Input that cannot be used, or a log that exists.
    ConfigError
        A source without area and route.
    """
    inputs = with_companions(request.inputs)
    refuse_existing([file for file in (request.log,) if file], force=request.force, inputs=inputs)
    replaced = [file for file in (request.next_route, request.map_file) if file]
    refuse_existing(replaced, force=True, inputs=inputs)
    advice: dict[str, Any] = {}
    counts: Counter[str] = Counter()
    with ExitStack() as stack:
        entries = _entries(request, stack)
        # Input is checked up to the first entry before a log that is there is replaced.
        first = next(entries)
        log = request.log
        out = None if log is None else stack.enter_context(log.open("w", encoding="utf-8", newline=""))
        for entry in chain([first], entries):
            if out is not None:
                out.write(_line(entry))
                out.flush()
            if text := text_of(entry):
                show(text)
            advice = entry if entry.get("event") == "advice" else advice
            counts[entry.get("event") or entry.get("in", "")] += 1
    return WatchResult(counts, advice)


def text_of(entry: dict[str, Any]) -> str:
    """Return an event as a line, and nothing for inputs.

    >>> text_of({"event": "warning", "time_s": 61.0, "about": "stuck", "text": "no movement for 90 s"})
    '1 min  WARNING no movement for 90 s'
    """
    kind = entry.get("event")
    if kind is None:
        return ""
    return f"{duration_text(entry['time_s'])}  {_WORDS[kind](entry)}"


def closing_line(counts: Mapping[str, int]) -> str:
    """Return the line at the end of a watch: what arrived, and why there is no map where there is none.

    >>> closing_line({"sample": 300, "refused": 299})
    'end  300 samples, 299 of them refused, 0 swaths driven; no map, as fewer swaths were driven than the first fit needs'
    """
    text = (
        f"end  {counts.get('sample', 0)} samples, {counts.get('refused', 0)} of them refused, "
        f"{counts.get('swath', 0)} swaths driven"
    )
    if counts.get("map"):
        return text
    return f"{text}; no map, as fewer swaths were driven than the first fit needs"


def _map(entry: dict[str, Any]) -> str:
    return (
        f"{entry['driven_m']:.0f} m driven, {entry['samples']} samples, expected RMSE {entry['expected_rmse_m']:.3f} m, "
        f"largest σ {entry['largest_sigma_m']:.2f} m, {entry['class'] or 'no class yet'}"
    )


def _advice(entry: dict[str, Any]) -> str:
    asked = f"RMSE of {entry['limit_m']:.4g} m holds with {entry['probability']:.0%}"
    if entry["do"] == "stop":
        return f"STOP: the {asked}; {entry['class'] or 'no class yet'}"
    if entry["do"] == "give up":
        return f"GIVE UP: the {asked}, and no further swaths would suffice"
    return (
        f"DRIVE ON: the {asked}, after the next swath with {entry['probability_with_next']:.0%} "
        f"(RMSE {entry['rmse_m']:.2f} m, then {entry['rmse_with_next_m']:.2f} m)"
    )


_WORDS: dict[str, Callable[[dict[str, Any]], str]] = {
    "map": _map,
    "advice": _advice,
    "swath": lambda entry: f"{entry['swaths']} swaths driven",
    "warning": lambda entry: f"WARNING {entry['text']}",
    "refused": lambda entry: f"a sample was refused: {entry['reason']}",
}


def _line(entry: dict[str, Any]) -> str:
    from live.watch.log import line_of

    return line_of(entry)


def _entries(request: WatchRequest, stack: ExitStack) -> Iterator[dict[str, Any]]:
    """Yield the entries of a replay, or of what arrives."""
    from live.watch.log import entered, replayed, watch_header

    if request.replay is not None:
        yield from replayed(request.replay)
        return
    watching = _watch(request)
    inputs = _inputs(request, watching, stack)
    yield watch_header(watching)
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

    if request.next_route is not None:
        survey.Route(watching.advice.legs, watching.area.crs, "adaptive").write(request.next_route)
    entry = {"in": "legs", "legs": legs_as_lists(list(watching.advice.legs))}
    entered(watching, entry)
    yield entry


def _watch(request: WatchRequest) -> "SurveyWatch":
    """Return the watch of a survey before its first sample."""
    from live.watch.survey_watch import SurveyWatch
    from planners.guarantee.adaptive import AdaptiveConfig
    from planners.guarantee.requirement import MapRequirement

    if request.source is None or request.area is None or request.route is None:
        raise survey.ConfigError(
            "a source, --area and --route are needed to watch a survey; --replay needs a log alone."
        )
    route = read_route(request.route, None)
    wanted = MapRequirement(
        limit_of(request.require), request.probability, noise_m=request.noise_m, shared_m=request.shared_m
    )
    area = chosen_area(request.area, request, route.crs)
    if request.prior is None:
        return SurveyWatch(area, AdaptiveConfig.of(wanted), list(route.legs), request.every_m)
    prior = read_about(request.prior, area.bounds, area.crs, "the prior")
    config = AdaptiveConfig.of_prior(wanted, area, prior)
    return SurveyWatch(area, config, list(route.legs), request.every_m, prior=prior)


def _inputs(request: WatchRequest, watching: "SurveyWatch", stack: ExitStack) -> Iterator[dict[str, Any]]:
    """Return an iterator over what arrives from telemetry or a file, which is connected or found to be there."""
    source, crs = str(request.source), watching.area.crs
    if "://" not in source:
        from live.watch.samples import file_entries
        from survey.core.files import existing_file

        file = Path(source) if Path(source).is_dir() else existing_file(source, "the samples")
        return file_entries(file, crs, follows=not request.once)
    with needs_live_extra():
        from live.link import LinkAddress, Vehicle
        from live.watch.samples import TelemetryReader, buffered_entries

        link = Vehicle.connected(LinkAddress.parsed(source), request.patience_s, request.system)
        vehicle = stack.enter_context(link)
        return stack.enter_context(
            closing(buffered_entries(vehicle, TelemetryReader(crs, request.antenna_m)))
        )
