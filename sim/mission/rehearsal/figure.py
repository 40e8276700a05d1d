"""Picture of a rehearsal: the probability of the class, and the fault tree of the other runs."""

from collections.abc import Iterator
from pathlib import Path
from textwrap import fill
from typing import NamedTuple

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sim.mission.rehearsal.fault_tree import FaultEvent
from sim.mission.rehearsal.runs import RehearsalSummary
from survey.core.files.writing import replacing
from survey.figures import png_bytes
from survey.figures.style import FULL_IN, MUTED, NO_GO, VEIL, styled

_ROW_IN, _WIDEST = 0.42, 34
_COLUMNS = (0.0, 0.26, 0.52, 0.78)
_WIDTH = 0.21


class _Box(NamedTuple):
    event: FaultEvent
    column: int
    row: float
    parent_row: float | None


@styled
def fault_tree_plot(summary: RehearsalSummary, tree: FaultEvent) -> Figure:
    """Draw the fault tree: from the missed class to the right, how the runs failed, and their faults.

    Parameters
    ----------
    summary : RehearsalSummary
        For the title.
    tree : FaultEvent
        Tree of the runs that missed the class.

    Returns
    -------
    matplotlib.figure.Figure
        One box for each event, with its number of runs.
    """
    boxes = list(_placed(tree, 0, 0.0, None))
    n_rows = max(_n_leaves(tree), 1)
    figure = Figure(figsize=(FULL_IN, 0.7 + _ROW_IN * n_rows), layout="constrained")
    axes = figure.add_subplot()
    axes.set_axis_off()
    axes.set(xlim=(-0.01, 1.0), ylim=(n_rows - 0.5, -0.5))
    low, high = summary.interval
    axes.set_title(
        f"Class met in {summary.probability:.0%} of {summary.n_runs} runs ({low:.0%} to {high:.0%})"
    )
    for box in boxes:
        _draw(axes, box, summary.n_runs)
    return figure


def write_fault_tree(summary: RehearsalSummary, tree: FaultEvent, file: Path) -> None:
    """Write the picture as PNG."""
    with replacing(file) as draft:
        draft.write_bytes(png_bytes(fault_tree_plot(summary, tree)))


def _n_leaves(event: FaultEvent) -> int:
    return sum(map(_n_leaves, event.parts)) if event.parts else 1


def _placed(event: FaultEvent, column: int, first_row: float, parent_row: float | None) -> Iterator[_Box]:
    """Yield an event and its parts, each in the middle of the rows of its leaves."""
    row = first_row + 0.5 * (_n_leaves(event) - 1)
    yield _Box(event, column, row, parent_row)
    for part in event.parts:
        yield from _placed(part, column + 1, first_row, row)
        first_row += _n_leaves(part)


def _draw(axes: Axes, box: _Box, n_runs: int) -> None:
    """Draw the box of an event, and its line to the event before."""
    left = _COLUMNS[box.column]
    if box.parent_row is not None:
        gate = left - 0.5 * (_COLUMNS[1] - _WIDTH)
        before = _COLUMNS[box.column - 1] + _WIDTH
        axes.plot(
            [before, gate, gate, left], [box.parent_row] * 2 + [box.row] * 2, color=MUTED, linewidth=0.8
        )
    share = box.event.n_runs / n_runs
    axes.barh(box.row, _WIDTH, 0.8, left, color=VEIL)
    axes.barh(box.row, _WIDTH * share, 0.8, left, color=NO_GO, alpha=0.45)
    label = fill(f"{box.event.name}: {box.event.n_runs}", _WIDEST, max_lines=2)
    axes.text(left + 0.006, box.row, label, va="center", fontsize=8)
