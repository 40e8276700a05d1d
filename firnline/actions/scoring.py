"""Judge a map by a reference raster or by checkpoints: error statistics, classes of ground, map class, report."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import survey
from firnline.actions.interface import Preview, Result, area_if_named, fact_line, figure_lines, previewed_by
from firnline.actions.score_request import (
    Classes,
    ScoreRequest,
    class_lines,
    class_values,
    map_of,
    scores_by_class,
    today,
)
from survey.core import CapacityError

if TYPE_CHECKING:
    from survey.reporting.document import Document
    from survey.scoring import CheckpointErrors, Checkpoints, CheckpointScore


LARGE = 20_000_000
"""Rasters of more cells are scored in blocks."""
# Ratio of the cells of reference and map from which a note is printed.
_WIDER = 1.5


def preview_score(request: ScoreRequest) -> Preview:
    """Read the map and what it is judged by, and return what was read."""
    request.check()
    map_ = _map_of(request)
    dem = map_ if isinstance(map_, survey.Dem) else map_.mean
    facts = {"map": "{} × {} cells".format(*dem.shape)}
    if request.checkpoints is None:
        facts["reference"] = "{} × {} cells".format(*_reference(request).shape)
    else:
        facts["checkpoints"] = str(len(read_checkpoints(request, dem).names))
    return Preview.of([] if request.report is None else [request.report], facts)


@previewed_by(preview_score)
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
    return _score_at_checkpoints(request, _map_of(request))


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
    judged: "survey.Score | CheckpointScore"
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
        place = report or self.request.report
        if place is None:
            return self
        from survey.reporting.document import write_document

        return replace(self, written=write_document(place, self.document(), self.request.pictures))

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
    """Return a sentence about the class of ASPRS Edition 2 that a map meets, from the plain values of a score."""
    from survey.scoring.standards.map_classes import edition_2_sentence

    return edition_2_sentence(score["elevation"]["rmse_m"], score["covered_share"])


def class_met(content: dict[str, Any], wanted: str) -> bool:
    """Return whether the map meets the loosest row of the wanted class, ``class-1`` to ``class-3``."""
    verdicts = content.get("score", {}).get("verdicts", [])
    return any(v["met"] for v in verdicts if v["map_class"].lower().replace(" ", "-") == wanted)


def _score_against_raster(request: ScoreRequest) -> ScoreResult:
    """Judge a map by a reference raster, in blocks where they are large."""
    if _is_large(request):
        return _raster_result(request, _in_blocks(request), {}, (), _no_report)
    map_, truth = _map_of(request), _reference(request)
    area = area_if_named(request.area, request, truth.crs)
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


def _map_of(request: ScoreRequest) -> "survey.Reconstruction | survey.Dem":
    return map_of(request.source, request.crs, request.epoch_s, request.units, request.datum)


def _reference(request: ScoreRequest) -> "survey.Dem":
    assert request.truth is not None
    read = map_of(request.truth, request.crs, units=request.units, datum=request.datum)
    return read if isinstance(read, survey.Dem) else read.mean


def _raster_result(
    request: ScoreRequest,
    judged: "survey.Score",
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
    from survey.io.raster import raster_facts

    assert request.truth is not None
    if request.route is not None or not request.source.is_file():
        return False
    files = (request.truth, request.source)
    cells = max(math.prod(raster_facts(file, request.units).shape) for file in files)
    if cells > LARGE and (request.report is not None or request.by):
        raise CapacityError(
            f"{request.source} or {request.truth} has {cells:,} cells; --report and --by take up to {LARGE:,}, cut the rasters to the area."
        )
    return cells > LARGE


def _in_blocks(request: ScoreRequest) -> "survey.Score":
    from survey.core import agreed_crs
    from survey.io.raster import raster_facts
    from survey.scoring.scores import score_files

    assert request.truth is not None
    system = agreed_crs(raster_facts(request.truth, request.units).crs, request.crs, str(request.truth))
    ground = area_if_named(request.area, request, system)
    return score_files(request.source, request.truth, ground, crs=request.crs, units=request.units)


def _classes(
    request: ScoreRequest,
    map_: "survey.Reconstruction | survey.Dem",
    truth: "survey.Dem",
    area: "survey.SurveyArea | None",
) -> Classes:
    """Return the statistics by class, at the nodes that are scored."""
    from survey.scoring.scores import compare_nodes, mean_and_std

    if not request.by:
        return {}
    mean, std = mean_and_std(map_)
    compared = compare_nodes(mean, std, truth, area)
    return scores_by_class(request, compared.errors, compared.std, mean.xy[compared.scored], truth)


def _datum_remark(map_: "survey.Reconstruction | survey.Dem", truth: "survey.Dem") -> list[str]:
    """Return a note where map, reference or both do not state their vertical datum."""
    mean = map_ if isinstance(map_, survey.Dem) else map_.mean
    if mean.vertical_datum and truth.vertical_datum:
        return []
    if not (mean.vertical_datum or truth.vertical_datum):
        return ["  note: neither map nor reference states its vertical datum; tens of metres can hide there"]
    stated, unstated = ("map", "reference") if mean.vertical_datum else ("reference", "map")
    return [
        f"  note: the {stated} states {mean.vertical_datum or truth.vertical_datum}, and the {unstated} no vertical datum; "
        "tens of metres can hide there"
    ]


def _cell_remark(map_: "survey.Reconstruction | survey.Dem", truth: "survey.Dem") -> list[str]:
    """Return a note where the cells of the reference are wider than those of the map."""
    step_m = (map_ if isinstance(map_, survey.Dem) else map_.mean).step_m
    if truth.step_m <= _WIDER * step_m:
        return []
    return [
        f"  note: the cells of the reference are {truth.step_m:g} m wide and those of the map {step_m:g} m; "
        "relief between the cells of the reference counts as an error of the map"
    ]


def _age_remark(map_: "survey.Reconstruction | survey.Dem") -> list[str]:
    """Return the motion of the ice and for how long the map holds its class, where the map states them."""
    from survey.scoring.standards.map_classes import stated_age

    age = None if isinstance(map_, survey.Dem) else stated_age(map_)
    return [] if age is None else [age]


def _reference_report(
    request: ScoreRequest,
    compared: tuple["survey.Reconstruction | survey.Dem", "survey.Dem"],
    judged: "survey.Score",
    area: "survey.SurveyArea | None",
    classes: Classes,
) -> "Document":
    from survey.reporting.accuracy import ReportSetting, reference_report

    assert request.truth is not None
    inputs = {**request.stated, "Map": request.source.name, "Reference": request.truth.name}
    setting = ReportSetting(request.source.stem, today(), inputs, request.language)
    return reference_report(setting, *compared, judged, area=area, classes=classes)


def _score_at_checkpoints(request: ScoreRequest, map_: "survey.Reconstruction | survey.Dem") -> ScoreResult:
    """Judge a map by checkpoints."""
    dem = map_ if isinstance(map_, survey.Dem) else map_.mean
    points = read_checkpoints(request, dem)
    from survey.scoring import compare, score_at  # what cannot be read is refused before their imports

    area = area_if_named(request.area, request, dem.crs)
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


def read_checkpoints(request: ScoreRequest, dem: "survey.Dem") -> "Checkpoints":
    """Read the checkpoints, and refuse those that the map was made from."""
    from survey.io.column_names import parse_columns
    from survey.scoring import Checkpoints
    from survey.scoring.standards.checkpoints import control_places

    assert request.checkpoints is not None
    points = Checkpoints.read(
        request.checkpoints,
        crs=_as_named(request.crs, dem),
        sigma_m=request.sigma_m,
        vertical_datum=request.datum,
        columns=parse_columns(request.columns, layout=request.layout),
        units=request.units,
    )
    if request.control is not None:
        points.refuse_control(control_places(request.control, dem.crs))
    return points


def _as_named(crs: str | None, dem: "survey.Dem") -> Any:
    """Return the CRS of checkpoints that state none: that of the map, or its twin in feet where that was named."""
    from survey.core.crs import equal_crs, projected_crs
    from survey.core.transformation import metric_crs

    if crs is None or not equal_crs(projected_crs(metric_crs(crs, "--crs").crs, "--crs"), dem.crs):
        return dem.crs
    return crs


def _classes_at_checkpoints(
    request: ScoreRequest,
    map_: "survey.Reconstruction | survey.Dem",
    dem: "survey.Dem",
    errors: "CheckpointErrors",
) -> Classes:
    """Return the statistics by class; deviations are those of map and checkpoint together."""
    import numpy as np

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
    dem: "survey.Dem",
    errors: "CheckpointErrors",
    judged: "CheckpointScore",
    *,
    area: "survey.SurveyArea | None",
    classes: Classes,
) -> "Document":
    from survey.reporting.accuracy import ReportSetting, checkpoint_report

    inputs = {
        **request.stated,
        "Map": request.source.name,
        "Checkpoints": str(request.checkpoints and request.checkpoints.name),
    }
    setting = ReportSetting(request.source.stem, today(), inputs, request.language)
    return checkpoint_report(setting, dem, errors, judged, area=area, classes=classes)
