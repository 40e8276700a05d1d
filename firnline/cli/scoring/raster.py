"""Score of a map against a reference raster, in memory or in blocks."""

import math
from typing import TYPE_CHECKING

import typer

from firnline.cli.scoring.ground_classes import Classes, class_lines, class_values, scores_by_class
from firnline.cli.scoring.maps import map_of
from firnline.cli.scoring.output import print_statistics, today, written
from firnline.cli.scoring.request import ScoreRequest

if TYPE_CHECKING:
    from survey import Dem, Reconstruction, Score, SurveyArea

LARGE = 20_000_000
"""Rasters of more cells are scored in blocks."""
# Ratio of the cells of reference and map from which a note is printed.
_WIDER = 1.5


def score_against_raster(request: ScoreRequest) -> None:
    """Judge a map against a reference raster, print the score, and write the report that was asked for."""
    if _is_large(request):
        _print(request, _in_blocks(request), {})
        return
    import survey

    assert request.truth is not None
    map_, truth = (
        map_of(request.source, request.crs, request.epoch_s),
        survey.Dem.read(request.truth, crs=request.crs),
    )
    area = None if request.area is None else survey.SurveyArea.read(request.area, crs=truth.crs)
    route = None if request.route is None else survey.Route.read(request.route)
    score = survey.score(map_, truth=truth, route=route, area=area)
    classes = _classes(request, map_, truth, area)
    _print(request, score, classes)
    _print_datums(request, map_, truth)
    _print_cells(request, map_, truth)
    _print_age(request, map_)
    if request.report is not None:
        _write_report(request, (map_, truth), score, area, classes)


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
    from survey.scoring.blocks import score_files

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


def _print(request: ScoreRequest, score: "Score", classes: Classes) -> None:
    import json

    from firnline.cli.mission_file import best_class

    judged = score.to_dict()
    if request.as_json:
        by_class = {"classes": class_values(classes)} if classes else {}
        typer.echo(json.dumps({**judged, **by_class}, indent=2))
        return
    print_statistics(judged["elevation"])
    for line in class_lines(classes):
        typer.echo(line)
    typer.echo(best_class(judged))


def _print_datums(request: ScoreRequest, map_: "Reconstruction | Dem", truth: "Dem") -> None:
    """Print a note where one of map and reference alone states its vertical datum."""
    from survey import Dem

    mean = map_ if isinstance(map_, Dem) else map_.mean
    if bool(mean.vertical_datum) != bool(truth.vertical_datum) and not request.as_json:
        stated, unstated = ("map", "reference") if mean.vertical_datum else ("reference", "map")
        typer.echo(
            f"  note: the {stated} states {mean.vertical_datum or truth.vertical_datum}, and the {unstated} no vertical datum; "
            "tens of metres can hide there"
        )


def _print_cells(request: ScoreRequest, map_: "Reconstruction | Dem", truth: "Dem") -> None:
    """Print a note where the cells of the reference are wider than those of the map."""
    from survey import Dem

    step_m = (map_ if isinstance(map_, Dem) else map_.mean).step_m
    if truth.step_m > _WIDER * step_m and not request.as_json:
        typer.echo(
            f"  note: the cells of the reference are {truth.step_m:g} m wide and those of the map {step_m:g} m; "
            "relief between the cells of the reference counts as an error of the map"
        )


def _print_age(request: ScoreRequest, map_: "Reconstruction | Dem") -> None:
    """Print the motion of the ice and for how long the map holds its class, where the map states them."""
    from survey import Dem
    from survey.scoring.standards.map_classes import stated_age

    age = None if isinstance(map_, Dem) or request.as_json else stated_age(map_)
    if age is not None:
        typer.echo(age)


def _write_report(
    request: ScoreRequest,
    compared: tuple["Reconstruction | Dem", "Dem"],
    score: "Score",
    area: "SurveyArea | None",
    classes: Classes,
) -> None:
    from survey.reporting.accuracy import ReportSetting, reference_report

    assert request.truth is not None
    inputs = {"Map": request.source.name, "Reference": request.truth.name}
    setting = ReportSetting(request.source.stem, today(), inputs, request.language)
    written(request, reference_report(setting, *compared, score, area=area, classes=classes))
