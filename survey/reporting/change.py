"""Report of a change between two surveys: volumes and masses with their errors."""

from collections.abc import Mapping
from typing import Any

from shapely import MultiPolygon, Polygon

from survey.figures.maps import change_map
from survey.reporting.accuracy import HUSS, NUTH, ROLSTAD, ReportSetting, facts_table, methods_section
from survey.reporting.document import Chapter, Document, DrawnFigure, Table
from survey.reporting.quantities import number, percent, rounded
from survey.scoring.change.volume_change import Change


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
    cited = [ROLSTAD, HUSS] + ([NUTH] if change.shift is not None else [])
    flows = (_flows(facts),) if "along_flow" in facts else ()
    sections = (
        Chapter("Result", paragraphs=_sentences(facts), tables=(_volumes(facts), _masses(facts), *flows)),
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
    headings = (
        "Outline",
        "Area [m²]",
        "Mapped",
        "Change [m]",
        "Volume [m³]",
        "σ [m³]",
        "95 % from",
        "to [m³]",
    )
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
        "Mean difference subtracted": number(change.offset_m, "m"),
        "Shift of the earlier survey": _shift(facts["shift"]),
        "Significant cells": percent(facts["significant_share"]),
    }
    if variogram is not None:
        rows |= {f"Variogram, {name.replace('_', ' ')}": _shown(value) for name, value in variogram.items()}
    return facts_table("inputs", "Surveys and settings", rows)


def _shift(shift: Mapping[str, float] | None) -> str:
    if shift is None:
        return "none"
    return f"{shift['east_m']:+.3f} m east, {shift['north_m']:+.3f} m north, {shift['up_m']:+.3f} m up"


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
