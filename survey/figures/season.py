"""Figure of a season's design: error against swaths for each number of stakes, and what the chosen one consists of."""

from collections.abc import Mapping, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from survey.figures.style import CLAIM, ESTIMATE, FULL_IN, INK, MUTED, styled


@styled
def season_plot(
    errors: Mapping[int, Sequence[tuple[int, float]]],
    wanted: float,
    chosen: tuple[int, float],
    parts_m: Mapping[str, float],
    unit: str,
) -> Figure:
    """Draw the error of a season's mass balance against swaths, and the parts of the chosen design.

    Parameters
    ----------
    errors : mapping of int to sequence of tuple
        Number of stakes: pairs of a number of swaths and half the 95 % interval, in `unit`.
    wanted : float
        Half the 95 % interval that is wanted, in `unit`.
    chosen : tuple of int and float
        Swaths and error of the chosen design.
    parts_m : mapping of str to float
        Standard deviations of the chosen design by cause [m].
    unit : str
        Unit of the errors.

    Returns
    -------
    matplotlib.figure.Figure
        As wide as a page: two axes.
    """
    figure = Figure(figsize=(FULL_IN, 2.9), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    _draw_errors(left, errors, wanted, chosen, unit)
    right.barh(list(parts_m), list(parts_m.values()), color=ESTIMATE)
    right.invert_yaxis()
    right.set_xlabel("Standard deviation (m)")
    right.set_title("Chosen design, by cause")
    return figure


def _draw_errors(
    axes: Axes,
    errors: Mapping[int, Sequence[tuple[int, float]]],
    wanted: float,
    chosen: tuple[int, float],
    unit: str,
) -> None:
    """Draw a line for each number of stakes, the wanted error, and the chosen design."""
    for index, (n_stakes, line) in enumerate(errors.items()):
        shade = 0.35 + 0.65 * index / max(len(errors) - 1, 1)
        axes.plot(
            *zip(*line, strict=True), color=ESTIMATE, alpha=shade, marker=".", label=f"{n_stakes} stakes"
        )
    axes.axhline(wanted, color=MUTED, linestyle="--", label="wanted")
    axes.plot(*chosen, "o", color=CLAIM, markeredgecolor=INK, label="chosen")
    axes.set_xlabel("Swaths")
    axes.set_ylabel(f"Half the 95 % interval ({unit})")
    axes.set_ylim(bottom=0.0)
    axes.legend()
