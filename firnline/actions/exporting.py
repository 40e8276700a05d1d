"""Convert routes, maps, tracks, areas, points and runs to the formats of other programs; exchange missions with a rover."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import survey
from firnline.actions.interface import (
    Argument,
    Option,
    Preview,
    Progress,
    Result,
    WrittenResult,
    area_if_named,
    companions_of_output,
    fact_line,
    needs_live_extra,
    no_progress,
    previewed_by,
    read_about,
    refuse_existing,
    with_companions,
)
from firnline.actions.requests import Lengths, Patience, Select, System, Url
from firnline.actions.run_formats import RUN_FORMAT_NAMES, RunFormat, format_of_run
from survey.core import ConfigError

if TYPE_CHECKING:
    from live.mission_items import AutopilotMission
    from survey.interchange.missions import Surroundings


_MISSIONS = (".plan", ".waypoints")
_KINDS = ("route", "raster", "points", "track", "area", "stac")


@dataclass(frozen=True, kw_only=True)
class RouteOptions:
    """Options of what goes along with a route; None stands for an option that was not given."""

    autopilot: Annotated[
        str | None, Option("--autopilot", help="Missions: ardupilot or px4.  [default: px4]")
    ] = None
    area: Annotated[
        Path | None,
        Option(
            "--area",
            help="Area of the route: the fence of a mission, 10 m outside its outline, with its no-go zones; polygons of "
            "KML. Of a run folder, its own.",
        ),
    ] = None
    select: Select = field(default_factory=list)
    dem: Annotated[
        Path | None,
        Option(
            "--dem",
            help="Elevation raster: heights of waypoints (GPX, KML, GeoJSON, missions) and of the home position. Of a run folder, its prior.",
        ),
    ] = None
    speed_m_s: Annotated[
        float | None, Option("--speed", help="Missions: speed that the rover is set to [m/s].")
    ] = None
    returns: Annotated[
        bool, Option("--return", help="Missions: end with a return to launch, straight to the start.")
    ] = False
    crs: Annotated[
        str | None,
        Option(
            "--crs",
            help="CRS of files that carry none; of areas and of plans of other tools, the one to write in, by default their UTM zone.",
        ),
    ] = None
    units: Lengths = None

    def refuse_stated(self, reason: str, *, of_files: bool = False) -> None:
        """Refuse options that only routes have.

        Parameters
        ----------
        reason : str
            Why they do not apply.
        of_files : bool
            Refuse those of files without a CRS and unit, and the choice of outlines, too.
        """
        given: dict[str, object] = {
            "--autopilot": self.autopilot,
            "--area": self.area,
            "--dem": self.dem,
            "--speed": self.speed_m_s,
            "--return": self.returns or None,
        }
        if of_files:
            given |= {"--crs": self.crs, "--units": self.units, "--select": self.select or None}
        stated = [name for name, value in given.items() if value is not None]
        if stated:
            other = "routes and files" if of_files else "routes"
            raise ConfigError(f"{', '.join(stated)} goes with {other}; {reason}, leave it out.")


class FoundRoute(NamedTuple):
    """Route, the area and the terrain that go along, and what was left out."""

    route: "survey.Route"
    around: "Surroundings"
    notes: tuple[str, ...] = ()


def route_with_surroundings(source: Path, options: RouteOptions) -> FoundRoute:
    """Read a route; that of a run comes with the area and the terrain of the run, as far as it knows all heights."""
    from survey.core.run_folder import RunFolder

    if not source.is_dir():
        route = read_route(source, options.crs)
        return FoundRoute(route, _surroundings(route, options))
    stage = RunFolder.find(source).verified("plan")
    route = survey.Route.read(stage / "route.geojson")
    of_run = replace(
        options, area=options.area or stage / "area.gpkg", dem=options.dem or stage / "prior.tif"
    )
    around = _surroundings(route, of_run)
    if options.dem is not None or around.terrain is None or knows_heights(around.terrain, route):
        return FoundRoute(route, around)
    note = "the prior of the run has voids on the route; heights are left out (--dem)."
    return FoundRoute(route, replace(around, terrain=None), (note,))


def knows_heights(terrain: "survey.Dem", route: "survey.Route") -> bool:
    """Return whether a terrain has a height at every waypoint of a route."""
    import numpy as np

    return bool(np.isfinite(terrain.at(np.vstack([leg.xy for leg in route.legs]))).all())


def read_route(source: Path, crs: str | None) -> "survey.Route":
    """Read a route of firnline as it is; a plan of another tool, or into a named CRS, in any format."""
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

    from survey.interchange.missions import Surroundings

    area, dem, autopilot = options.area, options.dem, options.autopilot
    if autopilot not in (None, "ardupilot", "px4"):
        raise ConfigError(f"--autopilot {autopilot} is not known; ardupilot or px4 was expected.")
    places = np.vstack([leg.xy for leg in route.legs])
    bounds = (*places.min(axis=0).tolist(), *places.max(axis=0).tolist())
    return Surroundings(
        area_if_named(area, options, route.crs),
        None if dem is None else read_about(dem, bounds, route.crs, "the elevation raster"),
        "ardupilot" if autopilot == "ardupilot" else "px4",
        options.speed_m_s,
        options.returns,
    )


@dataclass(frozen=True, kw_only=True)
class ExportRequest(RouteOptions):
    """File to convert; None stands for an option that was not given."""

    source: Annotated[
        Path, Argument(help="File to convert, a run folder (its route), or a log of watch (.jsonl).")
    ]
    out: Annotated[
        Path,
        Argument(
            help="File to write. Routes: .geojson .gpkg .gpx .kml .kmz .plan (QGroundControl) .waypoints .csv .wkt; "
            "maps: .tif .asc .nc, or .json (their STAC item); points: .csv .gpkg .las .laz .ply; tracks: .tum .txt (KITTI) .gpx .gpkg; areas: .kml .shp …; "
            "run folders: .bag (ROS 1), .mcap (Foxglove and rerun; logs of watch too), worlds .sdf .glb .obj, and what --as names."
        ),
    ]
    rover: Annotated[
        int | None,
        Option(
            "--rover",
            help="Only this rover's legs, counted from 0. Without it, missions of several rovers are written "
            "one file for each: survey_rover1.plan, survey_rover2.plan … Drives and worlds of a run: the rover.",
        ),
    ] = None
    holds: Annotated[
        str | None,
        Option(
            "--as",
            help="What the file holds: route, raster, points, track or area, or stac for the item of a raster; by default found in its content. Of a run "
            "folder, what to write: ros2 (a folder, or .mcap), ros1, euroc, kitti (folders), foxglove, sdf, gltf, obj.",
        ),
    ] = None
    days: Annotated[
        str | None,
        Option(
            "--days",
            help="STAC items: day of the survey, or its first and last, such as 2026-05-01,2026-05-04.",
        ),
    ] = None
    force: Annotated[bool, Option("--force", help="Replace an existing file.")] = False

    @property
    def run_format(self) -> RunFormat | None:
        """Format in which a run is written; None for anything else, and for the route of a run."""
        return None if self.holds in _KINDS else format_of_run(self.source, self.out, self.holds)

    def check(self) -> None:
        """Refuse outputs that exist or are inputs, names that are not known, and options that do not apply to runs."""
        if self.holds not in (None, *_KINDS, *RUN_FORMAT_NAMES):
            raise ConfigError(
                f"--as {self.holds} is not known; one of {', '.join((*_KINDS, *RUN_FORMAT_NAMES))} was expected."
            )
        found = self.run_format
        if found is not None:
            self.refuse_stated(f"the format {found.name} has no place for it", of_files=True)
        inputs = with_companions([self.source, self.area, self.dem])
        own = () if found is None else found.own
        refuse_existing([self.out], force=self.force, inputs=inputs, own=own)
        refuse_existing(companions_of_output(self.out), force=self.force, inputs=[self.source])


@dataclass(frozen=True)
class ExportResult(Result):
    """File in the format of another program.

    Parameters
    ----------
    request : ExportRequest
        What was asked for.
    writer : callable
        Writes the file at a place, and returns a sentence about it.
    left_out : tuple of str
        What was left out.
    text : str
        Sentence about the file once it is written.
    """

    request: ExportRequest
    writer: Callable[[Path], str]
    left_out: tuple[str, ...] = ()
    text: str = ""

    def write(self, out: Path | None = None) -> "ExportResult":
        """Write the file, or one for each rover.

        Parameters
        ----------
        out : pathlib.Path, optional
            The file; that of the request by default. Its ending has to name the same format.

        Returns
        -------
        ExportResult
            With the sentence about it.
        """
        return replace(self, text=self.writer(out or self.request.out))

    @property
    def notes(self) -> list[str]:
        """What was left out."""
        return list(self.left_out)

    def lines(self) -> list[str]:
        """Return what was written."""
        return [self.text] if self.text else []


def preview_export(request: ExportRequest) -> Preview:
    """Read what would be converted and check it, and return what would be written."""
    request.check()
    if (run_format := request.run_format) is not None:
        opened = run_format.open(request.source, request.rover)
        return Preview.of([request.out], left_out=opened.notes)
    kind = _kind_of(request)
    if kind == "route":
        route, around, notes = route_with_surroundings(request.source, request)
        parts = _checked_parts(route, around, request)
        return Preview.of(parts, left_out=notes)
    with TemporaryDirectory() as folder:
        _convert(request, kind, Path(folder) / request.out.name)
    return Preview.of([request.out])


@previewed_by(preview_export)
def export(request: ExportRequest) -> ExportResult:
    """Convert a route, map, track, area, set of points or run to the format that the name of the output states.

    Parameters
    ----------
    request : ExportRequest
        File to convert, and what goes along.

    Returns
    -------
    ExportResult
        The content; `ExportResult.write` writes it.

    Raises
    ------
    InputError
        Input that cannot be used, or an output that exists.
    ConfigError
        Options that the content does not have.
    """
    request.check()
    if (run_format := request.run_format) is not None:
        opened = run_format.open(request.source, request.rover)
        return ExportResult(request, lambda out: f"{out} written: {opened.write(out)}", opened.notes)
    source, kind = request.source, _kind_of(request)
    if kind != "route":
        return ExportResult(request, lambda out: _convert(request, kind, out))
    route, around, notes = route_with_surroundings(source, request)
    _checked_parts(route, around, request)
    return ExportResult(request, lambda out: write_route(route, around, out, request.rover), notes)


def _kind_of(request: ExportRequest) -> str:
    """Return what is converted; refuse options of routes for anything else."""
    from survey.interchange.conversion import kind_of

    source, out = request.source, request.out
    kind = "route" if source.is_dir() else request.holds or kind_of(source, out)
    if kind is not None and kind != "route":
        request.refuse_stated(f"{source.name} holds none")
    if request.days is not None and kind != "stac":
        raise ConfigError("--days goes with STAC items of rasters (.json); leave it out.")
    return kind or "route"


def _convert(request: ExportRequest, kind: str, out: Path) -> str:
    from survey.interchange.conversion import convert

    if kind == "stac":
        return _write_stac(request, out)
    given = {"crs": request.crs, "units": request.units, "select": request.select}
    convert(request.source, out, kind, **given)  # type: ignore[arg-type]  # checked above
    return f"{out} written"


def _write_stac(request: ExportRequest, out: Path) -> str:
    """Write the STAC item of a raster, beside `out` of the request, whatever draft is written."""
    from datetime import date

    from survey.interchange.stac import write_stac_item

    if request.days is None:
        raise ConfigError(
            "a STAC item states when the survey was; name its day with --days 2026-05-01, or first and last."
        )
    try:
        days = [date.fromisoformat(part.strip()) for part in request.days.split(",")]
    except ValueError as error:
        raise ConfigError(
            f"--days {request.days} is no day such as 2026-05-01, and no two of them."
        ) from error
    if len(days) > 2:
        raise ConfigError(f"--days {request.days} names {len(days)} days; give the first and the last.")
    write_stac_item(request.source, out, *days)
    return f"{out} written"


def _parts(route: "survey.Route", rover: int | None, out: Path) -> dict[Path, int | None]:
    """Return the files of a route with the rover of each: one, or a mission for each rover."""
    if rover is None and route.n_rovers > 1 and out.suffix.lower() in _MISSIONS:
        return {out.with_stem(f"{out.stem}_rover{k + 1}"): k for k in range(route.n_rovers)}
    return {out: rover}


def _checked_parts(
    route: "survey.Route", around: "Surroundings", request: ExportRequest
) -> dict[Path, int | None]:
    """Return the files of a route; refuse those that exist, and missions that leave their own fence."""
    from survey.interchange.route_formats import require_writable

    parts = _parts(route, request.rover, request.out)
    refuse_existing([file for file in parts if file != request.out], force=request.force)
    for file, rover in parts.items():
        require_writable(route, file, rover=rover, around=around)
    return parts


def write_route(route: "survey.Route", around: "Surroundings", out: Path, rover: int | None = None) -> str:
    """Write one file, or a mission for each rover, and return a sentence about them."""
    from survey.interchange.route_formats import write_plan

    parts = _parts(route, rover, out)
    for file, part in parts.items():
        write_plan(route, file, rover=part, around=around)
    return f"{', '.join(str(file) for file in parts)} written"


@dataclass(frozen=True, kw_only=True)
class UploadRequest(RouteOptions):
    """Route to send to a rover."""

    source: Annotated[
        Path,
        Argument(
            help="Route (.geojson .gpkg .gpx .kml .csv .wkt), run folder, or mission of a ground station (.plan .waypoints), "
            "which is sent as it is."
        ),
    ]
    url: Url
    rover: Annotated[int | None, Option("--rover", help="Rover of a route of several, counted from 0.")] = (
        None
    )
    system: System = None
    patience_s: Patience = 15.0
    most_items: Annotated[
        int | None,
        Option(
            "--most-items",
            min=1,
            help="Largest number of items that the autopilot stores.  [default: ArduPilot 724, PX4 2000, others 65535]",
        ),
    ] = None
    starts: Annotated[
        bool, Option("--start", help="Arm the rover and start the mission afterwards: it drives off.")
    ] = False


@dataclass(frozen=True)
class UploadResult(Result):
    """Mission that a rover holds.

    Parameters
    ----------
    stated : dict
        What was sent and read back.
    has_fence : bool
        Whether a fence was sent.
    left_out : tuple of str
        What was left out.
    """

    stated: dict[str, object]
    has_fence: bool
    left_out: tuple[str, ...] = ()

    @property
    def notes(self) -> list[str]:
        """What was left out."""
        return list(self.left_out)

    def facts(self) -> dict[str, Any]:
        """Return what was sent and read back."""
        return self.stated

    def lines(self) -> list[str]:
        """Return what was sent and read back."""
        lines = [
            "uploaded, read back and equal",
            *(fact_line(name.replace("_", " "), value) for name, value in self.stated.items()),
        ]
        if not self.has_fence:
            note = "the fence was left as it is; name an area with --area to send one"
            lines.append(fact_line("note", note))
        return lines


def preview_upload(request: UploadRequest) -> Preview:
    """Read a route, and return which autopilots would hold its mission."""
    with needs_live_extra():
        from live.link import LinkAddress

        address, (mission, notes) = LinkAddress.parsed(request.url), _mission(request)
        facts = _storable_facts(mission, request.most_items) | {"would be sent to": address.text}
    return Preview.of([], facts, notes)


@previewed_by(preview_upload)
def upload(request: UploadRequest, progress: Progress = no_progress) -> UploadResult:
    """Send a route to a rover over MAVLink, read it back and compare it item by item.

    Parameters
    ----------
    request : UploadRequest
        Route and address.
    progress : callable
        Called with what is done, how many are done, and how many there are.

    Returns
    -------
    UploadResult
        What the rover holds.

    Raises
    ------
    InputError
        Input that cannot be used, or a rover that does not answer.
    """
    with needs_live_extra():
        from live.link import LinkAddress
        from live.mission_transfer import upload as sent

        address, (mission, notes) = LinkAddress.parsed(request.url), _mission(request)
        began = perf_counter()
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
    return UploadResult(facts, bool(mission.fence), notes)


def _mission(request: UploadRequest) -> "tuple[AutopilotMission, tuple[str, ...]]":
    """Read the mission of one rover, and what was left out of it."""
    from live.mission_items import AutopilotMission
    from survey.interchange.route_formats import part_of_rover

    if request.source.suffix.lower() in _MISSIONS:
        request.refuse_stated("a mission of a ground station is sent as it is")
        mission = AutopilotMission.read(request.source)
        return mission, mission.notes
    route, around, notes = route_with_surroundings(request.source, request)
    around = replace(around, most_corners=request.most_items)
    mission = AutopilotMission.of_route(part_of_rover(route, request.rover), around)
    return mission, (*notes, *mission.notes)


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


@dataclass(frozen=True, kw_only=True)
class DownloadRequest:
    """Rover whose mission is to be read."""

    url: Url
    out: Annotated[
        Path, Option("--out", "-o", help="Route to write: .geojson .gpkg .gpx .kml .csv .wkt .plan …")
    ] = Path("downloaded.geojson")
    crs: Annotated[
        str | None, Option("--crs", help="Projected CRS of the route; its UTM zone when left out.")
    ] = None
    system: System = None
    patience_s: Patience = 15.0
    force: Annotated[bool, Option("--force", help="Replace an existing file.")] = False


@dataclass(frozen=True)
class DownloadResult(WrittenResult):
    """Mission of a rover as a route.

    Parameters
    ----------
    request : DownloadRequest
        What was asked for.
    route : Route
        The route.
    """

    request: DownloadRequest
    route: "survey.Route"

    def _write_files(self) -> None:
        """Write the route."""
        from survey.interchange.route_formats import write_plan

        write_plan(self.route, self.request.out)

    def lines(self) -> list[str]:
        """Return what was written."""
        length_m = self.route.ground_length_m
        return [f"{self.request.out} written: {len(self.route.path())} waypoints, {length_m:.0f} m"]


def download(request: DownloadRequest, progress: Progress = no_progress) -> DownloadResult:
    """Read the mission that a rover holds.

    Parameters
    ----------
    request : DownloadRequest
        Address and output.
    progress : callable
        Called with what is done, how many are done, and how many there are.

    Returns
    -------
    DownloadResult
        Its waypoints; `DownloadResult.write` writes them.

    Raises
    ------
    InputError
        A rover that does not answer, or an output that exists.
    """
    refuse_existing([request.out], force=request.force, inputs=[])
    with needs_live_extra():
        from live.link import LinkAddress
        from live.mission_transfer import downloaded_route

        route = downloaded_route(
            LinkAddress.parsed(request.url),
            request.crs,
            patience_s=request.patience_s,
            system=request.system,
            progress=progress,
        )
    return DownloadResult(request, route)
