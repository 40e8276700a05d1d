"""Figures of the error: where it is, how large, how it grows off the route, and if the claim fits it."""

from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter
from scipy.spatial import cKDTree

from survey.core.arrays import FloatArray
from survey.core.crs.agreement import same_crs
from survey.core.crs.vertical_datum import same_vertical_datum
from survey.core.errors import InputError
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.route import Route
from survey.figures.cartography import add_colour_bar, draw_raster, map_figure, view
from survey.figures.maps import draw_outline_and_route
from survey.figures.style import (
    CLAIM,
    ERROR,
    ESTIMATE,
    FULL_IN,
    HALF_IN,
    INK,
    MUTED,
    REFERENCE,
    styled,
    symmetric_limits,
)
from survey.reconstruction.base import Reconstruction
from survey.scoring import Calibration, ErrorStatistics

_HALF_HEIGHT_IN = 3.3


def height_error(
    reconstruction: Reconstruction, reference: Dem, area: SurveyArea | None = None
) -> FloatArray:
    """Return reconstruction minus reference [m] at every node, (H, W).

    NaN outside the area, where the reference is not known and where the map is silent.

    Parameters
    ----------
    reconstruction : Reconstruction
        Map of the survey.
    reference : Dem
        Reference terrain, interpolated to the nodes.
    area : SurveyArea, optional
        Nodes outside it become NaN.

    Returns
    -------
    (H, W) ndarray
        Error [m].

    Raises
    ------
    InputError
        When map and reference are in different CRS or above different vertical datums, or share no node.

    Examples
    --------
    >>> from survey.data.grid import Grid
    >>> grid = Grid((0.0, 0.0, 2.0, 1.0), 1.0)
    >>> flat, raised = (Dem.on(grid, np.full(grid.shape, z)) for z in (5.0, 5.25))
    >>> surveyed = Reconstruction(raised, flat, np.full(grid.shape, 3), "tin", {})
    >>> float(height_error(surveyed, flat).max())
    0.25
    """
    mean = reconstruction.mean
    same_crs(mean.crs, reference.crs, "the reconstruction and the reference")
    same_vertical_datum(mean.vertical_datum, reference.vertical_datum, "the reconstruction and the reference")
    nodes = mean.xy
    error = mean.elevation.ravel() - reference.at(nodes)
    if area is not None:
        area.require_crs(mean.crs, "the reconstruction")
        error = np.where(area.contains(nodes), error, np.nan)
    if not np.isfinite(error).any():
        raise InputError("no node of the map lies on known reference ground; nothing can be compared.")
    return error.reshape(mean.shape)


@styled
def error_map(
    reconstruction: Reconstruction,
    reference: Dem,
    *,
    area: SurveyArea | None = None,
    route: Route | None = None,
) -> Figure:
    """Draw reconstruction minus reference; the colours are symmetric about zero.

    The limits hold 99 % of the errors; larger ones take the colour of the arrow.

    Parameters
    ----------
    reconstruction : Reconstruction
        The survey's map.
    reference : Dem
        The terrain as it is.
    area : SurveyArea, optional
        Only nodes inside are shown.
    route : Route, optional
        Its swaths are drawn as thin lines.

    Returns
    -------
    matplotlib.figure.Figure
        As wide as half a page.
    """
    error = height_error(reconstruction, reference, area)
    drawing = map_figure(HALF_IN, view(reconstruction.mean, area))
    axes = drawing.maps[0]
    image = draw_raster(axes, error, reconstruction.mean, ERROR, symmetric_limits(error))
    draw_outline_and_route(axes, area, route)
    add_colour_bar(image, drawing, "Error [m]", extend="both")
    axes.set_title("Reconstruction \u2212 reference")
    return drawing.figure


@styled
def error_histogram(
    reconstruction: Reconstruction,
    reference: Dem,
    statistics: ErrorStatistics,
    *,
    area: SurveyArea | None = None,
) -> Figure:
    """Draw the distribution of the errors with RMSE, NMAD and the 95th percentile of their size.

    Parameters
    ----------
    reconstruction : Reconstruction
        The survey's map.
    reference : Dem
        The terrain as it is.
    statistics : ErrorStatistics
        The numbers to mark.
    area : SurveyArea, optional
        Only nodes inside count.

    Returns
    -------
    matplotlib.figure.Figure
        As wide as half a page.
    """
    error = height_error(reconstruction, reference, area)
    error = error[np.isfinite(error)]
    figure = Figure(figsize=(HALF_IN, _HALF_HEIGHT_IN), layout="constrained")
    axes = figure.add_subplot()
    reach = max(float(np.percentile(np.abs(error), 99.5)), 1.1 * statistics.p95_m, 1e-6)
    weights = np.full(error.size, 1.0 / error.size)
    axes.hist(error, bins=61, range=(-reach, reach), weights=weights, color="#a9b7c2", linewidth=0)
    marks = (
        ("NMAD", statistics.nmad_m, CLAIM, ":"),
        ("RMSE", statistics.rmse_m, ESTIMATE, "-"),
        ("95% of |error|", statistics.p95_m, INK, "--"),
    )
    for name, value, colour, dashes in marks:
        axes.axvline(value, color=colour, linestyle=dashes, label=f"±{name}: {value:.3f} m")
        axes.axvline(-value, color=colour, linestyle=dashes)
    axes.set_xlim(-reach, reach)
    axes.set_xlabel("Reconstruction \u2212 reference [m]")
    axes.set_ylabel("Share of nodes")
    axes.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0))
    axes.set_title("Distribution of the error")
    figure.legend(loc="outside lower center", ncols=2)
    return figure


@styled
def error_against_distance(
    reconstruction: Reconstruction, reference: Dem, route: Route, *, area: SurveyArea | None = None
) -> Figure:
    """Draw how error and claimed deviation grow with the distance to the route.

    Nodes are sorted into up to fifteen bands of distance; bands with fewer than thirty
    nodes are left out.

    Parameters
    ----------
    reconstruction : Reconstruction
        The survey's map.
    reference : Dem
        The terrain as it is.
    route : Route
        Distances are to all its legs, within half a step of the grid.
    area : SurveyArea, optional
        Only nodes inside count.

    Returns
    -------
    matplotlib.figure.Figure
        As wide as half a page.
    """
    error = height_error(reconstruction, reference, area).ravel()
    known = np.isfinite(error)
    size, claim = np.abs(error[known]), reconstruction.std.elevation.ravel()[known]
    distance = _distance_to(route, reconstruction.mean.xy[known], reconstruction.mean.step_m)
    edges = np.linspace(0.0, float(distance.max()) + 1e-9, 16)
    bands = [np.flatnonzero((distance >= low) & (distance < high)) for low, high in pairwise(edges)]
    kept = [
        (middle, band)
        for middle, band in zip((edges[:-1] + edges[1:]) / 2, bands, strict=True)
        if band.size >= 30
    ]
    middles = [middle for middle, _ in kept]
    figure = Figure(figsize=(HALF_IN, _HALF_HEIGHT_IN), layout="constrained")
    axes = figure.add_subplot()
    curves = (
        ("95% of |error|", [np.percentile(size[band], 95.0) for _, band in kept], INK, "--"),
        ("RMSE", [_rms(size[band]) for _, band in kept], ESTIMATE, "-"),
        ("Claimed σ", [_rms(claim[band]) for _, band in kept], CLAIM, "-."),
    )
    for name, values, colour, dashes in curves:
        axes.plot(middles, values, color=colour, linestyle=dashes, marker="o", markersize=3, label=name)
    axes.set(xlim=(0.0, edges[-1]), xlabel="Distance to the route [m]", ylabel="Error and σ [m]")
    axes.set_ylim(bottom=0.0)
    axes.grid(visible=True, axis="y")
    axes.set_title("Error against distance")
    figure.legend(loc="outside lower center", ncols=3)
    return figure


def _distance_to(route: Route, xy: FloatArray, step_m: float) -> FloatArray:
    places = np.vstack([route.sample(step_m, rover).xy for rover in range(route.n_rovers)])
    return np.asarray(cKDTree(places).query(xy)[0], dtype=np.float64)


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


@styled
def calibration_plot(
    reconstruction: Reconstruction,
    reference: Dem,
    calibration: Calibration,
    *,
    area: SurveyArea | None = None,
) -> Figure:
    r"""Draw if the claimed uncertainty is honest.

    Left: the share of nodes whose error lies within the claimed interval, against the
    interval's nominal level; on the diagonal the claim is right, below it too confident.
    Right: the size of the error in claimed standard deviations, beside the half-normal
    density :math:`\sqrt{2/\pi} \exp(-z^2/2)` that it should follow.

    Parameters
    ----------
    reconstruction : Reconstruction
        The survey's map.
    reference : Dem
        The terrain as it is.
    calibration : Calibration
        Nominal levels and observed shares.
    area : SurveyArea, optional
        Only nodes inside count.

    Returns
    -------
    matplotlib.figure.Figure
        As wide as a page.
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
