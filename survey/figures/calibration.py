"""Figures of the calibration of a map's standard deviation.

`calibration_plot` shows observed against nominal coverage of the errors against a reference. `held_out_plot`
shows the quantiles of points that were left out, and the factor by which the standard deviation is widened.
`withheld_plot` shows the reliability diagram of a map in tiles, and the coverage of withheld cells over the
map.
"""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, PercentFormatter
from pyproj import CRS

from survey.core.arrays import Bounds, FloatArray
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.figures.errors import height_error
from survey.figures.layout import MapFigure, label_maps, set_up_map
from survey.figures.style import CLAIM, ESTIMATE, FULL_IN, MUTED, REFERENCE, styled
from survey.reconstruction.checks import PredictiveCheck
from survey.reconstruction.terrain_map import Reconstruction
from survey.scoring import Calibration


@styled
def calibration_plot(
    reconstruction: Reconstruction,
    reference: Dem,
    calibration: Calibration,
    *,
    area: SurveyArea | None = None,
) -> Figure:
    r"""Draw observed against stated coverage of the standard deviation.

    Left: the share of nodes whose error lies within the claimed interval, against the
    interval's nominal level; on the diagonal the claim is right, below it too confident.
    Right: the size of the error in claimed standard deviations, beside the half-normal
    density :math:`\sqrt{2/\pi} \exp(-z^2/2)` that it should follow.

    Parameters
    ----------
    $reconstruction
    $reference
    calibration : Calibration
        Nominal levels and observed shares.
    $area_counted

    $page

    Examples
    --------
    $two_surfaces
    >>> calibration = Calibration.of(raised.elevation - flat.elevation, flat.elevation)
    >>> len(calibration_plot(surveyed, flat, calibration).axes)
    2
    """
    error = height_error(reconstruction, reference, area)
    figure = Figure(figsize=(FULL_IN, 3.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    _draw_coverage(left, calibration)
    with np.errstate(divide="ignore", invalid="ignore"):  # a claim of no error at all is infinitely exceeded
        ratio = np.abs(error) / reconstruction.std.elevation
    _draw_standardized(right, ratio)
    return figure


def _draw_coverage(axes: Axes, calibration: Calibration) -> None:
    levels, shares = np.asarray(calibration.levels), np.asarray(calibration.shares)
    axes.plot([0, 1], [0, 1], color=MUTED, linewidth=1.0, linestyle="--", label="Honest")
    axes.fill_between([0, 1], [0, 1], 0, color=ESTIMATE, alpha=0.07, linewidth=0)
    axes.fill_between([0, 1], [0, 1], 1, color=CLAIM, alpha=0.07, linewidth=0)
    axes.plot(levels, shares, color=REFERENCE, marker="o", markersize=3.5, label="This survey")
    axes.text(0.97, 0.05, "too confident", ha="right", color=ESTIMATE, fontsize=8)
    axes.text(0.03, 0.92, "too cautious", color=CLAIM, fontsize=8)
    axes.set(xlim=(0, 1), ylim=(0, 1), aspect="equal")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(PercentFormatter(1.0, decimals=0))
    axes.set(xlabel="Claimed level of the interval", ylabel="Errors inside it")
    axes.legend(loc="upper left", bbox_to_anchor=(0.0, 0.9))
    axes.set_title("Coverage")


def _draw_standardized(axes: Axes, ratio: FloatArray) -> None:
    z = ratio[~np.isnan(ratio)]
    edges = np.linspace(0.0, 4.0, 33)
    counts, _ = np.histogram(z, edges)
    density = counts / (z.size * np.diff(edges))
    axes.bar(edges[:-1], density, np.diff(edges), align="edge", color="#a9b7c2", label="Observed")
    at = np.linspace(0.0, 4.0, 200)
    axes.plot(at, np.sqrt(2.0 / np.pi) * np.exp(-0.5 * at**2), color=CLAIM, label="Honest (normal)")
    axes.set(xlim=(0, 4), xlabel="|error| / claimed σ", ylabel="Density")
    axes.legend(loc="upper right", reverse=True)
    axes.text(
        0.97, 0.68, f"{np.mean(z > 4.0):.2%} beyond 4 σ", transform=axes.transAxes, ha="right", fontsize=8
    )
    axes.set_title("Error in claimed standard deviations")


@styled
def held_out_plot(check: PredictiveCheck) -> Figure:
    """Draw how well points that were left out agree with the standard deviation of their prediction.

    Left: the share of the points in each tenth of their predictive distribution, 10 % each when the standard
    deviation is right. Right: the factor by which it is widened, against the distance to the nearest point.

    >>> from survey.reconstruction.checks import PredictiveScores
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


@styled
def withheld_plot(
    reliability: Mapping[float, float], coverage: FloatArray, bounds: Bounds, crs: CRS | None = None
) -> Figure:
    """Draw the reliability diagram of a map in tiles, and where its 95 % intervals held the withheld cells.

    `coverage` (H, W): share of withheld cells within the 95 % interval, in blocks, the first row the southern
    one; NaN without cells. `bounds` (xmin, ymin, xmax, ymax): edges of the blocks [m].
    """
    figure = Figure(figsize=(FULL_IN, 3.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.plot([0, 1], [0, 1], color=MUTED, linewidth=1.0, linestyle="--", label="Reliable")
    left.plot(
        list(reliability),
        list(reliability.values()),
        color=REFERENCE,
        marker="o",
        markersize=3.5,
        label="Map",
    )
    left.set(xlim=(0, 1), ylim=(0, 1), aspect="equal", title="Withheld cells")
    left.set(xlabel="Nominal coverage", ylabel="Cells within the interval")
    for axis in (left.xaxis, left.yaxis):
        axis.set_major_formatter(PercentFormatter(1.0, decimals=0))
    left.legend(loc="upper left")
    _draw_coverage_map(right, coverage, bounds)
    label_maps(MapFigure(figure, [right], right), "Within the 95 % interval", crs=crs)
    return figure


def _draw_coverage_map(axes: Axes, coverage: FloatArray, bounds: Bounds) -> None:
    west, south, east, north = bounds
    image = axes.imshow(
        np.ma.masked_invalid(coverage),
        extent=(west, east, south, north),
        origin="lower",
        vmin=0.85,
        vmax=1.0,
        cmap="cividis",
        interpolation="nearest",
    )
    set_up_map(axes, bounds)
    axes.figure.colorbar(image, ax=axes, format=PercentFormatter(1.0, decimals=0), extend="min")
