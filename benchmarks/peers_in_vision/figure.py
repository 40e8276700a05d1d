"""Figure of the errors of all programs beside their speed."""

from collections.abc import Sequence

from matplotlib.figure import Figure

from benchmarks.peers_in_vision.programs import PROGRAMS
from benchmarks.peers_in_vision.scores import PathScore
from survey.figures.style import FULL_IN, ROVERS, styled

_MARKERS = dict(zip(PROGRAMS, zip("os^D", ROVERS, strict=False), strict=True))
_ERRORS = {0.02: "0.02", 0.1: "0.1", 1.0: "1", 10.0: "10", 20.0: ""}
_SPEEDS = (0.4, 1.0, 2.0, 5.0, 10.0, 20.0, 40.0)


@styled
def error_figure(scores: Sequence[PathScore]) -> Figure:
    """Draw the error of shape over frames per CPU second: a panel for streets and one for snow."""
    figure = Figure((FULL_IN, 2.9), layout="constrained")
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    for panel, title, is_snow in zip(panels, ("streets", "snow, simulated"), (False, True), strict=True):
        for program, (marker, colour) in _MARKERS.items():
            mine = [one for one in scores if one.program == program and one.drive.is_snow == is_snow]
            for k, one in enumerate(score for score in mine if not score.failed):
                fill = colour if one.is_followed else "none"
                panel.plot(
                    [one.frames_per_s],
                    [one.ate_per_cent],
                    marker,
                    color=colour,
                    markerfacecolor=fill,
                    markersize=5.5,
                    label=program if k == 0 else None,
                )
        panel.set_title(title, fontsize=9.0)
        panel.grid(visible=True)
    panels[0].set(
        xscale="log", yscale="log", xlim=(_SPEEDS[0], _SPEEDS[-1]), ylim=(min(_ERRORS), max(_ERRORS))
    )
    panels[0].set_xticks(_SPEEDS, [f"{speed:g}" for speed in _SPEEDS])
    panels[0].set_yticks(list(_ERRORS), list(_ERRORS.values()))
    panels[0].set_ylabel("Sim(3) ATE over the travel [%]")
    panels[0].legend(fontsize=8.0)
    figure.supxlabel("frames per CPU second; hollow: more than a tenth of the images lost", fontsize=9.0)
    return figure
