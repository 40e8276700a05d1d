"""Score of a map at checkpoints."""

from typing import TYPE_CHECKING

import typer

from firnline.cli.facts import fact_line
from firnline.cli.outcome import NOT_MET
from firnline.cli.scoring.ground_classes import Classes, class_lines, class_values, scores_by_class
from firnline.cli.scoring.output import print_statistics, today, written
from firnline.cli.scoring.request import ScoreRequest

if TYPE_CHECKING:
    from survey import Dem, Reconstruction, SurveyArea
    from survey.scoring import Checkpoints
    from survey.scoring.standards.assessment import CheckpointScore
    from survey.scoring.standards.checkpoint_errors import CheckpointErrors


def score_at_checkpoints(request: ScoreRequest, map_: "Reconstruction | Dem") -> None:
    """Judge a map by checkpoints, print the findings, and write the report; exit code 5 where a wanted class is not met."""
    import json

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
    classes = _classes(request, map_, dem, errors)
    if request.as_json:
        by_class = {"classes": class_values(classes)} if classes else {}
        typer.echo(json.dumps({**judged.to_dict(), **by_class}, indent=2))
    else:
        _print(judged, classes)
    if request.report is not None:
        _write_report(request, dem, errors, judged, area, classes)
    if any(finding.outcome == "not met" for finding in judged.assessments):
        raise typer.Exit(NOT_MET)


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


def _classes(
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


def _print(judged: "CheckpointScore", classes: Classes) -> None:
    print_statistics(judged.to_dict()["elevation"])
    low, high = judged.interval.low_m, judged.interval.high_m
    typer.echo(fact_line("RMSE, 95 %", f"{low:.3f} to {high:.3f} m ({judged.interval.method})"))
    if judged.left_out:
        typer.echo(f"no height at {', '.join(judged.left_out)}")
    if judged.n_outside:
        typer.echo(f"{judged.n_outside} checkpoints lie outside the area that is judged and are left out")
    for line in class_lines(classes):
        typer.echo(line)
    for finding in judged.assessments:
        typer.echo(finding.sentence)
        for caution in finding.cautions:
            typer.echo(f"  note: {caution}")


def _write_report(
    request: ScoreRequest,
    dem: "Dem",
    errors: "CheckpointErrors",
    judged: "CheckpointScore",
    area: "SurveyArea | None",
    classes: Classes,
) -> None:
    from survey.reporting.accuracy import ReportSetting, checkpoint_report

    inputs = {
        "Map": request.source.name,
        "Checkpoints": str(request.checkpoints and request.checkpoints.name),
    }
    setting = ReportSetting(request.source.stem, today(), inputs, request.language)
    written(request, checkpoint_report(setting, dem, errors, judged, area=area, classes=classes))
