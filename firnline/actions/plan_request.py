"""Request of a plan and the files that it writes.

The options are checked against one another before any work. A plan is a route with its picture, sheets for printing or a
QGIS project, with the predicted standard deviation of the map.
"""

import json
import logging
from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import planners
import survey
from firnline.actions.interface import (
    Argument,
    Option,
    Result,
    WrittenResult,
    chosen_area,
    own_crs,
    read_about,
    refuse_existing,
)
from firnline.actions.requests import (
    Above,
    Below,
    Lengths,
    PictureOptions,
    Product,
    RatesFile,
    RunOptions,
    Select,
)
from survey.core import InputError

if TYPE_CHECKING:
    from planners.prediction.assumptions import MapAssumptions, Surface
    from planners.prediction.error_model import ErrorModel
    from planners.routes.traversability import LeftOut
    from survey.figures.plans import PlanContent, RoverEffort
    from survey.reporting.qgis import QgisGroup


logger = logging.getLogger(__name__)

_ROUTES = (".geojson", ".gpkg")
_FORMATS = (*_ROUTES, ".pdf", ".qgz")
_PICTURES = ("picture", "errors")


@dataclass(frozen=True, kw_only=True)
class PlanRequest(RunOptions, PictureOptions):
    """What is to be planned, and where the plan is written; None stands for an option that was not given."""

    source: Annotated[
        Path,
        Argument(
            help="Area (GeoJSON, GeoPackage, KML, KMZ, Shapefile) or mission file (TOML).",
            reads={".toml": "the configuration"}
            | dict.fromkeys((".geojson", ".gpkg", ".kml", ".kmz", ".shp"), "the area file"),
        ),
    ]
    prior: Annotated[
        Path | None, Option("--prior", help="Coarse elevation raster of the area.", reads="the raster")
    ] = None
    select: Select = field(default_factory=list)
    above: Above = None
    below: Below = None
    pattern: Annotated[
        str | None,
        Option(
            "--pattern",
            help="Planner, such as lawnmower (default), wavy or best (by predicted error); an unknown name lists all.",
        ),
    ] = None
    swaths: Annotated[
        int | None, Option("--swaths", help="Number of parallel lines; 4 when no size is given.")
    ] = None
    spacing: Annotated[
        float | None,
        Option("--spacing", help="Ground sample spacing: the largest distance between swaths [m]."),
    ] = None
    budget: Annotated[float | None, Option("--budget", help="Metres to drive (best, variance-driven).")] = (
        None
    )
    rmse: Annotated[
        float | None, Option("--rmse", help="Predicted error to reach [m] (best, variance-driven).")
    ] = None
    crs: Annotated[
        str | None,
        Option("--crs", help="CRS to plan in, such as EPSG:32608; that of the prior or the file by default."),
    ] = None
    units: Lengths = None
    rovers: Annotated[int | None, Option("--rovers", help="Number of rovers that share the area.")] = None
    max_slope: Annotated[
        float | None,
        Option("--max-slope", help="Steepest ground of the prior that the rover may be on [deg]."),
    ] = None
    product: Product = None
    no_go: Annotated[
        Path | None, Option("--no-go", help="Raster that is 1 on no-go ground, as reconstruct writes it.")
    ] = None
    require: Annotated[
        str | None,
        Option("--require", help="Guarantee this: class-1, class-2, class-3 or an RMSE [m]; needs --prior."),
    ] = None
    probability: Annotated[
        float, Option("--probability", help="Probability of the guarantee, above 0.5 and at most 0.999.")
    ] = 0.9
    noise_m: Annotated[float, Option("--noise", help="Standard deviation of a sample's height [m].")] = 0.1
    localization_m: Annotated[
        float,
        Option(
            "--localization",
            help="Standard deviation of the rover's position, east and north each [m].",
        ),
    ] = 0.0
    prior_sigma_m: Annotated[
        float,
        Option("--prior-sigma", help="Standard deviation of a cell of the prior [m]."),
    ] = 1.0
    assume: Annotated[
        str | None,
        Option(
            "--assume",
            help="Covariance family of the terrain (squared-exponential, matern-5/2, matern-3/2, whittle); by default those of the surface.",
        ),
    ] = None
    surface: Annotated[
        str,
        Option(
            "--surface",
            help="Class of the ground: bare-ice, snow, moraine, bedrock or unknown.",
        ),
    ] = "unknown"
    micro_relief_m: Annotated[
        float | None,
        Option(
            "--micro-relief",
            help="Standard deviation of relief finer than the samples [m]; that of the surface by default.",
        ),
    ] = None
    shared_m: Annotated[
        float, Option("--shared", help="Standard deviation of an error of height that all samples share [m].")
    ] = 0.05
    max_swaths: Annotated[
        int | None,
        Option(
            "--max-swaths", help="Most swaths of a guarantee; by default as many as are two samples apart."
        ),
    ] = None
    joint: Annotated[
        bool,
        Option(
            "--joint",
            help="Predict the errors that the path shares, from its sensors and aiding (--set): numbers of swaths and of stakes.",
        ),
    ] = False
    lidar: Annotated[
        Path | None,
        Option(
            "--lidar",
            help="Mission file whose LiDAR maps the area: the widest spacing of swaths for which its map meets --require.",
        ),
    ] = None
    adaptive: Annotated[
        bool, Option("--adaptive", help="Plan swath by swath: the first two, or the next one.")
    ] = False
    driven: Annotated[Path | None, Option("--driven", help="Route driven so far (adaptive).")] = None
    measured: Annotated[Path | None, Option("--measured", help="Points measured so far (adaptive).")] = None
    season: Annotated[
        str | None,
        Option(
            "--season",
            help="Design two surveys: half the 95 % interval of the mass balance [m w.e.], such as 0.2, or of the change of volume, such as 5%; needs --prior and --dates.",
        ),
    ] = None
    dates: Annotated[
        str | None, Option("--dates", help="Days of both surveys of a season, such as 2026-05-01,2026-09-20.")
    ] = None
    melt_m_we_day: Annotated[
        float | None,
        Option("--melt", help="Mean melt of a day in the season [m w.e.]; that of the surface by default."),
    ] = None
    emergence_m_year: Annotated[
        float,
        Option(
            "--emergence",
            help="Standard deviation of the mean vertical motion of the ice over the area [m per year]; 0 for a complete glacier.",
        ),
    ] = 0.0
    km_a_day: Annotated[float, Option("--km-a-day", help="Distance driven in a day of a season [km].")] = 10.0
    rates: RatesFile = None
    out: Annotated[
        Path,
        Option(
            "--out",
            "-o",
            help="Route (.geojson, .gpkg) with its picture beside it, or sheets for printing (.pdf) or a QGIS project (.qgz), with the route and the predicted standard deviation (_sigma.tif) beside them.",
        ),
    ] = Path("route.geojson")
    force: Annotated[bool, Option("--force", help="Replace the route and its picture where they exist.")] = (
        False
    )

    @property
    def files(self) -> dict[str, Path]:
        """Files that may be written, by what they hold."""
        if self.out.suffix.lower() in _ROUTES:
            files = {"route": self.out, "picture": self.out.with_suffix(f".{self.pictures}")}
            files = files if self.season is None else files | self._season_files
            return {
                name: file for name, file in files.items() if not (self.no_pictures and name in _PICTURES)
            }
        sigma = self.out.with_name(f"{self.out.stem}_sigma.tif")
        if self.out.suffix.lower() == ".qgz":
            area, terrain = (
                self.out.with_name(f"{self.out.stem}_{name}") for name in ("area.gpkg", "terrain.tif")
            )
            route = self.out.with_suffix(".gpkg")
            return {"project": self.out, "route": route, "area": area, "sigma": sigma, "terrain": terrain}
        return {"sheets": self.out, "route": self.out.with_suffix(".geojson"), "sigma": sigma}

    @property
    def _season_files(self) -> dict[str, Path]:
        """Files of a season's design beside the route."""
        return {
            name: self.out.with_name(f"{self.out.stem}_season{suffix}")
            for name, suffix in (("table", ".csv"), ("errors", f".{self.pictures}"))
        }

    def remove_old_pictures(self) -> None:
        """Remove the pictures of a plan that was replaced, where none are drawn of the new one."""
        if self.no_pictures and self.force:
            for name, file in replace(self, no_pictures=False).files.items():
                if name in _PICTURES:
                    file.unlink(missing_ok=True)

    @property
    def written(self) -> dict[str, str]:
        """Names of the files that were written, by what they hold."""
        return {name: str(path) for name, path in self.files.items() if path.exists()}

    @property
    def written_text(self) -> str:
        """Names of the files that were written, for a message."""
        return ", ".join(self.written.values())

    @property
    def is_mission(self) -> bool:
        """Whether the source is a mission file."""
        return self.source.suffix == ".toml"

    def given(self, *names: str) -> list[str]:
        """Return those of the named options that were given, as they are written on the command line."""
        usual = {field.name: field.default for field in fields(self)}
        return [
            "--" + ("set" if name == "settings" else name.replace("_", "-"))
            for name in names
            if name in usual and getattr(self, name) not in (None, False, (), [], usual[name])
        ]

    @property
    def assumptions(self) -> "MapAssumptions":
        """Errors of samples and prior, and the class of surface, that the predicted error rests on."""
        return planners.MapAssumptions(
            noise_m=self.noise_m,
            localization_m=self.localization_m,
            shared_m=self.shared_m,
            prior_sigma_m=self.prior_sigma_m,
            surface=cast("Surface", self.surface),
            micro_relief_m=self.micro_relief_m,
            assumed=self.assume,
        )

    def field_work(self, route: "survey.Route") -> "planners.FieldWork | None":
        """Return days, person-days and cost of a route; None without rates."""
        if self.rates is None:
            return None
        return planners.Rates.read(self.rates).field_work(route.prediction["time_s"], route.n_rovers)

    def check_outputs(self) -> None:
        """Refuse outputs that exist, are inputs, cannot be written or have an unknown format.

        Raises
        ------
        InputError
            One sentence that names the output and what to do.
        """
        if self.out.suffix.lower() not in _FORMATS:
            raise InputError(
                f"the plan {self.out} ends in {self.out.suffix!r}; one of {', '.join(_FORMATS)} was expected "
                "(firnline export writes other formats from it)."
            )
        if self.no_pictures and self.out.suffix.lower() == ".pdf":
            raise InputError(
                f"the sheets {self.out} are pictures; leave --no-pictures out, or write a route (.geojson)."
            )
        inputs = (self.source, self.prior, self.no_go, self.driven, self.measured, self.lidar)
        refuse_existing(self.files.values(), force=self.force, inputs=inputs)

    def read_area(self) -> "tuple[survey.SurveyArea, survey.Dem | None]":
        """Read the area, less the ground that a raster marks, and the prior about it, in one CRS."""
        from survey.io.vector import require_transformation

        crs: Any = self.crs
        if crs is None and self.prior is not None:
            crs = own_crs(self.prior)
        area = chosen_area(self.source, self, crs)
        if self.out.suffix.lower() == ".pdf":
            require_transformation(area.crs, self.out)
        prior = (
            None
            if self.prior is None
            else read_about(self.prior, area.bounds, area.crs, "the prior", units=self.units)
        )
        if self.no_go is not None:
            from planners.routes.traversability import without_marked

            mask = read_about(self.no_go, area.bounds, area.crs, "the raster of no-go ground", mask=True)
            area = without_marked(area, mask)
        if prior is not None and self.max_slope is not None:
            from planners.routes.traversability import slope_texts

            for text in slope_texts(prior, area, self.max_slope, self.product):
                logger.warning("%s", text)
        return area, prior


_NODES_ALONG = 60


@dataclass(frozen=True)
class PlanDrawing:
    """What is drawn of a plan beside its route; `model` predicts the error of the map, if it can be predicted."""

    area: "survey.SurveyArea"
    terrain: "survey.Dem | None" = None
    model: "ErrorModel | None" = None
    rover: "planners.Rover | None" = None
    left_out: "tuple[LeftOut, ...]" = ()
    assumptions: tuple[str, ...] = field(default_factory=tuple)

    @property
    def fine_cell_m(self) -> float:
        """Cell in which the standard deviation is written [m]."""
        xmin, ymin, xmax, ymax = self.area.bounds
        return max(xmax - xmin, ymax - ymin) / _NODES_ALONG

    def std(self, route: "survey.Route", cell_m: float | None = None) -> "survey.Dem | None":
        """Return the predicted standard deviation of the map; None where it cannot be predicted."""
        if self.model is None:
            return None
        model = self.model if cell_m is None else self.model.with_cells(cell_m)
        return model.error(route).std


def write_plan_project(request: PlanRequest, route: "survey.Route", drawing: PlanDrawing) -> None:
    """Write the project with its layers: route, area, and, where given, terrain and predicted error. All files are written or none."""
    from survey.core import replacing_files
    from survey.reporting.qgis import write_project

    std = drawing.std(route, drawing.fine_cell_m)
    rasters = {"sigma": std, "terrain": drawing.terrain}
    known = {name: raster for name, raster in rasters.items() if raster is not None}
    names = ["project", "route", "area", *known]
    files = {name: request.files[name] for name in names}
    with replacing_files(*files.values()) as drafts:
        draft = dict(zip(names, drafts, strict=True))
        route.write(draft["route"])
        drawing.area.write(draft["area"])
        for name, raster in known.items():
            raster.write(draft[name], "sigma_m" if name == "sigma" else "elevation")
        groups = _groups(files, route, drawing, std)
        write_project(
            draft["project"],
            request.source.stem,
            groups,
            route.crs,
            drawing.area.bounds,
            place=files["project"],
        )


def _groups(
    files: dict[str, Path], route: "survey.Route", drawing: PlanDrawing, std: "survey.Dem | None"
) -> "tuple[QgisGroup, ...]":
    from survey.reporting.qgis import QgisGroup, QgisLayer, value_limits

    plan = [
        QgisLayer("Route", files["route"], "route", table="route", n_rovers=route.n_rovers),
        QgisLayer("Survey area", files["area"], "area", table="area"),
    ]
    if len(drawing.area.starts):
        plan.insert(0, QgisLayer("Starts", files["area"], "starts", table="area"))
    groups = [QgisGroup("Plan", tuple(plan))]
    if std is not None:
        limits = (0.0, value_limits(std.elevation)[1])
        layer = QgisLayer("Predicted standard deviation", files["sigma"], "deviation", limits=limits)
        groups.append(QgisGroup("Prediction", (layer,)))
    if drawing.terrain is not None:
        limits = value_limits(drawing.terrain.elevation)
        shade = QgisLayer("Hillshade", files["terrain"], "hillshade")
        groups.append(
            QgisGroup(
                "Prior terrain", (shade, QgisLayer("Elevation", files["terrain"], "elevation", limits=limits))
            )
        )
    return tuple(groups)


@dataclass(frozen=True, kw_only=True)
class PlanResult(WrittenResult):
    """A plan; each kind of plan adds facts about it.

    Parameters
    ----------
    request : PlanRequest
        What was asked for.
    route : Route, optional
        The route; None where no more driving is needed.
    drawing : PlanDrawing
        What is drawn beside it.
    remarks : tuple of str
        What was said of the inputs, such as gaps between outlines that were closed.
    """

    request: PlanRequest
    route: "survey.Route | None"
    drawing: PlanDrawing
    remarks: tuple[str, ...] = ()

    def as_json(self) -> str:
        """Return the facts and notes as JSON."""
        return json.dumps(self.facts() | {"notes": [*self.notes, *self.remarks]}, indent=2)

    def _write_files(self) -> None:
        """Write the files of the plan; all replace what was there, or none does."""
        if self.route is not None:
            assumptions = (*self.drawing.assumptions, *self.remarks)
            write_plan(self.request, self.route, replace(self.drawing, assumptions=assumptions))
            self.request.remove_old_pictures()


def with_remarks(make: Callable[[], Result]) -> Result:
    """Make a plan, and give it what the log warns of meanwhile."""
    remarks: list[str] = []
    root, handler = logging.getLogger(), logging.Handler(logging.WARNING)
    shown = logging.lastResort if not root.handlers else None  # which prints where nobody handles records

    def keep(record: logging.LogRecord) -> None:
        remarks.append(record.getMessage())
        if shown is not None:
            shown.handle(record)

    handler.emit = keep  # type: ignore[method-assign]
    root.addHandler(handler)
    try:
        made = make()
    finally:
        root.removeHandler(handler)
    return replace(made, remarks=tuple(remarks)) if isinstance(made, PlanResult) else made


def write_plan(request: PlanRequest, route: "survey.Route", drawing: PlanDrawing) -> None:
    """Write the files of a plan; all replace what was there, or none does."""
    if request.out.suffix.lower() == ".pdf":
        _write_sheets(request, route, drawing)
    elif request.out.suffix.lower() == ".qgz":
        write_plan_project(request, route, drawing)
    else:
        _write_route(request, route, drawing)


def _write_route(request: PlanRequest, route: "survey.Route", drawing: PlanDrawing) -> None:

    from survey.core import replacing_files

    if request.no_pictures:
        with replacing_files(request.out) as (route_file,):
            route.write(route_file)
        return
    from survey.figures import picture_bytes, plan_map

    pieces = [piece.polygon for piece in drawing.left_out]
    figure = plan_map(drawing.area, route, terrain=drawing.terrain, std=drawing.std(route), left_out=pieces)
    with replacing_files(request.out, request.files["picture"]) as (route_file, picture_file):
        route.write(route_file)
        picture_file.write_bytes(picture_bytes(figure, request.pictures))


def _write_sheets(request: PlanRequest, route: "survey.Route", drawing: PlanDrawing) -> None:
    from survey.core import replacing_files
    from survey.figures.page_layout import pdf_bytes
    from survey.figures.plans import plan_sheets

    std = drawing.std(route, drawing.fine_cell_m)
    content = _content(request, route, drawing, std)
    pdf = pdf_bytes(plan_sheets(content), content.title)
    files = [request.files["sheets"], request.files["route"]]
    with replacing_files(*files, *([request.files["sigma"]] if std is not None else [])) as drafts:
        drafts[0].write_bytes(pdf)
        route.write(drafts[1])
        if std is not None:
            std.write(drafts[2], "sigma_m")


def _content(
    request: PlanRequest, route: "survey.Route", drawing: PlanDrawing, std: "survey.Dem | None"
) -> "PlanContent":
    """Return what the sheets of a plan state."""
    from planners.swaths.reference_lines import swaths_text
    from survey.figures.plans import PlanContent

    rover = drawing.rover or planners.Rover()
    efforts = tuple(_effort(route, k, rover, drawing.terrain) for k in range(route.n_rovers))
    return PlanContent(
        request.source.stem,
        f"{datetime.now(UTC):%d %B %Y}",
        drawing.area,
        route,
        efforts,
        swaths_text(route),
        route.prediction.get("time_s", max(effort.time_s for effort in efforts)),
        drawing.terrain,
        std,
        tuple((piece.polygon, piece.reason) for piece in drawing.left_out),
        (*_rover_assumptions(rover, drawing.terrain, request.prior), *drawing.assumptions),
        "" if (work := request.field_work(route)) is None else str(work),
    )


def _effort(
    route: "survey.Route", k: int, rover: "planners.Rover", terrain: "survey.Dem | None"
) -> "RoverEffort":
    from planners.routes.rover import effort
    from survey.figures.plans import RoverEffort

    own = effort(route.path(k), rover, terrain, crs=route.crs)
    batteries = None if rover.battery_j is None else own.energy_j / rover.battery_j
    return RoverEffort(*own, batteries)


def _rover_assumptions(
    rover: "planners.Rover", terrain: "survey.Dem | None", prior: Path | None
) -> list[str]:
    """Return in sentences what time and energy rest on."""
    slopes = "level ground" if terrain is None else f"slopes of {prior.name if prior else 'the prior'}"
    sentences = [
        f"Time and energy: {rover.speed_m_s:g} m/s, {rover.turn_s:g} s for a turn, {rover.mass_kg:g} kg, rolling resistance "
        f"{rover.rolling_resistance:g}, efficiency {rover.efficiency:g}, {rover.idle_w:g} W at rest; {slopes}."
    ]
    if terrain is not None:
        sentences.append(
            f"Terrain: {prior.name if prior else 'prior'}, cells of {terrain.step_m:g} m, "
            f"{terrain.vertical_datum or 'vertical datum not stated'}."
        )
    return sentences
