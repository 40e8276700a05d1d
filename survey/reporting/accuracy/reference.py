"""Accuracy report of a map against a reference raster."""

import numpy as np

from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.figures.errors import error_map, height_error
from survey.reconstruction.base import INTERPOLATED, Reconstruction
from survey.reporting.accuracy.methods import HOEHLE
from survey.reporting.accuracy.parts import (
    ReportSetting,
    class_table,
    distribution_figures,
    facts_table,
    methods_section,
    statistics_facts,
)
from survey.reporting.document import Chapter, Document, DrawnFigure, Table
from survey.reporting.quantities import number, percent
from survey.scoring.class_scores import ClassScore
from survey.scoring.score import Score


def reference_report(
    setting: ReportSetting,
    map_: Dem | Reconstruction,
    truth: Dem,
    score: Score,
    *,
    area: SurveyArea | None = None,
    classes: dict[str, tuple[ClassScore, ...]] | None = None,
) -> Document:
    """Compose the accuracy report of a map against a reference raster.

    It holds no statement of a standard: those rest on independent checkpoints.

    Parameters
    ----------
    setting : ReportSetting
        Title, date, names of the inputs.
    map_ : Dem or Reconstruction
        The map.
    truth : Dem
        The reference.
    score : Score
        Of the same two.
    area : SurveyArea, optional
        The area that was judged.
    classes : dict of str to tuple of ClassScore, optional
        Error statistics by class, by the name of the classification.

    Returns
    -------
    Document
        Statistics, classes of the RMSE, figures and citations.
    """
    surveyed = map_ if isinstance(map_, Reconstruction) else _without_claim(map_)
    error = height_error(surveyed, truth, area)
    known = error[np.isfinite(error)]
    figures = (
        DrawnFigure(
            "error_map",
            error_map(surveyed, truth, area=area),
            "Map of the error",
            "Red: the map lies too high, blue: too low. The limits hold 99 % of the errors.",
        ),
        *distribution_figures(known, score.elevation),
    )
    grouped = tuple(class_table(name, rows) for name, rows in (classes or {}).items())
    sections = [
        Chapter("What was compared", tables=(_inputs(setting, surveyed.mean, score),)),
        Chapter(
            "Error statistics", tables=(facts_table("statistics", "Errors, map minus reference", _facts(score)),)
        ),
        Chapter("Figures", figures=figures),
        *([Chapter("Errors by class of ground", tables=grouped)] if grouped else []),
        Chapter("Classes of the RMSE", paragraphs=(_NO_STATEMENT, score.verdicts[0].note), tables=(_classes(score),)),
        methods_section([HOEHLE]),
    ]  # fmt: skip
    return Document("Accuracy report", setting.title, setting.subtitle, tuple(sections), setting.signature)


_NO_STATEMENT = (
    "A raster is no set of independent checkpoints, so no statement of a standard is made; neighbouring nodes err alike. "
    "Name checkpoints with --checkpoints for a statement."
)


def _without_claim(dem: Dem) -> Reconstruction:
    """Return a map that states no standard deviation, as the figures of errors take it."""
    unknown = Dem(np.full(dem.shape, np.nan), dem.transform, dem.crs, dem.vertical_datum)
    return Reconstruction(dem, unknown, np.full(dem.shape, INTERPOLATED), "outside", {})


def _inputs(setting: ReportSetting, dem: Dem, score: Score) -> Table:
    facts = {
        **setting.inputs,
        "Coordinates": dem.crs.name,
        "Heights above": dem.vertical_datum or "an unstated datum",
        "Cells of the map": f"{dem.step_m:g} m, {dem.shape[1]} × {dem.shape[0]}",
        "Area covered by the map": percent(score.covered_share),
    }
    return facts_table("inputs", "Map and reference", facts)


def _facts(score: Score) -> dict[str, str]:
    facts = statistics_facts(score.elevation)
    if score.calibration.n:
        facts["Errors within 1.96 σ"] = f"{percent(score.calibration.coverage_95)} (95 % where σ is right)"
        facts["RMS of error / σ"] = number(score.calibration.z_rms, decimals=2)
    return facts


def _classes(score: Score) -> Table:
    rows = tuple(
        (
            it.map_class,
            "met" if it.met else "not met",
            f"{it.interval_m:.4f}",
            f"{it.limit_m:.4f}",
            number(it.rmse_m),
        )
        for it in score.verdicts
    )
    headings = ("Class", "Verdict", "Contour interval [m]", "Limit [m]", "RMSE [m]")
    return Table("classes", f"RMSE of the surface beside {score.verdicts[0].standard}", headings, rows, 2)
