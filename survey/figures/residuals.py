"""Figures of residuals at checkpoints: map, histogram, normal quantiles."""

from typing import Any

import numpy as np
from matplotlib import patheffects
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from scipy.special import ndtri

from survey.core.arrays import Bounds, FloatArray
from survey.core.errors import InputError
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.figures.cartography.layout import add_colour_bar, map_figure, view
from survey.figures.cartography.relief import draw_relief, relief_exaggeration
from survey.figures.cartography.routes import draw_area
from survey.figures.cartography.scale_bar import draw_scale_and_north
from survey.figures.style import CLAIM, ERROR, ESTIMATE, FULL_IN, HALF_IN, INK, MUTED, styled
from survey.scoring import CheckpointErrors, ErrorStatistics

_HALF_HEIGHT_IN = 3.3
_MOST_NAMES = 40
# Points in less than half of the map's length are shown with a margin of a tenth.
_SMALL_PART, _MARGIN = 0.5, 0.1
_MOST_QUANTILES = 2000


@styled
def residual_map(errors: CheckpointErrors, dem: Dem, area: SurveyArea | None = None) -> Figure:
    """Draw the residual at each checkpoint over the relief of the map.

    Parameters
    ----------
    errors : CheckpointErrors
        With the places of the checkpoints.
    dem : Dem
        The map, for its relief.
    area : SurveyArea, optional
        Its outline is drawn.

    Returns
    -------
    matplotlib.figure.Figure
        As wide as a page; colours are symmetric about zero, and up to 40 points are named.

    Raises
    ------
    InputError
        Errors without places.
    """
    if errors.xyz is None:
        raise InputError("the checkpoint errors have no places; compute them with compare.")
    drawing = map_figure(FULL_IN, _view(errors.xyz, dem, area))
    axes = drawing.maps[0]
    draw_relief(axes, dem, exaggeration=relief_exaggeration(dem))
    if area is not None:
        draw_area(axes, area, veil=False)
    reach = max(float(np.abs(errors.errors_m).max()), 1e-6)
    points = axes.scatter(
        errors.xyz[:, 0],
        errors.xyz[:, 1],
        c=errors.errors_m,
        cmap=ERROR,
        norm=Normalize(-reach, reach),
        s=42.0,
        edgecolors=INK,
        linewidths=0.7,
        zorder=6,
    )
    if len(errors.names) <= _MOST_NAMES:
        _name_points(axes, errors.names, errors.xyz)
    add_colour_bar(points, drawing, "Residual (map \u2212 checkpoint) [m]")
    draw_scale_and_north(drawing, crs=dem.crs)
    axes.set_title("Residuals at the checkpoints")
    return drawing.figure


def _view(xyz: FloatArray, dem: Dem, area: SurveyArea | None) -> Bounds:
    """Return what the map shows: the area, else the map, or the points where they lie in a small part of it."""
    (west, south), (east, north) = xyz[:, :2].min(axis=0).tolist(), xyz[:, :2].max(axis=0).tolist()
    margin = max(_MARGIN * max(east - west, north - south), 3.0 * dem.step_m)
    about = (west - margin, south - margin, east + margin, north + margin)
    reach = max(dem.bounds[2] - dem.bounds[0], dem.bounds[3] - dem.bounds[1])
    is_small = max(about[2] - about[0], about[3] - about[1]) < _SMALL_PART * reach
    return view(dem, SurveyArea.rectangle(about, dem.crs) if area is None and is_small else area)


@styled
def residual_histogram(errors: FloatArray, statistics: ErrorStatistics) -> Figure:
    """Draw the distribution of residuals with the normal curve of their mean and standard deviation.

    Parameters
    ----------
    errors : (N,) ndarray
        Residuals [m].
    statistics : ErrorStatistics
        Of the same residuals.

    Returns
    -------
    matplotlib.figure.Figure
        As wide as half a page.

    Examples
    --------
    >>> residuals = np.array([-0.1, 0.0, 0.02, 0.1])
    >>> residual_histogram(residuals, ErrorStatistics.of(residuals)).axes[0].get_xlabel()
    'Residual [m]'
    """
    figure = Figure(figsize=(HALF_IN, _HALF_HEIGHT_IN), layout="constrained")
    axes = figure.add_subplot()
    reach = max(1.1 * statistics.worst_m, 1e-6)
    n_bins = int(np.clip(np.ceil(2.0 * np.cbrt(len(errors))), 5, 61))
    axes.hist(errors, bins=n_bins, range=(-reach, reach), color="#a9b7c2", edgecolor="white", linewidth=0.5)
    if statistics.std_m > 0.0:
        x = np.linspace(-reach, reach, 201)
        z = (x - statistics.bias_m) / statistics.std_m
        density = np.exp(-0.5 * z**2) / (np.sqrt(2.0 * np.pi) * statistics.std_m)
        axes.plot(x, len(errors) * 2.0 * reach / n_bins * density, color=CLAIM, label="Normal distribution")
    axes.axvline(statistics.bias_m, color=ESTIMATE, label=f"Mean {statistics.bias_m:+.3f} m")
    for sign in (-1.0, 1.0):
        label = f"±RMSE {statistics.rmse_m:.3f} m" if sign > 0.0 else None
        axes.axvline(sign * statistics.rmse_m, color=INK, linestyle="--", label=label)
    axes.set(xlim=(-reach, reach), xlabel="Residual [m]", ylabel="Number")
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_title("Distribution of the residuals")
    figure.legend(loc="outside lower center", ncols=2)
    return figure


@styled
def residual_quantiles(errors: FloatArray, statistics: ErrorStatistics) -> Figure:
    """Draw residuals against the quantiles of the normal distribution (Q-Q plot).

    Points on the line are normal with the residuals' median and NMAD; tails that bend away from it are heavier or
    lighter, and then NMAD and percentiles describe the errors better than the RMSE.

    Parameters
    ----------
    errors : (N,) ndarray
        Residuals [m]; of more than 2000 every n-th in order is drawn.
    statistics : ErrorStatistics
        Of the same residuals.

    Returns
    -------
    matplotlib.figure.Figure
        As wide as half a page.

    Examples
    --------
    >>> residuals = np.array([-0.1, 0.0, 0.02, 0.1])
    >>> residual_quantiles(residuals, ErrorStatistics.of(residuals)).axes[0].get_ylabel()
    'Residual [m]'
    """
    ordered = np.sort(errors)
    normal = ndtri((np.arange(len(ordered)) + 0.5) / len(ordered))
    every = max(len(ordered) // _MOST_QUANTILES, 1)
    figure = Figure(figsize=(HALF_IN, _HALF_HEIGHT_IN), layout="constrained")
    axes = figure.add_subplot()
    ends = np.array([normal[0], normal[-1]])
    axes.plot(
        ends,
        statistics.median_m + statistics.nmad_m * ends,
        color=MUTED,
        label="Normal with the median and NMAD of the residuals",
    )
    axes.plot(normal[::every], ordered[::every], "o", color=CLAIM, markersize=3.0)
    axes.set(xlabel="Quantile of the standard normal distribution", ylabel="Residual [m]")
    axes.grid(visible=True)
    axes.set_title("Normal quantiles")
    figure.legend(loc="outside lower center")
    return figure


def _name_points(axes: Any, names: tuple[str, ...], xyz: FloatArray) -> None:
    casing = [patheffects.withStroke(linewidth=2.0, foreground="white")]
    for name, (x, y, _) in zip(names, xyz, strict=True):
        axes.annotate(
            name,
            (x, y),
            xytext=(4.0, 4.0),
            textcoords="offset points",
            fontsize=6.5,
            path_effects=casing,
            zorder=7,
        )
