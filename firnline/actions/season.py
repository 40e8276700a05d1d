"""Design of two surveys for a required error of the mass balance: swaths, stakes and days."""

import csv
import io
from dataclasses import dataclass
from datetime import date
from typing import TYPE_CHECKING, Any, cast

from firnline.actions.guaranteeing import prior_of
from firnline.actions.interface import NotMetError, Progress, fact_line, no_progress
from firnline.actions.plan_request import PlanDrawing, PlanRequest, PlanResult
from survey.core import ConfigError, length_text

if TYPE_CHECKING:
    from planners.prediction.assumptions import Surface
    from planners.season import SeasonConfig, SeasonDesign, SeasonOption


_CAUSES = {
    "interpolation_m": "between swaths",
    "gradient_m": "uneven heights",
    "samples_m": "samples and fine relief",
    "shared_m": "shared by samples",
    "duration_m": "melt while surveying",
    "flow_m": "flow",
    "density_m_we": "density (w.e.)",
}


@dataclass(frozen=True, kw_only=True)
class SeasonPlan(PlanResult):
    """Design of two surveys of a season.

    `design`: the best design, and all others.
    """

    design: "SeasonDesign"

    def _write_files(self) -> None:
        """Write route, map, table and errors; all replace what was there, or none does."""
        _write(self.request, self.design, self.drawing)
        self.request.remove_old_pictures()

    def facts(self) -> dict[str, Any]:
        """Return files, unit and the best design."""
        return self.request.written | {"unit": self.design.config.unit} | _row(self.design, self.design.best)

    def lines(self) -> list[str]:
        """Return swaths, days and the error with its causes."""
        config, best, change = self.design.config, self.design.best, self.design.config.change
        first, second = self.design.dates(best)
        days = "1 day" if best.n_days == 1 else f"{best.n_days} days"
        causes = ", ".join(f"{_CAUSES[name]} {value:.3f}" for name, value in best.budget._asdict().items())
        facts = {
            "first survey": f"{first[0]} to {first[1]}",
            "second survey": f"{second[0]} to {second[1]}",
            "σ [m]": causes,
            "change": f"σ {change.std_m:.2f} m, correlated to a half at {change.half_m:g} m, beside {change.gradient:.4f} m "
            f"less melt for each metre of height; fine relief of {change.redrawn_m:g} m is new at each date",
            "between swaths": ", ".join(
                f"{name} (weight {change.families[name]:g}) {std_m:.3f}"
                for name, std_m in best.families.items()
            ),
            "assumed": f"melt of {config.melt_m_day:.3f} m of {config.density_kg_m3:.0f} kg/m³ a day, "
            f"surface {config.surface}, {config.km_a_day:g} km a day",
            "written to": self.request.written_text,
        }
        return [
            f"{best.n_swaths} swaths, {length_text(best.length_m)} and {days} each time, with {best.n_stakes} stakes: "
            f"± {best.error:.2g} {config.unit} (95 %), {config.wanted:g} wanted.",
            *(fact_line(name, text) for name, text in facts.items()),
        ]


def plan_season(request: PlanRequest, progress: Progress = no_progress) -> SeasonPlan:
    """Design two surveys; refuse where no design gives the wanted error."""
    from planners.season import design_season

    config = season_config(request)
    area, prior = prior_of(request)
    progress("comparing numbers of swaths and stakes", 0, 1)
    design = design_season(area, prior, config)
    if not design.holds:
        raise NotMetError(_refusal(design))
    return SeasonPlan(request=request, route=design.route, drawing=PlanDrawing(area, prior), design=design)


def season_config(request: PlanRequest) -> "SeasonConfig":
    """Return the settings of a season."""
    from planners.season import SeasonConfig

    text = str(request.season).strip()
    first, last = _dates(str(request.dates))
    return SeasonConfig(
        _number(text.removesuffix("%")),
        "%" if text.endswith("%") else "m w.e.",
        first,
        last,
        surface=cast("Surface", request.surface),
        melt_m_we_day=request.melt_m_we_day,
        emergence_m_year=request.emergence_m_year,
        noise_m=request.noise_m,
        localization_m=request.localization_m,
        micro_relief_m=request.micro_relief_m,
        shared_m=request.shared_m,
        km_a_day=request.km_a_day,
        max_swaths=request.max_swaths,
    )


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError as error:
        raise ConfigError(
            f"--season {text} is no error; give metres w.e., as 0.2, or percent, as 5%."
        ) from error


def _dates(text: str) -> tuple[date, date]:
    try:
        first, last = (date.fromisoformat(part.strip()) for part in text.split(","))
    except ValueError as error:
        raise ConfigError(f"--dates {text} are not two days; give them as 2026-05-01,2026-09-20.") from error
    return first, last


def _refusal(design: "SeasonDesign") -> str:
    """Return what the best design reaches and what its largest error is, in one sentence."""
    parts = design.best.budget._asdict()
    largest = max(parts, key=lambda name: parts[name])
    unit = design.config.unit
    return (
        f"± {design.config.wanted:g} {unit} cannot be reached; {design.best.n_swaths} swaths with "
        f"{design.best.n_stakes} stakes give ± {design.best.error:.2g} {unit}, and the largest part of that is "
        f"{_CAUSES[largest]}; ask for a larger error or other dates."
    )


def _row(design: "SeasonDesign", option: "SeasonOption") -> dict[str, Any]:
    """Return a design as one row of the table."""
    first, second = design.dates(option)
    return {
        "stakes": option.n_stakes,
        "swaths": option.n_swaths,
        "length_m": round(option.length_m, 1),
        "days": option.n_days,
        "first_survey": f"{first[0]}/{first[1]}",
        "second_survey": f"{second[0]}/{second[1]}",
        **{name: round(value, 5) for name, value in option.budget._asdict().items()},
        "error": round(option.error, 5),
        "enough": option.error <= design.config.wanted,
    }


def _write(request: PlanRequest, design: "SeasonDesign", drawing: PlanDrawing) -> None:
    """Write route, map, table and errors; all replace what was there, or none does."""
    from survey.core import replacing_files

    if request.no_pictures:
        with replacing_files(*request.files.values()) as (route_file, table_file):
            design.route.write(route_file)
            table_file.write_text(_table(design), encoding="utf-8")
        return
    from survey.figures import picture_bytes, plan_map
    from survey.figures.plans import season_plot

    chart = plan_map(drawing.area, design.route, terrain=drawing.terrain)
    errors: dict[int, list[tuple[int, float]]] = {}
    for one in design.options:
        errors.setdefault(one.n_stakes, []).append((one.n_swaths, one.error))
    parts = {_CAUSES[name]: value for name, value in design.best.budget._asdict().items()}
    chosen = design.best.n_swaths, design.best.error
    plot = season_plot(errors, design.config.wanted, chosen, parts, design.config.unit)
    with replacing_files(*request.files.values()) as (route_file, picture_file, table_file, errors_file):
        design.route.write(route_file)
        picture_file.write_bytes(picture_bytes(chart, request.pictures))
        table_file.write_text(_table(design), encoding="utf-8")
        errors_file.write_bytes(picture_bytes(plot, request.pictures))


def _table(design: "SeasonDesign") -> str:
    """Return all designs as CSV."""
    rows = [_row(design, one) for one in design.options]
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
