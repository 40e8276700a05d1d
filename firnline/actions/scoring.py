"""Judge a map by a reference raster or by checkpoints: error statistics, classes of ground, map class, report."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from firnline.actions.interface import (
    Argument,
    Option,
    Preview,
    Result,
    fact_line,
    figure_lines,
    refuse_existing,
)
from firnline.actions.requests import RunOptions, columns_option, epoch_option
from survey.core.errors import CapacityError

if TYPE_CHECKING:
    from survey import Dem, Reconstruction, Score, SurveyArea
    from survey.core.arrays import FloatArray
    from survey.reporting.document import Document
    from survey.scoring import Checkpoints
    from survey.scoring.class_scores import ClassScore
    from survey.scoring.standards.assessment import CheckpointScore
    from survey.scoring.standards.checkpoint_errors import CheckpointErrors


SLOPE = "slope"
"""Value of ``--by`` for classes of slope; anything else is a file."""
_STANDARDS = ["asprs-edition-2"]


@dataclass(frozen=True, kw_only=True)
class ScoreRequest(RunOptions):
    """Options of the command."""

    source: Annotated[
        Path,
        Argument(help="Map (raster; its second band is the standard deviation) or mission file (TOML)."),
    ]
    truth: Annotated[
        Path | None, Option("--truth", help="Reference raster, finer and more accurate than the map.")
    ] = None
    checkpoints: Annotated[
        Path | None,
        Option("--checkpoints", help="Independent points (CSV, GeoPackage, GPX …), better than the map."),
    ] = None
    standards: Annotated[
        list[str],
        Option("--standard", help="Judge checkpoints by: asprs-edition-2, asprs-2014, nssda-1998, …"),
    ] = field(default_factory=lambda: list(_STANDARDS))
    class_m: Annotated[
        float | None, Option("--class", help="Class wanted: the RMSE of the newer ASPRS standards [m].")
    ] = None
    horizontal_class_m: Annotated[
        float | None,
        Option(
            "--horizontal-class",
            help="Horizontal class wanted [m]; checkpoints have the columns map_x and map_y.",
        ),
    ] = None
    interval_m: Annotated[
        float | None, Option("--interval", help="Contour interval of ASPRS 1990 and NMAS [m].")
    ] = None
    sigma_m: Annotated[
        float | None, Option("--sigma", help="Deviation of checkpoints that state none [m].")
    ] = None
    columns: Annotated[
        list[str],
        columns_option(
            "Columns of the checkpoint table: x, y, z, lon, lat, sigma_z, name, map_x, map_y, sigma_xy; usual names are found."
        ),
    ] = field(default_factory=list)
    datum: Annotated[str | None, Option("--datum", help="Vertical datum of checkpoints that state none.")] = (
        None
    )
    control: Annotated[
        Path | None,
        Option("--control", help="Points that the map was made from; no checkpoint may be one."),
    ] = None
    area: Annotated[Path | None, Option("--area", help="Judge only inside this polygon.")] = None
    route: Annotated[Path | None, Option("--route", help="Route that was driven, for coverage, α and β.")] = (
        None
    )
    crs: Annotated[
        str | None,
        Option("--crs", help="CRS of rasters that carry none or a local one (LOCAL_CS), e.g. EPSG:32608."),
    ] = None
    epoch_s: Annotated[
        float | None,
        epoch_option(
            "Move a map of moving ice (folder with ice_motion.json) to this time of its recording first [s]."
        ),
    ] = None
    by: Annotated[
        list[str],
        Option(
            "--by",
            metavar="slope|FILE",
            help="Statistics by class: slope, or a raster or polygons of land cover.",
        ),
    ] = field(default_factory=list)
    class_column: Annotated[
        str | None, Option("--class-column", help="Column of the polygons that names the class.")
    ] = None
    report: Annotated[
        Path | None,
        Option("--report", help="Write an accuracy report: a folder, or a file .html or .pdf."),
    ] = None
    language: Annotated[
        str, Option("--language", help="Language of the statements beside English: en or de.")
    ] = "en"
    force: Annotated[bool, Option("--force", help="Replace a report that is there.")] = False

    @property
    def is_mission(self) -> bool:
        """Whether the source is a mission file."""
        return self.source.suffix == ".toml"

    def check(self) -> None:
        """Refuse what cannot be done, before anything is read.

        Raises
        ------
        InputError
            Neither reference nor checkpoints, or a report that is there already.
        ConfigError
            An unknown standard, language or form of report, or a column mapping that was not understood.
        """
        from survey.core.errors import InputError
        from survey.data.ice_motion import ICE_MOTION
        from survey.io.column_names import parse_columns
        from survey.scoring.standards.standards import standard_named

        if self.truth is None and self.checkpoints is None:
            raise InputError(
                f"{self.source} cannot be judged alone; name the reference raster with --truth or points with --checkpoints."
            )
        self._refuse_unused()
        if self.epoch_s is not None and not (self.source / ICE_MOTION).exists():
            raise InputError(
                f"--epoch moves a map with the ice, and {self.source} holds no {ICE_MOTION}; name the folder of a map on moving ice, "
                "or leave --epoch out."
            )
        parse_columns(self.columns)
        for name in self.standards:
            standard_named(name)
        if self.report is not None:
            self._check_report(self.report)

    def _refuse_unused(self) -> None:
        """Refuse a reference beside checkpoints, options of checkpoints without them, and the map as its own reference."""
        from survey.core.errors import InputError

        if self.checkpoints is None:
            options = {
                "--standard": self.standards != _STANDARDS,
                "--class": self.class_m is not None,
                "--horizontal-class": self.horizontal_class_m is not None,
                "--interval": self.interval_m is not None,
                "--sigma": self.sigma_m is not None,
                "--columns": bool(self.columns),
                "--datum": self.datum is not None,
                "--control": self.control is not None,
            }
            unused = next((name for name, is_given in options.items() if is_given), None)
            if unused is not None:
                raise InputError(
                    f"{unused} belongs to --checkpoints, and the map is judged by a raster; leave {unused} out, or name checkpoints."
                )
        elif self.truth is not None:
            raise InputError(
                "--truth and --checkpoints were both given; judge the map by one of them at a time."
            )
        if self.truth is not None and self.truth.absolute() == self.source.absolute():
            raise InputError(
                f"{self.source} is the map and its own reference; name another raster with --truth."
            )

    def _check_report(self, report: Path) -> None:
        from survey.reporting.document import OUTPUTS, check_target
        from survey.reporting.statements import template

        template(self.language)
        target = check_target(report)
        inputs = (self.source, self.truth, self.checkpoints, self.control, self.area, self.route)
        refuse_existing([target], force=self.force, inputs=inputs, own=() if target.suffix else OUTPUTS)

    def refuse_options_of_maps(self) -> None:
        """Refuse options that a mission file does not take.

        Raises
        ------
        InputError
            ``--report`` or ``--by`` was given.
        """
        from survey.core.errors import InputError

        if self.epoch_s is not None:
            raise InputError(
                f"{self.source} is a mission, whose epoch is a setting of it; add --set ice.epoch_s={self.epoch_s:g} instead of --epoch."
            )
        if self.report is not None or self.by:
            raise InputError(
                f"{self.source} is a mission, whose page firnline report writes; --report and --by judge a map, name its raster or the "
                "folder 4-reconstruct of the run."
            )


def map_of(source: Path, crs: str | None = None, epoch_s: float | None = None) -> "Reconstruction | Dem":
    """Read firnline's own map from its folder, or anyone's raster; a second band is its standard deviation.

    A map of moving ice is moved to an epoch where one is named.
    """
    import numpy as np

    import survey
    from survey.data.ice_motion import ICE_MOTION, read_motion
    from survey.io.raster import band_count
    from survey.reconstruction.motion.epoch import at_epoch
    from survey.reconstruction.terrain_map import INTERPOLATED

    if source.is_dir():
        own = survey.Reconstruction.read(source)
        if epoch_s is None:
            return own
        return at_epoch(own, read_motion(source / ICE_MOTION), epoch_s)[0]
    mean = survey.Dem.read(source, crs=crs)
    if band_count(source) < 2:
        return mean
    std = survey.Dem.read(source, band=2, crs=crs)
    return survey.Reconstruction(mean, std, np.full(mean.shape, INTERPOLATED), "outside", {})


def today() -> str:
    """Return the date in words, as reports state it."""
    return f"{datetime.now(UTC):%d %B %Y}"


Classes = dict[str, tuple["ClassScore", ...]]


def scores_by_class(
    request: ScoreRequest, errors: "FloatArray", std: "FloatArray", xy: "FloatArray", surface: "Dem"
) -> Classes:
    """Return error statistics by each classification that was asked for.

    `surface` gives the slopes: the reference where there is one, else the map.
    """
    from survey.scoring.class_scores import class_scores, land_cover_at, slope_classes

    found: Classes = {}
    for by in request.by:
        if by == SLOPE:
            names = slope_classes(surface.slope().at(xy))
        else:
            names = land_cover_at(by, xy, surface.crs, request.class_column)
        found[_name_of(by)] = class_scores(errors, std, names)
    return found


def _name_of(by: str) -> str:
    return by if by == SLOPE else Path(by).stem


def class_lines(classes: Classes) -> list[str]:
    """Return the tables of classes as text."""
    lines = []
    for name, rows in classes.items():
        width = max(len(name), *(len(row.name) for row in rows)) + 2
        lines.append(f"{name:<{width}}{'n':>8}{'RMSE':>9}{'NMAD':>9}{'bias':>9}{'in 95 %':>9}")
        lines += [
            f"{row.name:<{width}}{row.n:>8}{row.rmse_m:>9.3f}{row.nmad_m:>9.3f}{row.bias_m:>+9.3f}"
            + (f"{row.coverage_95:>9.1%}" if math.isfinite(row.coverage_95) else f"{'–':>9}")
            for row in rows
        ]
    return lines


def class_values(classes: Classes) -> dict[str, list[dict[str, object]]]:
    """Return the tables of classes as plain values for JSON."""
    from dataclasses import asdict

    return {
        name: [{key: _plain(value) for key, value in asdict(row).items()} for row in rows]
        for name, rows in classes.items()
    }


def _plain(value: object) -> object:
    """Return a value for JSON, None for NaN."""
    return None if isinstance(value, float) and math.isnan(value) else value


LARGE = 20_000_000
"""Rasters of more cells are scored in blocks."""
# Ratio of the cells of reference and map from which a note is printed.
_WIDER = 1.5


def score(request: ScoreRequest) -> "ScoreResult":
    """Judge a map by a reference raster or by checkpoints.

    Parameters
    ----------
    request : ScoreRequest
        Map, reference or checkpoints, standards and report.

    Returns
    -------
    ScoreResult
        Error statistics and verdicts; `ScoreResult.write` writes the report.

    Raises
    ------
    InputError
        Input that cannot be used, or a report that exists.
    ConfigError
        An unknown standard, language or form of report.
    """
    request.check()
    if request.checkpoints is None:
        return _score_against_raster(request)
    return _score_at_checkpoints(request, map_of(request.source, request.crs, request.epoch_s))


def preview_score(request: ScoreRequest) -> Preview:
    """Read the map and what it is judged by, and return what was read."""
    from survey import Dem

    request.check()
    map_ = map_of(request.source, request.crs, request.epoch_s)
    dem = map_ if isinstance(map_, Dem) else map_.mean
    facts = {"map": "{} × {} cells".format(*dem.shape)}
    if request.checkpoints is None:
        assert request.truth is not None
        facts["reference"] = "{} × {} cells".format(*Dem.read(request.truth, crs=request.crs).shape)
    else:
        facts["checkpoints"] = str(len(read_checkpoints(request, dem).names))
    return Preview.of([] if request.report is None else [request.report], facts)


@dataclass(frozen=True, kw_only=True)
class ScoreResult(Result):
    """Score of a map.

    Parameters
    ----------
    request : ScoreRequest
        What was asked for.
    judged : Score or CheckpointScore
        Error statistics and verdicts.
    classes : dict
        Statistics by class of ground.
    findings : tuple of str
        Lines after the statistics.
    document : callable
        Makes the report.
    meets : bool
        Whether no wanted class was found to be missed at checkpoints.
    written : pathlib.Path, optional
        The report that was written.
    """

    request: ScoreRequest
    judged: "Score | CheckpointScore"
    classes: Classes
    findings: tuple[str, ...] = ()
    document: "Callable[[], Document]"
    meets: bool = True
    written: Path | None = None

    def write(self, report: Path | None = None) -> "ScoreResult":
        """Write the report, if one is asked for.

        Parameters
        ----------
        report : pathlib.Path, optional
            A folder, or a file ``.html`` or ``.pdf``; that of the request by default.

        Returns
        -------
        ScoreResult
            The result with the place of the report.
        """
        from survey.reporting.document import write_document

        place = report or self.request.report
        return self if place is None else replace(self, written=write_document(place, self.document()))

    @property
    def is_met(self) -> bool:
        """Whether no wanted class was found to be missed at checkpoints."""
        return self.meets

    def facts(self) -> dict[str, Any]:
        """Return statistics and verdicts."""
        by_class = {"classes": class_values(self.classes)} if self.classes else {}
        return {**self.judged.to_dict(), **by_class}

    def lines(self) -> list[str]:
        """Return statistics, findings, and the place of the report."""
        lines = [*figure_lines(self.judged.to_dict()["elevation"]), *self.findings]
        return lines if self.written is None else [*lines, self.report_line]

    @property
    def report_line(self) -> str:
        """Sentence about the report that was written."""
        return f"report written to {self.written}"


def best_class(score: dict[str, Any]) -> str:
    """Return a sentence about the strictest row of the standard that a map meets, from the plain values of a score."""
    from survey.scoring.standards.map_classes import uncovered_sentence
    from survey.scoring.standards.standards import LEAST_COVERED

    verdicts: list[dict[str, Any]] = score["verdicts"]
    if score["covered_share"] < LEAST_COVERED:
        return f"{uncovered_sentence(score['covered_share'])} RMSE on the covered part {verdicts[0]['rmse_m']:.3f} m"
    met = [verdict for verdict in verdicts if verdict["met"]]
    row = met[-1] if met else verdicts[0]
    words = "met, RMSE" if met else "not met, not even the loosest row: RMSE"
    return (
        f"{row['map_class']} at a {row['interval_m']:.4g} m interval ({row['standard']}) {words} "
        f"{row['rmse_m']:.3f} m, limit {row['limit_m']:.4f} m"
    )


def class_met(content: dict[str, Any], wanted: str) -> bool:
    """Return whether the map meets the loosest row of the wanted class, ``class-1`` to ``class-3``."""
    verdicts = content.get("score", {}).get("verdicts", [])
    return any(v["met"] for v in verdicts if v["map_class"].lower().replace(" ", "-") == wanted)


def _score_against_raster(request: ScoreRequest) -> ScoreResult:
    """Judge a map by a reference raster, in blocks where they are large."""
    if _is_large(request):
        return _raster_result(request, _in_blocks(request), {}, (), _no_report)
    import survey

    assert request.truth is not None
    map_, truth = (
        map_of(request.source, request.crs, request.epoch_s),
        survey.Dem.read(request.truth, crs=request.crs),
    )
    area = None if request.area is None else survey.SurveyArea.read(request.area, crs=truth.crs)
    route = None if request.route is None else survey.Route.read(request.route)
    judged = survey.score(map_, truth=truth, route=route, area=area)
    classes = _classes(request, map_, truth, area)
    remarks = (*_datum_remark(map_, truth), *_cell_remark(map_, truth), *_age_remark(map_))
    return _raster_result(
        request,
        judged,
        classes,
        remarks,
        lambda: _reference_report(request, (map_, truth), judged, area, classes),
    )


def _raster_result(
    request: ScoreRequest,
    judged: "Score",
    classes: Classes,
    remarks: tuple[str, ...],
    document: "Callable[[], Document]",
) -> ScoreResult:
    findings = (*class_lines(classes), best_class(judged.to_dict()), *remarks)
    return ScoreResult(request=request, judged=judged, classes=classes, findings=findings, document=document)


def _no_report() -> "Document":
    raise CapacityError(f"rasters of more than {LARGE:,} cells have no report; cut them to the area.")


def _is_large(request: ScoreRequest) -> bool:
    """Return whether the rasters are scored in blocks; refuse what blocks cannot give."""
    from survey.core.errors import CapacityError
    from survey.io.raster import raster_facts

    assert request.truth is not None
    if request.route is not None or not request.source.is_file():
        return False
    files = (request.truth, request.source)
    cells = max(math.prod(raster_facts(file).shape) for file in files)
    if cells > LARGE and (request.report is not None or request.by):
        raise CapacityError(
            f"{request.source} or {request.truth} has {cells:,} cells; --report and --by take up to {LARGE:,}, cut the rasters to the area."
        )
    return cells > LARGE


def _in_blocks(request: ScoreRequest) -> "Score":
    import survey
    from survey.core.crs import agreed_crs
    from survey.io.raster import raster_facts
    from survey.scoring.scores import score_files

    assert request.truth is not None
    system = agreed_crs(raster_facts(request.truth).crs, request.crs, str(request.truth))
    ground = None if request.area is None else survey.SurveyArea.read(request.area, crs=system)
    return score_files(request.source, request.truth, ground, crs=request.crs)


def _classes(
    request: ScoreRequest, map_: "Reconstruction | Dem", truth: "Dem", area: "SurveyArea | None"
) -> Classes:
    """Return the statistics by class, at the nodes that are scored."""
    from survey.scoring.scores import compare_nodes, mean_and_std

    if not request.by:
        return {}
    mean, std = mean_and_std(map_)
    compared = compare_nodes(mean, std, truth, area)
    return scores_by_class(request, compared.errors, compared.std, mean.xy[compared.scored], truth)


def _datum_remark(map_: "Reconstruction | Dem", truth: "Dem") -> list[str]:
    """Return a note where one of map and reference alone states its vertical datum."""
    from survey import Dem

    mean = map_ if isinstance(map_, Dem) else map_.mean
    if bool(mean.vertical_datum) == bool(truth.vertical_datum):
        return []
    stated, unstated = ("map", "reference") if mean.vertical_datum else ("reference", "map")
    return [
        f"  note: the {stated} states {mean.vertical_datum or truth.vertical_datum}, and the {unstated} no vertical datum; "
        "tens of metres can hide there"
    ]


def _cell_remark(map_: "Reconstruction | Dem", truth: "Dem") -> list[str]:
    """Return a note where the cells of the reference are wider than those of the map."""
    from survey import Dem

    step_m = (map_ if isinstance(map_, Dem) else map_.mean).step_m
    if truth.step_m <= _WIDER * step_m:
        return []
    return [
        f"  note: the cells of the reference are {truth.step_m:g} m wide and those of the map {step_m:g} m; "
        "relief between the cells of the reference counts as an error of the map"
    ]


def _age_remark(map_: "Reconstruction | Dem") -> list[str]:
    """Return the motion of the ice and for how long the map holds its class, where the map states them."""
    from survey import Dem
    from survey.scoring.standards.map_classes import stated_age

    age = None if isinstance(map_, Dem) else stated_age(map_)
    return [] if age is None else [age]


def _reference_report(
    request: ScoreRequest,
    compared: tuple["Reconstruction | Dem", "Dem"],
    judged: "Score",
    area: "SurveyArea | None",
    classes: Classes,
) -> "Document":
    from survey.reporting.accuracy import ReportSetting, reference_report

    assert request.truth is not None
    inputs = {"Map": request.source.name, "Reference": request.truth.name}
    setting = ReportSetting(request.source.stem, today(), inputs, request.language)
    return reference_report(setting, *compared, judged, area=area, classes=classes)


def _score_at_checkpoints(request: ScoreRequest, map_: "Reconstruction | Dem") -> ScoreResult:
    """Judge a map by checkpoints."""
    import survey
    from survey.scoring import compare, score_at

    dem = map_ if isinstance(map_, survey.Dem) else map_.mean
    points = read_checkpoints(request, dem)
    area = None if request.area is None else survey.SurveyArea.read(request.area, crs=dem.crs)
    errors = compare(dem, points, area)
    judged = score_at(
        errors,
        tuple(request.standards),
        class_m=request.class_m,
        interval_m=request.interval_m,
        horizontal_class_m=request.horizontal_class_m,
    )
    classes = _classes_at_checkpoints(request, map_, dem, errors)
    return ScoreResult(
        request=request,
        judged=judged,
        classes=classes,
        findings=tuple(_checkpoint_findings(judged, classes)),
        document=lambda: _checkpoint_document(request, dem, errors, judged, area=area, classes=classes),
        meets=all(finding.outcome != "not met" for finding in judged.assessments),
    )


def read_checkpoints(request: ScoreRequest, dem: "Dem") -> "Checkpoints":
    """Read the checkpoints, and refuse those that the map was made from."""
    from survey.io.column_names import parse_columns
    from survey.scoring import Checkpoints
    from survey.scoring.standards.checkpoints import control_places

    assert request.checkpoints is not None
    points = Checkpoints.read(
        request.checkpoints,
        crs=dem.crs,
        sigma_m=request.sigma_m,
        vertical_datum=request.datum,
        columns=parse_columns(request.columns),
    )
    if request.control is not None:
        points.refuse_control(control_places(request.control, dem.crs))
    return points


def _classes_at_checkpoints(
    request: ScoreRequest, map_: "Reconstruction | Dem", dem: "Dem", errors: "CheckpointErrors"
) -> Classes:
    """Return the statistics by class; deviations are those of map and checkpoint together."""
    import numpy as np

    import survey

    if not request.by or errors.xyz is None:
        return {}
    xy = errors.xyz[:, :2]
    claimed = np.full(len(xy), np.nan) if isinstance(map_, survey.Dem) else map_.std.at(xy)
    return scores_by_class(request, errors.errors_m, np.hypot(claimed, errors.sigma_z_m), xy, dem)


def _checkpoint_findings(judged: "CheckpointScore", classes: Classes) -> list[str]:
    """Return interval, points left out, classes and verdicts as lines."""
    low, high = judged.interval.low_m, judged.interval.high_m
    lines = [fact_line("RMSE, 95 %", f"{low:.3f} to {high:.3f} m ({judged.interval.method})")]
    if judged.left_out:
        lines.append(f"no height at {', '.join(judged.left_out)}")
    if judged.n_outside:
        lines.append(f"{judged.n_outside} checkpoints lie outside the area that is judged and are left out")
    lines += class_lines(classes)
    for finding in judged.assessments:
        lines += [finding.sentence, *(f"  note: {caution}" for caution in finding.cautions)]
    return lines


def _checkpoint_document(
    request: ScoreRequest,
    dem: "Dem",
    errors: "CheckpointErrors",
    judged: "CheckpointScore",
    *,
    area: "SurveyArea | None",
    classes: Classes,
) -> "Document":
    from survey.reporting.accuracy import ReportSetting, checkpoint_report

    inputs = {
        "Map": request.source.name,
        "Checkpoints": str(request.checkpoints and request.checkpoints.name),
    }
    setting = ReportSetting(request.source.stem, today(), inputs, request.language)
    return checkpoint_report(setting, dem, errors, judged, area=area, classes=classes)
