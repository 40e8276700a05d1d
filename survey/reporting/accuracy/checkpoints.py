"""Accuracy report of a map at checkpoints, with the statements of the standards."""

import numpy as np

from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.figures.residuals import residual_map
from survey.reporting.accuracy.methods import BY_STANDARD, HOEHLE
from survey.reporting.accuracy.parts import (
    ReportSetting,
    class_table,
    distribution_figures,
    facts_table,
    methods_section,
    statistics_facts,
)
from survey.reporting.document import Chapter, Document, DrawnFigure, Table
from survey.reporting.document.content import Statement
from survey.reporting.quantities import number, percent
from survey.reporting.statements import statement, template
from survey.scoring.class_scores import ClassScore
from survey.scoring.standards.assessment import CheckpointScore
from survey.scoring.standards.checkpoint_errors import CheckpointErrors
from survey.scoring.standards.findings import Assessment

_ADVISED_SHARE, _ADVISED_SPACING = 0.20, 0.10


def checkpoint_report(
    setting: ReportSetting,
    dem: Dem,
    errors: CheckpointErrors,
    score: CheckpointScore,
    *,
    area: SurveyArea | None = None,
    classes: dict[str, tuple[ClassScore, ...]] | None = None,
) -> Document:
    """Compose the accuracy report of a map at checkpoints.

    Parameters
    ----------
    setting : ReportSetting
        Title, date, names of the inputs, language.
    dem : Dem
        The map.
    errors : CheckpointErrors
        From `compare`.
    score : CheckpointScore
        From `score_at`, of the same errors.
    area : SurveyArea, optional
        The area that was judged.
    classes : dict of str to tuple of ClassScore, optional
        Error statistics by class, by the name of the classification.

    Returns
    -------
    Document
        Statements, statistics, residual table, figures, distribution of the points, citations, signature.
    """
    figures = (
        DrawnFigure(
            "residual_map",
            residual_map(errors, dem, area),
            "Map of the residuals at the checkpoints",
            "Residuals over the relief of the map; red: the map lies too high, blue: too low.",
        ),
        *distribution_figures(errors.errors_m, score.elevation),
    )
    grouped = tuple(class_table(name, rows) for name, rows in (classes or {}).items())
    sections = [
        Chapter("Accuracy statement", _statements(score, setting.language), _notes(score)),
        Chapter("What was compared", tables=(_inputs(setting, dem, errors),)),
        Chapter("Error statistics", tables=(_statistics(score),), figures=figures),
        *([Chapter("Errors by class of ground", tables=grouped)] if grouped else []),
        Chapter("Distribution of the checkpoints", paragraphs=_spread(errors)),
        Chapter("Residuals", tables=(_residuals(errors), *_shifts(errors))),
        methods_section([*(BY_STANDARD[it.standard] for it in score.assessments), HOEHLE]),
    ]
    return Document("Accuracy report", setting.title, setting.subtitle, tuple(sections), setting.signature)


def _statements(score: CheckpointScore, language: str) -> tuple[Statement, ...]:
    """Return each statement in English and, where another language was chosen, in that one."""
    found = [(statement(it), it) for it in _stated(score.assessments)]
    quoted = [Statement(text) for text, _ in found]
    if language != "en":
        note = template(language)["words"]["translation"]
        quoted += [Statement(statement(it, language), language, note) for _, it in found]
    return tuple(quoted)


def _stated(assessments: tuple[Assessment, ...]) -> list[Assessment]:
    """Leave out the looser classes of ASPRS 1990 where a tighter one of the same interval is met."""
    stated, met = [], set()
    for it in assessments:
        interval = (it.standard, it.map_class.partition(", ")[2])
        if interval in met:
            continue
        stated.append(it)
        if it.standard.startswith("asprs-1990") and it.outcome == "met":
            met.add(interval)
    return stated


def _notes(score: CheckpointScore) -> tuple[str, ...]:
    """Return what the statements rest on: edition, number of points, cautions."""
    bases = [
        f"{it.edition}: {it.outcome}; {it.n} checkpoints, accurate to {it.checkpoint_rmse_m:.3g} m."
        for it in score.assessments
    ]
    cautions = [f"Note: {caution}." for it in score.assessments for caution in it.cautions]
    is_tested = any(it.kind == "horizontal" for it in score.assessments)
    untested = [] if is_tested else [template("en")["own"]["horizontal"]]
    return tuple(dict.fromkeys([*bases, *untested, *cautions]))


def _inputs(setting: ReportSetting, dem: Dem, errors: CheckpointErrors) -> Table:
    east, north, high, top = dem.bounds
    facts = {
        **setting.inputs,
        "Coordinates": dem.crs.name,
        "Heights above": dem.vertical_datum or "an unstated datum",
        "Cells of the map": f"{dem.step_m:g} m, {dem.shape[1]} × {dem.shape[0]}",
        "Bounds of the map": f"E {east:.1f} to {high:.1f}, N {north:.1f} to {top:.1f} m",
        "Checkpoints used": str(len(errors.errors_m)),
        "Accuracy of the checkpoints": f"{errors.checkpoint_rmse_m:.3f} m (root mean square of their σ)",
        "Without a height in the map": ", ".join(errors.left_out) or "none",
        "Outside the area": str(errors.n_outside),
        "Area covered by the map": percent(errors.covered_share),
    }
    return facts_table("inputs", "Map and checkpoints", facts)


def _statistics(score: CheckpointScore) -> Table:
    interval = score.interval
    facts = statistics_facts(score.elevation)
    facts["95 % interval of the RMSE"] = (
        f"{interval.low_m:.3f} to {interval.high_m:.3f} m ({interval.method})"
    )
    return facts_table("statistics", "Errors, map minus checkpoint", facts)


def _spread(errors: CheckpointErrors) -> tuple[str, ...]:
    spread = errors.spread
    quarters = ("south-west", "south-east", "north-west", "north-east")
    shares = ", ".join(
        f"{name} {share:.0%}" for name, share in zip(quarters, spread.quadrant_shares, strict=True)
    )
    is_even = min(spread.quadrant_shares) >= _ADVISED_SHARE and spread.spacing_share >= _ADVISED_SPACING
    return (
        f"Shares of the checkpoints in the quarters of the area: {shares}. Least distance between two of them: "
        f"{spread.spacing_share:.1%} of the diagonal.",
        f"Guidance (NSSDA, appendix 3-C): at least {_ADVISED_SHARE:.0%} in each quarter and {_ADVISED_SPACING:.0%} of the "
        f"diagonal between any two; these points {'follow' if is_even else 'do not follow'} it. It is no condition of a statement.",
    )  # fmt: skip


def _residuals(errors: CheckpointErrors) -> Table:
    """Return one row for each checkpoint, the largest residuals marked."""
    headings = ("Checkpoint", "Ground", "Easting [m]", "Northing [m]", "Height [m]", "σ [m]", "Map [m]", "Residual [m]")  # fmt: skip
    xyz = np.full((len(errors.names), 3), np.nan) if errors.xyz is None else errors.xyz
    rows = tuple(
        (
            name,
            "vegetated" if vegetated else "open",
            f"{x:.2f}",
            f"{y:.2f}",
            f"{z:.3f}",
            f"{sigma:.3f}",
            f"{z + error:.3f}",
            number(round(error, 3) + 0.0),
        )
        for name, vegetated, (x, y, z), sigma, error in zip(
            errors.names, errors.vegetated, xyz, errors.sigma_z_m, errors.errors_m, strict=True
        )
    )
    return Table("residuals", "Residual at each checkpoint, map minus checkpoint", headings, rows, 2)


def _shifts(errors: CheckpointErrors) -> tuple[Table, ...]:
    """Return a table of the horizontal residuals of checkpoints that were found in the map; none without them."""
    placed = errors.placed
    if placed is None or placed.shift_m is None or placed.sigma_xy_m is None:
        return ()
    headings = ("Checkpoint", "East [m]", "North [m]", "Distance [m]", "σ [m]")
    rows = tuple(
        (name, number(east), number(north), number(float(np.hypot(east, north))), number(sigma))
        for name, (east, north), sigma in zip(
            placed.names, placed.shift_m.round(3) + 0.0, placed.sigma_xy_m, strict=True
        )
    )
    return (Table("shifts", "Horizontal residual at each checkpoint, map minus checkpoint", headings, rows),)
