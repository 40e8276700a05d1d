"""Figure of the predictions of points that were left out."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from survey.figures.style import CLAIM, ESTIMATE, FULL_IN, MUTED, styled
from survey.reconstruction.checks.predictive import PredictiveCheck


@styled
def held_out_plot(check: PredictiveCheck) -> Figure:
    """Draw how well points that were left out agree with the standard deviation of their prediction.

    Left: the share of the points in each tenth of their predictive distribution, 10 % each when the standard
    deviation is right. Right: the factor by which it is widened, against the distance to the nearest point.

    Parameters
    ----------
    check : PredictiveCheck
        Scores of the points, and the test.

    Returns
    -------
    matplotlib.figure.Figure
        As wide as a page.

    Examples
    --------
    >>> from survey.reconstruction.checks.predictive import PredictiveScores
    >>> scores = PredictiveScores.of(np.linspace(-0.2, 0.2, 40), np.full(40, 0.1))
    >>> check = PredictiveCheck("swaths", 4, scores, scores, (1.0, 5.0), (9.0, 4.0), (0.4, 0.3), (1.0, 1.0))
    >>> len(held_out_plot(check).axes)
    2
    """
    figure = Figure(figsize=(FULL_IN, 3.0), layout="constrained")
    left, right = figure.subplots(1, 2)
    tenths = np.arange(10) / 10.0
    left.bar(tenths, check.before.pit_tenths, 0.1, align="edge", color="#a9b7c2", label="As stated")
    left.step(
        np.append(tenths, 1.0),
        np.append(check.after.pit_tenths, check.after.pit_tenths[-1]),
        where="post",
        color=CLAIM,
        label="After widening",
    )
    left.axhline(0.1, color=MUTED, linestyle="--", linewidth=1.0)
    left.yaxis.set_major_formatter(FuncFormatter(lambda share, _: f"{100.0 * share:g}%"))
    left.set(xlim=(0, 1), xlabel="Quantile of the prediction", ylabel="Points left out")
    left.set_ylim(top=1.35 * left.get_ylim()[1])  # room for the legend above the bars
    left.legend(loc="upper center", ncols=2)
    left.set_title("Points left out")
    right.plot(check.distance_m, check.factor, color=ESTIMATE, marker="o", markersize=4)
    right.axhline(1.0, color=MUTED, linestyle="--", linewidth=1.0)
    right.set(
        xlabel="Distance to the nearest point [m]",
        ylabel="Factor on σ",
        ylim=(0.9, max(1.3, 1.1 * max(check.factor))),
    )
    right.set_title("Widening of the standard deviation")
    return figure
