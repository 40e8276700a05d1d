"""Figures of errors of a map: against a reference terrain, and at checkpoints.

Errors against a reference are drawn as map, as histogram, by their distance from the route, and below profiles of the
terrain; residuals at checkpoints as map, as histogram, and as normal quantiles.
"""

from itertools import pairwise
from typing import Any

import numpy as np
import shapely
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator
from scipy.spatial import cKDTree
from scipy.special import ndtri

from survey.core import Bounds, FloatArray, InputError, same_crs, same_vertical_datum
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.route import Leg, Route
from survey.figures.layout import add_colour_bar, label_maps, map_figure, view
from survey.figures.map_layers import (
    along,
    draw_area,
    draw_raster,
    draw_relief,
    mark_signs,
    relief_exaggeration,
)
from survey.figures.maps import draw_outline_and_route
from survey.figures.style import (
    CLAIM,
    ERROR,
    ESTIMATE,
    FULL_IN,
    HALF_IN,
    INK,
    MUTED,
    PRIOR,
    REFERENCE,
    styled,
    symmetric_limits,
)
from survey.reconstruction.terrain_map import Reconstruction
from survey.scoring import ErrorStatistics
from survey.scoring.standards.checkpoint_errors import CheckpointErrors

_HALF_HEIGHT_IN = 3.3


def height_error(
    reconstruction: Reconstruction, reference: Dem, area: SurveyArea | None = None
) -> FloatArray:
    """Return reconstruction minus reference [m] at every node, (H, W).

    NaN outside the area, where the reference is not known and where the map is silent.

    Returns (H, W): error [m].

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
    $reconstruction
    $reference
    $area_shown
    $swaths

    $half_page

    Examples
    --------
    $two_surfaces
    >>> error_map(surveyed, flat).axes[0].get_xlabel()
    'Easting [m]'
    """
    error = height_error(reconstruction, reference, area)
    drawing = map_figure(HALF_IN, view(reconstruction.mean, area))
    axes = drawing.maps[0]
    limits = symmetric_limits(error)
    image = draw_raster(axes, error, reconstruction.mean, ERROR, limits)
    mark_signs(axes, error, reconstruction.mean, limits)
    draw_outline_and_route(axes, area, route)
    add_colour_bar(image, drawing, "Error [m]", extend="both")
    label_maps(drawing, "Reconstruction \u2212 reference", crs=reconstruction.mean.crs)
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
    $reconstruction
    $reference
    statistics : ErrorStatistics
        The numbers to mark.
    $area_counted

    $half_page

    Examples
    --------
    $two_surfaces
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
    $reconstruction
    $reference
    route : Route
        Distances are to all its legs, within half a step of the grid.
    $area_counted

    $half_page

    Examples
    --------
    $two_surfaces
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


_MOST_NAMES = 40
# Points in less than half of the map's length are shown with a margin of a tenth.
_SMALL_PART, _MARGIN = 0.5, 0.1
_MOST_QUANTILES = 2000


@styled
def residual_map(errors: CheckpointErrors, dem: Dem, area: SurveyArea | None = None) -> Figure:
    """Draw the residual at each checkpoint over the relief of the map."""
    if errors.xyz is None:
        raise InputError("the checkpoint errors have no places; compute them with compare.")
    drawing = map_figure(FULL_IN, _view(errors.xyz, dem, area))
    axes = drawing.maps[0]
    draw_relief(axes, dem, exaggeration=relief_exaggeration(dem))
    if area is not None:
        draw_area(axes, area, veil=False)
    reach = max(float(np.abs(errors.errors_m).max()), 1e-6)
    look: dict[str, Any] = {"cmap": ERROR, "norm": Normalize(-reach, reach), "edgecolors": INK}
    for marker, chosen in (("^", errors.errors_m >= 0.0), ("v", errors.errors_m < 0.0)):
        x, y, _ = errors.xyz[chosen].T
        points = axes.scatter(
            x, y, c=errors.errors_m[chosen], s=42.0, marker=marker, linewidths=0.7, zorder=6, **look
        )
    if len(errors.names) <= _MOST_NAMES:
        _name_points(axes, errors.names, errors.xyz)
    add_colour_bar(points, drawing, "Residual (map \u2212 checkpoint) [m]")
    label_maps(drawing, "Residuals at the checkpoints", crs=dem.crs)
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

    `errors` (N,): residuals [m].

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

    `errors` (N,): residuals [m]; of more than 2000 every n-th in order is drawn.

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
        label="Normal, of equal median and NMAD",
    )
    axes.plot(normal[::every], ordered[::every], "o", color=CLAIM, markersize=3.0)
    axes.set(xlabel="Quantile of the normal distribution", ylabel="Residual [m]")
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
            fontsize=8,
            path_effects=casing,
            zorder=7,
        )


@styled
def terrain_profile(
    reconstruction: Reconstruction,
    reference: Dem,
    route: Route,
    *,
    prior: Dem | None = None,
    area: SurveyArea | None = None,
) -> Figure:
    """Draw the terrain along the middle swath and across it, with the error below.

    Upper row: heights with a band of mean ± 2 σ. Lower row: reconstruction minus reference
    inside ± 2 σ, at a scale where centimetres can be read.

    Parameters
    ----------
    $reconstruction
    $reference
    route : Route
        Its middle swath is followed; the cross profile is the perpendicular through the
        middle of that swath's axis.
    prior : Dem, optional
        What was known before.
    area : SurveyArea, optional
        Profiles end at its outline.

    Returns
    -------
    matplotlib.figure.Figure
        As wide as a page: four axes, heights above errors.

    Examples
    --------
    $two_surfaces
    >>> from survey.data.route import Leg
    >>> route = Route((Leg("swath", [[0.0, 20.0], [60.0, 20.0]]),), "EPSG:32608", "line")
    >>> len(terrain_profile(surveyed, flat, route).axes)
    4
    """
    same_crs(reconstruction.mean.crs, reference.crs, "the reconstruction and the reference")
    swath = route.swaths[len(route.swaths) // 2]
    lines = {
        f"Along swath {len(route.swaths) // 2 + 1}": swath.xy,
        "Across the swaths": cross_line(swath, reconstruction.mean, area),
    }
    figure = Figure(figsize=(FULL_IN, 4.9), layout="constrained")
    panels = figure.subplots(2, 2, sharex="col", height_ratios=(2, 1))
    for column, (name, line) in enumerate(lines.items()):
        _draw_profile(
            panels[:, column],
            line,
            reconstruction=reconstruction,
            reference=reference,
            prior=prior,
            area=area,
        )
        panels[0, column].set_title(name)
    _mark_crossings(panels[:, 1], lines["Across the swaths"], route)
    figure.legend(*panels[0, 1].get_legend_handles_labels(), loc="outside lower center", ncols=5)
    return figure


def cross_line(swath: Leg, terrain: Dem, area: SurveyArea | None = None) -> FloatArray:
    """Return both ends (2, 2) [m] of the perpendicular through the middle of a swath's axis.

    It runs to the outermost nodes of the terrain or to the outline of the area.

    >>> from survey.data.grid import Grid
    >>> grid = Grid((0.0, 0.0, 40.0, 20.0), 10.0)
    >>> cross_line(Leg("swath", [[0.0, 5.0], [40.0, 5.0]]), Dem.on(grid, np.zeros(grid.shape)))
    array([[20.,  0.],
           [20., 20.]])
    """
    centre = swath.axis.mean(axis=0)
    direction = swath.axis[1] - swath.axis[0]
    normal = np.array([-direction[1], direction[0]]) / max(float(np.hypot(*direction)), 1e-9)
    # West to east, or south to north when the line runs due north.
    normal = normal if (round(normal[0], 9), normal[1]) > (0.0, 0.0) else -normal
    ground = shapely.box(*terrain.grid().bounds)
    reach = float(np.hypot(*np.ptp(shapely.get_coordinates(ground), axis=0)))
    whole = shapely.LineString([centre - reach * normal, centre + reach * normal])
    cut = whole.intersection(ground if area is None else ground.intersection(area.polygon))
    offsets = (shapely.get_coordinates(cut) - centre) @ normal
    if offsets.size == 0:
        offsets = np.array([-0.5, 0.5]) * terrain.step_m
    ends: FloatArray = centre + np.outer([offsets.min(), offsets.max()], normal)
    return ends


def _draw_profile(
    panels: tuple[Axes, Axes],
    line: FloatArray,
    *,
    reconstruction: Reconstruction,
    reference: Dem,
    prior: Dem | None,
    area: SurveyArea | None,
) -> None:
    """Draw heights above and their error below, against the distance along a line."""
    heights, errors = panels
    distance, xy = _sampled(line, reconstruction.mean.step_m)
    here = np.ones(len(xy), dtype=bool) if area is None else area.contains(xy)
    mean, std, real = (
        np.where(here, dem.at(xy), np.nan) for dem in (reconstruction.mean, reconstruction.std, reference)
    )
    heights.plot(distance, real, color=REFERENCE, linewidth=1.1, label="Reference", zorder=3)
    heights.plot(
        distance,
        mean,
        color=ESTIMATE,
        linewidth=1.2,
        linestyle=(0, (4, 1.5)),
        label="Reconstruction",
        zorder=4,
    )
    band: dict[str, Any] = {"color": ESTIMATE, "alpha": 0.25, "linewidth": 0}
    heights.fill_between(distance, mean - 2 * std, mean + 2 * std, label="± 2 σ", **band)
    if prior is not None:
        before = np.where(here, prior.at(xy), np.nan)
        heights.plot(distance, before, color=PRIOR, linestyle=":", linewidth=1.2, label="Prior", zorder=2)
    errors.fill_between(distance, -2 * std, 2 * std, **band)
    errors.axhline(0.0, color=MUTED, linewidth=0.7)
    errors.plot(distance, mean - real, color=INK, linewidth=1.0)
    heights.set_ylabel("Elevation [m]")
    errors.set(xlabel="Distance [m]", ylabel="Error [m]", xlim=(0.0, distance[-1]))
    for axes in panels:
        axes.grid(visible=True, axis="y")


def _sampled(line: FloatArray, step_m: float) -> tuple[FloatArray, FloatArray]:
    """Return distances (N,) and places (N, 2) about one grid step apart along a polyline."""
    length = float(np.hypot(*np.diff(line, axis=0).T).sum())
    shares = np.linspace(0.0, 1.0, max(int(length / step_m), 1) + 1)
    return shares * length, along(line, shares)


def _mark_crossings(panels: tuple[Axes, Axes], line: FloatArray, route: Route) -> None:
    """Mark, on the profiles, where the route was driven across them."""
    path = shapely.LineString(line)
    crossings = shapely.get_coordinates(shapely.intersection(route.line, path))
    if crossings.size == 0:
        return
    distance = np.unique(np.hypot(*(crossings - line[0]).T).round(3))
    for axes, label in zip(panels, ("Route", None), strict=True):
        axes.plot(
            distance,
            np.zeros(distance.size),
            marker="^",
            color=CLAIM,
            markersize=6,
            linestyle="none",
            transform=axes.get_xaxis_transform(),
            clip_on=False,
            label=label,
            zorder=5,
        )
