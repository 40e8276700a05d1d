"""Figure of the errors of all gridders over those of the best peer, by the kind of survey."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.gridders_on_real_ground.gridders import OURS, PEERS
from benchmarks.gridders_on_real_ground.scores import Judged
from benchmarks.gridders_on_real_ground.surveys import LINES
from survey.core.arrays import FloatArray
from survey.figures.style import ESTIMATE, FULL_IN, MUTED, REFERENCE, styled

_LIMITS = (0.2, 16.0)
_TICKS = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0)


@styled
def ratio_figure(found: Sequence[Judged], kinds: Sequence[str]) -> Figure:
    """Draw the median of each gridder's ratios, and where nine tenths of them lie, in a panel for each kind of survey."""
    names = [one.name for one in (*OURS, *PEERS) if any(one.name in each.scores for each in found)]
    medians = {name: np.median(ratios(found, name)) for name in names}
    ours = [one.name for one in OURS[::-1]]
    names = [*ours, *sorted(set(names) - set(ours), key=lambda name: medians[name])]
    figure = Figure((FULL_IN, 0.8 + 0.21 * len(names)), layout="constrained")
    panels = np.ravel(figure.subplots(1, len(kinds), sharey=True))
    for panel, kind in zip(panels, kinds, strict=True):
        mine = [one for one in found if one.case.kind == kind]
        panel.set_title(f"lines, {kind}" if kind in LINES else kind, fontsize=9.0)
        _draw(panel, [(name, ratios(mine, name)) for name in names])
    panels[0].set_yticks(range(len(names)), names)
    panels[0].invert_yaxis()
    figure.supxlabel(
        "RMSE over that of the best other gridder of the survey: median, and nine tenths; lines a share of the side apart",
        fontsize=9.0,
    )
    return figure


def ratios(found: Sequence[Judged], name: str) -> FloatArray:
    """Return the errors of a gridder over the least of the peers, where it found a surface."""
    return np.array([one.scores[name].rmse_m / one.best_peer_m for one in found if name in one.scores])


def _draw(panel: Axes, rows: Sequence[tuple[str, FloatArray]]) -> None:
    """Draw one panel: a row for each gridder that found a surface, cut at the limits."""
    panel.axvline(1.0, color=REFERENCE, linewidth=0.8)
    for k, (name, found) in enumerate(rows):
        if not len(found):
            continue
        low, middle, high = np.quantile(found, [0.05, 0.5, 0.95])
        colour = ESTIMATE if name.startswith(OURS[0].name) else MUTED
        panel.plot([low, high], [k, k], color=colour, linewidth=1.2, solid_capstyle="butt")
        panel.plot([middle], [k], "o", color=colour, markersize=4.5)
    panel.set_xscale("log")
    panel.set_xlim(*_LIMITS)
    panel.set_xticks(_TICKS, [f"{tick:g}" for tick in _TICKS])
    panel.minorticks_off()
    panel.grid(axis="x")
