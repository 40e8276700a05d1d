"""Figures of the error: map, histogram, growth with the distance from the route."""

from itertools import pairwise

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter
from scipy.spatial import cKDTree

from survey.core.arrays import FloatArray
from survey.core.crs.agreement import same_crs
from survey.core.crs.vertical_datum import same_vertical_datum
from survey.core.errors import InputError
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.route import Route
from survey.figures.cartography.layout import add_colour_bar, map_figure, view
from survey.figures.cartography.relief import draw_raster
from survey.figures.maps import draw_outline_and_route
from survey.figures.style import (
    CLAIM,
    ERROR,
    ESTIMATE,
    HALF_IN,
    INK,
    styled,
    symmetric_limits,
)
from survey.reconstruction.base import Reconstruction
from survey.scoring import ErrorStatistics

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

    Examples
    --------
    >>> from survey.data.grid import Grid
    >>> grid = Grid((0.0, 0.0, 60.0, 40.0), 2.0)
    >>> flat, raised = (Dem.on(grid, np.full(grid.shape, z)) for z in (5.0, 5.25))
    >>> surveyed = Reconstruction(raised, flat, np.full(grid.shape, 3), "tin", {})
    >>> error_map(surveyed, flat).axes[0].get_xlabel()
    'Easting [m]'
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

    Examples
    --------
    >>> from survey.data.grid import Grid
    >>> grid = Grid((0.0, 0.0, 60.0, 40.0), 2.0)
    >>> flat, raised = (Dem.on(grid, np.full(grid.shape, z)) for z in (5.0, 5.25))
    >>> surveyed = Reconstruction(raised, flat, np.full(grid.shape, 3), "tin", {})
    >>> error_histogram(surveyed, flat, ErrorStatistics.of(height_error(surveyed, flat))).axes[0].get_xlabel()
    'Reconstruction − reference [m]'
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
    axes.yaxis.set_major_formatter(FuncFormatter(lambda share, _: f"{100.0 * share:g}%"))
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

    Examples
    --------
    >>> from survey.data.grid import Grid
    >>> grid = Grid((0.0, 0.0, 60.0, 40.0), 2.0)
    >>> flat, raised = (Dem.on(grid, np.full(grid.shape, z)) for z in (5.0, 5.25))
    >>> surveyed = Reconstruction(raised, flat, np.full(grid.shape, 3), "tin", {})
    >>> from survey.data.route import Leg
    >>> route = Route((Leg("swath", [[0.0, 20.0], [60.0, 20.0]]),), "EPSG:32608", "line")
    >>> error_against_distance(surveyed, flat, route).axes[0].get_xlabel()
    'Distance to the route [m]'
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
