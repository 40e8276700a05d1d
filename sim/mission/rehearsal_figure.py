"""Picture of a rehearsal: runs that met the class, and what the others failed of."""

from pathlib import Path

from matplotlib.figure import Figure

from sim.mission.rehearsal import CAUSES, RehearsalSummary
from survey.core.files.writing import replacing
from survey.figures import png_bytes
from survey.figures.style import HALF_IN, styled

_MET, _FAILED = "#1f5f8b", "#b2482e"


@styled
def outcome_plot(summary: RehearsalSummary) -> Figure:
    """Draw the number of runs with each outcome."""
    figure = Figure(figsize=(HALF_IN, 0.55 * HALF_IN), layout="constrained")
    axes = figure.add_subplot()
    names = [CAUSES[cause].capitalize() for cause in summary.counts]
    colours = [_MET if cause == "met" else _FAILED for cause in summary.counts]
    bars = axes.barh(names, list(summary.counts.values()), color=colours)
    axes.bar_label(bars, padding=3)
    axes.invert_yaxis()
    axes.set_xlabel("Runs")
    low, high = summary.interval
    axes.set_title(
        f"Class met in {summary.probability:.0%} of {summary.n_runs} runs ({low:.0%} to {high:.0%})"
    )
    return figure


def write_outcome_plot(summary: RehearsalSummary, file: Path) -> None:
    """Write the picture as PNG."""
    with replacing(file) as draft:
        draft.write_bytes(png_bytes(outcome_plot(summary)))
