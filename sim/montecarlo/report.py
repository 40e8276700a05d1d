"""Report pages of Monte Carlo studies: curves of error against swaths and distance, with the limits of the classes."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import tomlkit
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sim.montecarlo.config import StudyConfig
from sim.montecarlo.summary import SummaryRow, curves, minimum_swaths
from survey.core.files.writing import replacing
from survey.figures.style import FULL_IN, INK, MUTED, ROVERS, styled
from survey.reporting.quantities import number, percent
from survey.reporting.rendering import Picture, picture_of, rendered
from survey.scoring.standards.map_classes import map_classes

_DASHES = ("-", (0, (4, 1.5)), ":", (0, (6, 1, 1, 1)))


def write_study_report(folder: Path, study: StudyConfig, rows: Sequence[SummaryRow]) -> Path:
    """Write ``index.html`` and ``figures/*.png`` into the study's folder; return the page."""
    (folder / "figures").mkdir(exist_ok=True)
    pictures, names = {}, {}
    for index, kind in enumerate(study.terrains):
        mine = [row for row in rows if row["terrain"] == kind.name]
        names[kind.name] = f"figures/{index:02d}-error.png"
        picture = picture_of(
            error_curves({kind.name: mine}, study.limit_m),
            f"Mean error of the map against swaths and distance on {kind.name}",
            "Mean over the trials with its 95 % bootstrap interval; the limits of the map classes are drawn.",
        )
        with replacing(folder / names[kind.name]) as draft:
            draft.write_bytes(picture.image)
        pictures[kind.name] = picture
    page = _render(study, rows, pictures, names)
    with replacing(folder / "index.html") as draft:
        draft.write_text(page, encoding="utf-8")
    return folder / "index.html"


@styled
def error_curves(
    families: Mapping[str, Sequence[SummaryRow]], limit_m: float, *, top_m: float = 5.0
) -> Figure:
    """Draw mean error against swaths and against distance, one row of panels for each terrain.

    Parameters
    ----------
    families : dict of str to sequence of rows
        Rows of the summary, by the panel's title.
    limit_m : float
        Limit that is drawn strongest [m].
    top_m : float
        Upper end of the axis of errors [m]; curves above are cut.
    """
    figure = Figure(figsize=(FULL_IN, 0.6 + 2.7 * len(families)), layout="constrained")
    panels = figure.subplots(len(families), 2, squeeze=False)
    for (by_swaths, by_metres), (name, rows) in zip(panels, families.items(), strict=True):
        for axes, x in ((by_swaths, "swaths"), (by_metres, "mean_length_m")):
            draw_curves(axes, rows, x, limit_m)
            axes.set_ylim(0.01, top_m)
        by_swaths.set(title=name, xlabel="Swaths", ylabel="Mean RMSE [m]")
        by_metres.set(xlabel="Distance driven [m]")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2)
    return figure


def draw_curves(
    axes: Axes, rows: Sequence[SummaryRow], x: str, limit_m: float, *, name_limits: bool = True
) -> None:
    """Draw the curves of one terrain on logarithmic errors, with the classes' limits."""
    found = curves(rows)
    looks = {planner: ROVERS[i % len(ROVERS)] for i, planner in enumerate(dict.fromkeys(k[1] for k in found))}
    dashes = {m: _DASHES[i % len(_DASHES)] for i, m in enumerate(dict.fromkeys(k[2] for k in found))}
    for (_, planner, map_name), points in found.items():
        at = np.array([point[x] for point in points], dtype=float)
        mean, low, high = (
            np.array([p[f"mean_rmse_m{end}"] for p in points]) for end in ("", "_low", "_high")
        )
        label = planner if len(dashes) == 1 else f"{planner}, {map_name}"
        axes.plot(
            at, mean, color=looks[planner], linestyle=dashes[map_name], marker="o", markersize=3, label=label
        )
        axes.fill_between(at, low, high, color=looks[planner], alpha=0.18, linewidth=0)
    draw_limits(axes, limit_m, named=name_limits)
    axes.set_yscale("log")
    axes.grid(visible=True, axis="y")


def draw_limits(axes: Axes, limit_m: float, *, named: bool = True) -> None:
    """Draw the widest limit of every class as a line, with its name where there is room."""
    widest = {row.map_class: row.limit_m for row in reversed(map_classes())}
    for name, limit in widest.items():
        chief = abs(limit - limit_m) < 1e-9
        axes.axhline(
            limit, color=INK if chief else MUTED, linewidth=1.2 if chief else 0.6, linestyle=(0, (2, 2))
        )
        if not named:
            continue
        axes.annotate(
            f"{name}, {limit:.4f} m",
            (1.0, limit),
            xycoords=("axes fraction", "data"),
            ha="right",
            va="bottom" if chief else "top",
            fontsize=6.5,
        )


def _render(
    study: StudyConfig, rows: Sequence[SummaryRow], pictures: dict[str, Picture], names: dict[str, str]
) -> str:
    settings = tomlkit.dumps(study.model_dump(mode="json", exclude_none=True))
    minimum = [_shown_minimum(row) for row in minimum_swaths(rows, study)]
    return rendered(
        "montecarlo.html.j2",
        title=study.name,
        trials=study.trials,
        fidelity=study.fidelity,
        limit=number(study.limit_m, "m", 4),
        required=study.require.replace("class-", "Class "),
        pictures=pictures,
        files=names,
        minimum=minimum,
        minimum_rows=_as_rows(minimum),
        table_rows=_as_rows(rows),
        table=[_shown(row) for row in rows],
        config_text=settings,
    )


def _as_rows(rows: Sequence[SummaryRow]) -> list[list[object]]:
    """Return names and values of a table, for its download."""
    return [list(rows[0]), *(list(row.values()) for row in rows)] if rows else []


def _shown_minimum(row: SummaryRow) -> SummaryRow:
    return {key: "–" if value is None else value for key, value in row.items()}


def _shown(row: SummaryRow) -> SummaryRow:
    lengths = (
        "mean_rmse_m",
        "mean_rmse_m_low",
        "mean_rmse_m_high",
        "median_rmse_m",
        "p95_rmse_m",
        "pooled_rmse_m",
        "mean_claimed_m",
    )
    return {
        **row,
        **{name: number(row[name], "m") for name in lengths},
        "mean_length_m": number(row["mean_length_m"], "m", 0),
        **{name: percent(row[name]) for name in ("pass_share", "pass_share_low", "pass_share_high")},
    }
