"""Reports of a map's accuracy, and of the change between two surveys.

`checkpoint_report` holds the statements of the standards, `reference_report` the errors against a reference raster,
`change_report` volumes and masses with their errors. They share their sections on inputs, methods and standards, and
return documents, which `survey.reporting.document` writes.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from shapely import MultiPolygon, Polygon

from survey.core import FloatArray
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.figures.errors import (
    error_map,
    height_error,
    residual_histogram,
    residual_map,
    residual_quantiles,
)
from survey.figures.maps import change_map
from survey.reconstruction.terrain_map import INTERPOLATED, Reconstruction
from survey.reporting.document import Chapter, Document, DrawnFigure, Statement, Table
from survey.reporting.quantities import number, percent, rounded
from survey.reporting.statements import statement, template
from survey.scoring import Change, ErrorStatistics, Score
from survey.scoring.class_scores import ClassScore
from survey.scoring.standards.assessment import Assessment, CheckpointScore
from survey.scoring.standards.checkpoint_errors import CheckpointErrors
from survey.scoring.standards.checkpoints import LEAST_SHARE, LEAST_SPACING
from survey.scoring.standards.map_classes import edition_2_sentence

NSSDA = "FGDC (1998): Geospatial Positioning Accuracy Standards, Part 3: National Standard for Spatial Data Accuracy. FGDC-STD-007.3-1998."
ASPRS_2014 = "ASPRS (2014): Positional Accuracy Standards for Digital Geospatial Data, Edition 1, Version 1.0. Photogrammetric Engineering & Remote Sensing 81(3), A1–A26."
ASPRS_EDITION_2 = (
    "ASPRS (2024): Positional Accuracy Standards for Digital Geospatial Data, Edition 2, Version 2."
)
ASPRS_1990 = "ASPRS (1990): Accuracy Standards for Large-Scale Maps."
NMAS = "US Bureau of the Budget (1947): United States National Map Accuracy Standards."
HOEHLE = "Höhle, J., Höhle, M. (2009): Accuracy assessment of digital elevation models by means of robust statistical methods. ISPRS Journal of Photogrammetry and Remote Sensing 64(4), 398–406. doi:10.1016/j.isprsjprs.2009.02.003 (median, NMAD, quantiles)."
ROLSTAD = "Rolstad, C., Haug, T., Denby, B. (2009): Spatially integrated geodetic glacier mass balance and its uncertainty based on geostatistical analysis. Journal of Glaciology 55(192), 666–680 (errors of averages with correlated errors)."
HUSS = "Huss, M. (2013): Density assumptions for converting geodetic glacier volume change to mass change. The Cryosphere 7, 877–887."
NUTH = "Nuth, C., Kääb, A. (2011): Co-registration and bias corrections of satellite elevation data sets for quantifying glacier thickness change. The Cryosphere 5, 271–290."

BY_STANDARD = {
    "nssda-1998": NSSDA, "asprs-2014": ASPRS_2014, "asprs-edition-2": ASPRS_EDITION_2,
    "asprs-1990-spot-heights": ASPRS_1990, "asprs-1990-contours": ASPRS_1990, "nmas-1947": NMAS,
}  # fmt: skip
"""Citation of each standard that judges checkpoints."""


@dataclass(frozen=True)
class ReportSetting:
    """Names and settings that a report states.

    `title`: name of the map or survey. `date`: date of the report. `inputs`: what was compared: name of each
    role with its file. `language`: language of the statements beside English.
    """

    title: str
    date: str
    inputs: dict[str, str] = field(default_factory=dict)
    language: str = "en"

    @property
    def subtitle(self) -> str:
        """Date and program."""
        return f"{self.date}, made with firnline"

    @property
    def signature(self) -> tuple[str, ...]:
        """Labels of the lines to sign on, in English and in the language of the statement."""
        labels = ("tested_by", "licence", "date", "signature")
        english, local = template("en")["words"], template(self.language)["words"]
        if self.language == "en":
            return tuple(english[label] for label in labels)
        return tuple(f"{english[label]} / {local[label]}" for label in labels)


def facts_table(name: str, caption: str, facts: dict[str, str]) -> Table:
    """Return a table of names and values."""
    return Table(name, caption, ("Quantity", "Value"), tuple(facts.items()), n_text_columns=2)


def statistics_facts(statistics: ErrorStatistics) -> dict[str, str]:
    """Return error statistics as text."""
    return {
        "Number": f"{statistics.n:,}".replace(",", "\u202f"),
        "RMSE": number(statistics.rmse_m, "m"),
        "Mean error (bias)": number(statistics.bias_m, "m"),
        "Standard deviation": number(statistics.std_m, "m"),
        "Median": number(statistics.median_m, "m"),
        "NMAD": number(statistics.nmad_m, "m"),
        "95th percentile of |error|": number(statistics.p95_m, "m"),
        "Largest |error|": number(statistics.worst_m, "m"),
        "Skewness": number(statistics.skewness, decimals=2),
        "Excess kurtosis": number(statistics.kurtosis, decimals=2),
    }


def distribution_figures(errors: FloatArray, statistics: ErrorStatistics) -> tuple[DrawnFigure, DrawnFigure]:
    """Return histogram and normal quantiles of the errors."""
    return (
        DrawnFigure(
            "histogram",
            residual_histogram(errors, statistics),
            "Histogram of the residuals with mean and RMSE",
            "Distribution of the residuals, map minus reference.",
        ),
        DrawnFigure(
            "quantiles",
            residual_quantiles(errors, statistics),
            "Residuals against quantiles of the normal distribution",
            "Residuals against normal quantiles: on the line they are normal, beyond it the tails are heavier.",
        ),
    )


def class_table(name: str, rows: Sequence[ClassScore]) -> Table:
    """Return the table of error statistics by class."""
    headings = ("Class", "n", "RMSE [m]", "NMAD [m]", "Bias [m]", "Within 1.96 σ")
    cells = tuple(
        (
            row.name,
            str(row.n),
            number(row.rmse_m),
            number(row.nmad_m),
            number(row.bias_m),
            percent(row.coverage_95),
        )
        for row in rows
    )
    return Table(f"by_{name}", f"Errors by class: {name.replace('_', ' ')}", headings, cells)


def methods_section(cited: Sequence[str]) -> Chapter:
    """Return the section of citations, each once."""
    return Chapter("Methods and standards cited", paragraphs=tuple(dict.fromkeys(cited)))


def checkpoint_report(
    setting: ReportSetting,
    dem: Dem,
    errors: CheckpointErrors,
    score: CheckpointScore,
    *,
    area: SurveyArea | None = None,
    classes: dict[str, tuple[ClassScore, ...]] | None = None,
) -> Document:
    """Compose the accuracy report of a map at checkpoints."""
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
        Chapter("What was compared", tables=(_checkpoint_inputs(setting, dem, errors),)),
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


def _checkpoint_inputs(setting: ReportSetting, dem: Dem, errors: CheckpointErrors) -> Table:
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
    is_even = min(spread.quadrant_shares) >= LEAST_SHARE and spread.spacing_share >= LEAST_SPACING
    return (
        f"Shares of the checkpoints in the quarters of the area: {shares}. Least distance between two of them: "
        f"{spread.spacing_share:.1%} of the diagonal.",
        f"Guidance (NSSDA, appendix 3-C): at least {LEAST_SHARE:.0%} in each quarter and {LEAST_SPACING:.0%} of the "
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
    found = edition_2_sentence(score.elevation.rmse_m, score.covered_share)
    sections = [
        Chapter("What was compared", tables=(_reference_inputs(setting, surveyed.mean, score),)),
        Chapter(
            "Error statistics", tables=(facts_table("statistics", "Errors, map minus reference", _reference_facts(score)),)
        ),
        Chapter("Figures", figures=figures),
        *([Chapter("Errors by class of ground", tables=grouped)] if grouped else []),
        Chapter("Class of the RMSE", paragraphs=(f"{found}.", _NO_STATEMENT)),
        methods_section([ASPRS_EDITION_2, HOEHLE]),
    ]  # fmt: skip
    return Document("Accuracy report", setting.title, setting.subtitle, tuple(sections), setting.signature)


_NO_STATEMENT = (
    "A raster is no set of independent checkpoints, so no statement of a standard is made; neighbouring nodes err alike. "
    "Name checkpoints with --checkpoints for a statement."
)


def _without_claim(dem: Dem) -> Reconstruction:
    """Return a map as the figures of errors take it, which draw no standard deviation."""
    unused = Dem(np.zeros(dem.shape), dem.transform, dem.crs, dem.vertical_datum)
    return Reconstruction(dem, unused, np.full(dem.shape, INTERPOLATED), "outside", {})


def _reference_inputs(setting: ReportSetting, dem: Dem, score: Score) -> Table:
    facts = {
        **setting.inputs,
        "Coordinates": dem.crs.name,
        "Heights above": dem.vertical_datum or "an unstated datum",
        "Cells of the map": f"{dem.step_m:g} m, {dem.shape[1]} × {dem.shape[0]}",
        "Area covered by the map": percent(score.covered_share),
    }
    return facts_table("inputs", "Map and reference", facts)


def _reference_facts(score: Score) -> dict[str, str]:
    facts = statistics_facts(score.elevation)
    if score.calibration.n:
        facts["Errors within 1.96 σ"] = f"{percent(score.calibration.coverage_95)} (95 % where σ is right)"
        facts["RMS of error / σ"] = number(score.calibration.z_rms, decimals=2)
    return facts


def change_report(
    setting: ReportSetting,
    change: Change,
    outlines: Mapping[str, Polygon | MultiPolygon],
    facts: Mapping[str, Any],
) -> Document:
    """Compose the report of a change.

    `outlines`: drawn on the map [m].
    """
    figure = DrawnFigure(
        "change",
        change_map(change, outlines),
        "Map of the change of height",
        "Later minus earlier survey; pale where the change is not significant at 95 %.",
    )
    cited = [ROLSTAD, HUSS] + ([NUTH] if change.alignment is not None else [])
    flows = (_flows(facts),) if "along_flow" in facts else ()
    common = facts_table("difference", "Difference on all common ground", statistics_facts(change.statistics))
    tables = (common, *((_volumes(facts), _masses(facts)) if change.volumes else ()))
    sections = (
        Chapter("Result", paragraphs=_sentences(facts), tables=(*tables, *flows)),
        Chapter("Map", figures=(figure,)),
        Chapter("What was compared", tables=(_inputs(setting, change, facts),)),
        Chapter("Assumptions", paragraphs=(*map(_as_sentence, change.notes), _assumption(facts))),
        methods_section(cited),
    )
    return Document("Change report", setting.title, setting.subtitle, sections, setting.signature)


def _sentences(facts: Mapping[str, Any]) -> tuple[str, ...]:
    return tuple(
        f"{row['name']}: volume change {rounded(row['volume_change_m3'])} m³, with a probability of 95 % between "
        f"{rounded(row['volume_low_95_m3'])} and {rounded(row['volume_high_95_m3'])} m³; specific mass balance "
        f"{number(row['specific_mass_balance_m_we'])} ± {number(row['specific_std_m_we'])} m water equivalent (1 σ)."
        for row in facts["volumes"]
    )


def _volumes(facts: Mapping[str, Any]) -> Table:
    headings = "Outline", "Area [m²]", "Mapped", "Change [m]", "Volume [m³]", "σ [m³]", "95 % from", "to [m³]"
    rows = tuple(
        (
            row["name"],
            rounded(row["area_m2"]),
            percent(row["known_share"]),
            number(row["mean_change_m"]),
            *(rounded(row[f"volume_{key}_m3"]) for key in ("change", "std", "low_95", "high_95")),
        )
        for row in facts["volumes"]
    )
    return Table("volumes", "Change of height and volume within each outline", headings, rows)


def _masses(facts: Mapping[str, Any]) -> Table:
    headings = ("Outline", "Mass [t]", "σ [t]", "Balance [m w.e.]", "σ [m w.e.]")
    rows = tuple(
        (
            row["name"],
            *(rounded(row[f"mass_{key}_kg"] / 1000.0) for key in ("change", "std")),
            number(row["specific_mass_balance_m_we"]),
            number(row["specific_std_m_we"]),
        )
        for row in facts["volumes"]
    )
    return Table("masses", "Change of mass within each outline", headings, rows)


def _flows(facts: Mapping[str, Any]) -> Table:
    pairs = (("along", "Along the flow"), ("flux_divergence", "Carried off"), ("balance", "Gain"))
    headings = ("Outline", *(part for _, name in pairs for part in (f"{name} [m]", "σ [m]")), "Thickness [m]")
    rows = tuple(
        (row["name"], *(number(row[key]) for key in list(row)[1:-1]), rounded(row["thickness_m"]))
        for row in facts["along_flow"]
    )
    return Table(
        "flows", "Change along the flow, and balance with the divergence of the flux", headings, rows
    )


def _inputs(setting: ReportSetting, change: Change, facts: Mapping[str, Any]) -> Table:
    dem = change.difference
    variogram = facts["variogram"]
    rows = {
        **setting.inputs,
        "Coordinates": dem.crs.name,
        "Cells": f"{dem.step_m:g} m, {dem.shape[1]} × {dem.shape[0]}",
        "Density": f"{facts['density_kg_m3']:g} ± {facts['density_std_kg_m3']:g} kg/m³",
        "Errors from": change.method,
        "Unchanged ground": f"{change.n_stable} cells",
        "Median difference subtracted": number(change.offset_m, "m"),
        **_alignment(facts["alignment"]),
        "Significant cells": percent(facts["significant_share"]),
    }
    if variogram is not None:
        rows |= {f"Variogram, {name.replace('_', ' ')}": _shown(value) for name, value in variogram.items()}
    return facts_table("inputs", "Surveys and settings", rows)


def _alignment(found: Mapping[str, Any] | None) -> dict[str, str]:
    """Return what was corrected of the earlier survey, with its standard deviations."""
    if found is None:
        return {"Alignment of the earlier survey": "none"}
    groups = {
        "Shift of the earlier survey": ("m", {"east_m": "east", "north_m": "north", "up_m": "up"}),
        "Its tilt": ("m/km", {"tilt_east_m_per_km": "east", "tilt_north_m_per_km": "north"}),
        "Its bias by curvature": ("m²", {"curvature_bias_m2": ""}),
    }
    return {
        title: ", ".join(
            f"{found[name]:+.3f} ± {found['std'].get(name, 0.0):.3f} {unit} {word}".strip()
            for name, word in terms.items()
        )
        for title, (unit, terms) in groups.items()
    }


def _shown(value: Any) -> str:
    if isinstance(value, list | tuple):
        return ", ".join(_shown(item) for item in value) or "none"
    if isinstance(value, dict):
        return ", ".join(f"{name} {_shown(item)}" for name, item in value.items())
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _assumption(facts: Mapping[str, Any]) -> str:
    return (
        f"The density of the gained or lost material is {facts['density_kg_m3']:g} ± {facts['density_std_kg_m3']:g} kg/m³; "
        "errors of volume and density are independent."
    )


def _as_sentence(note: str) -> str:
    return f"{note[0].upper()}{note[1:].rstrip('.')}."
