"""Maps of a survey: terrain and route, surfaces side by side, and one quantity over the area.

The quantities are the standard deviation, the support of the map by measurements, the width between lower and
upper bound, a field of the payload or a probability, an intensity of counts with its interval, the density of landmarks, and the change between two
surveys. Maps of errors stand in `survey.figures.errors`, those of a planned route in `survey.figures.plans`.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, Colormap, ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, PathPatch
from shapely import MultiPolygon, Polygon

from survey.core import FloatArray, round_number
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.route import Route
from survey.data.surface_points import SurfacePoints
from survey.figures.layout import (
    MapFigure,
    add_colour_bar,
    add_legend,
    grouped,
    label_maps,
    map_figure,
    view,
    widen,
)
from survey.figures.map_layers import (
    decimate,
    draw_area,
    draw_cells,
    draw_contours,
    draw_raster,
    draw_route,
    draw_route_lines,
    draw_shaded_elevation,
    elevation_limits,
    mark_signs,
    outline_path,
    relief_exaggeration,
)
from survey.figures.style import (
    DENSITY,
    DEVIATION,
    ERROR,
    FULL_IN,
    HALF_IN,
    INK,
    NO_GO,
    VEIL,
    styled,
    symmetric_limits,
)
from survey.reconstruction.terrain_map import INTERPOLATED, MEASURED, RAY_BOUNDED, UNSEEN, Reconstruction
from survey.scoring.differencing.volume_change import Change

if TYPE_CHECKING:
    from survey.scoring.differencing.m3c2 import CloudDistances  # loads compiled loops

SUPPORT = {
    UNSEEN: ("Unseen", "#efefef"),
    INTERPOLATED: ("Interpolated", "#a6cee3"),
    RAY_BOUNDED: ("Ray-bounded", "#c98500"),
    MEASURED: ("Measured", "#17486b"),
}
"""Name and colour of each category of support; the better supported, the darker, also in grey."""


@styled
def survey_map(terrain: Dem, *, area: SurveyArea | None = None, route: Route | None = None) -> Figure:
    """Draw the hillshaded terrain with contours, the area, no-go ground and the route.

    Swaths are numbered in driving order and carry an arrow, transits are dashed, each
    rover has its colour.

    Parameters
    ----------
    terrain : Dem
        Background of the map.
    area : SurveyArea, optional
        Outline and no-go zones; ground outside is veiled.
    route : Route, optional
        In the CRS of the terrain.

    $page

    Raises
    ------
    InputError
        When the area is in another CRS than the terrain.

    Examples
    --------
    >>> from survey.data.grid import Grid
    >>> grid = Grid((0.0, 0.0, 40.0, 20.0), 10.0)
    >>> figure = survey_map(Dem.on(grid, grid.xy[:, 0].reshape(grid.shape)))
    >>> figure.axes[0].get_xlabel()
    'Easting [m]'
    """
    if area is not None:
        area.require_crs(terrain.crs, "the terrain")
    bounds = view(terrain, area)
    drawing = map_figure(FULL_IN, bounds)
    axes = drawing.maps[0]
    limits = elevation_limits(terrain)
    image = draw_shaded_elevation(axes, terrain, limits, exaggeration=relief_exaggeration(terrain))
    handles: list[Artist] = [*draw_contours(axes, terrain, within=area)]
    if area is not None:
        handles += draw_area(axes, area)
    if route is not None:
        handles += draw_route(axes, route)
    add_colour_bar(image, drawing, "Elevation [m]")
    label_maps(drawing, "Survey map", crs=terrain.crs)
    add_legend(drawing, handles)
    return drawing.figure


@styled
def terrain_comparison(
    reference: Dem,
    reconstruction: Reconstruction,
    prior: Dem | None = None,
    *,
    area: SurveyArea | None = None,
) -> Figure:
    """Draw reference, reconstruction and prior side by side with the same colour limits.

    Parameters
    ----------
    reference : Dem
        True terrain.
    $reconstruction
    prior : Dem, optional
        Prior, e.g. from a satellite.
    $area_extent

    Returns
    -------
    matplotlib.figure.Figure
        As wide as a page; one axes per surface, one colour bar.

    Examples
    --------
    $two_surfaces
    >>> terrain_comparison(flat, surveyed).axes[0].get_xlabel()
    'Easting [m]'
    """
    bounds = view(reconstruction.mean, area)
    surfaces = {"Reference": reference, "Reconstruction": reconstruction.mean}
    if prior is not None:
        surfaces[f"Prior, {prior.step_m:g} m cells"] = prior
    drawing = map_figure(FULL_IN, bounds, n_maps=len(surfaces))
    shown = [crop(dem, bounds) for dem in surfaces.values()]
    limits = elevation_limits(*shown)
    exaggeration = relief_exaggeration(reconstruction.mean)
    for axes, dem in zip(drawing.maps, shown, strict=True):
        image = draw_shaded_elevation(axes, dem, limits, exaggeration=exaggeration)
        if area is not None:
            draw_area(axes, area)
    add_colour_bar(image, drawing, "Elevation [m]")
    label_maps(drawing, *surfaces, crs=reconstruction.mean.crs)
    return drawing.figure


@styled
def deviation_map(
    reconstruction: Reconstruction,
    *,
    area: SurveyArea | None = None,
    route: Route | None = None,
    width_in: float = HALF_IN,
) -> Figure:
    """Draw the standard deviation of a reconstruction.

    Parameters
    ----------
    $reconstruction
    $area_shown
    $swaths
    $width

    $half_page

    Examples
    --------
    $two_surfaces
    >>> deviation_map(surveyed).axes[0].get_xlabel()
    'Easting [m]'
    """
    std = reconstruction.std
    drawing = map_figure(width_in, view(std, area))
    axes = drawing.maps[0]
    values = np.array(std.elevation)
    if area is not None:
        values[~area.contains(std.xy).reshape(std.shape)] = np.nan
    stated = values[np.isfinite(values)]
    top = float(np.percentile(stated, 99.5)) if stated.size else 1.0
    image = draw_raster(axes, values, std, DEVIATION, Normalize(0.0, max(top, 1e-9)))
    draw_outline_and_route(axes, area, route)
    extend = "max" if (stated > top).any() else "neither"
    add_colour_bar(image, drawing, "Standard deviation [m]", extend=extend)
    label_maps(drawing, "Claimed uncertainty (1 σ)", crs=std.crs)
    return drawing.figure


@styled
def support_map(
    reconstruction: Reconstruction,
    *,
    area: SurveyArea | None = None,
    route: Route | None = None,
    width_in: float = HALF_IN,
) -> Figure:
    """Draw the support of each node: measured, bounded by a line of sight, interpolated, unseen.

    Parameters
    ----------
    $reconstruction
    area : SurveyArea, optional
        Its outline is drawn; the shares in the legend then count nodes inside it.
    $swaths
    $width

    $half_page

    Examples
    --------
    $two_surfaces
    >>> support_map(surveyed).axes[0].get_xlabel()
    'Easting [m]'
    """
    dem = reconstruction.mean
    drawing = map_figure(width_in, view(dem, area))
    axes = drawing.maps[0]
    codes = np.array(reconstruction.support, dtype=np.float64)
    colours = ListedColormap([colour for _, colour in SUPPORT.values()])
    image = draw_raster(axes, codes, dem, colours, BoundaryNorm([-0.5, 0.5, 1.5, 2.5, 3.5], 4))
    draw_outline_and_route(axes, area, route)
    counted = codes.ravel() if area is None else codes.ravel()[area.contains(dem.xy)]
    add_colour_bar(image, drawing, "")
    shares = [f"{name}\n{np.mean(counted == code):.0%}" for code, (name, _) in SUPPORT.items()]
    drawing.bar.set_yticks(list(SUPPORT), shares)
    drawing.bar.tick_params(length=0)
    label_maps(drawing, "Support", crs=dem.crs)
    return drawing.figure


def draw_outline_and_route(axes: Axes, area: SurveyArea | None, route: Route | None) -> None:
    """Draw the outline of the area and the route as thin lines."""
    if area is not None:
        draw_area(axes, area, veil=False)
    if route is not None:
        draw_route_lines(axes, route)


def crop(dem: Dem, bounds: tuple[float, float, float, float]) -> Dem:
    """Return the cells within bounds, so that far ones do not set the colours."""
    xmin, ymin, xmax, ymax = bounds
    margin = dem.step_m
    return dem.window((xmin - margin, ymin - margin, xmax + margin, ymax + margin))


@styled
def width_map(reconstruction: Reconstruction, *, width_in: float = HALF_IN) -> Figure:
    """Draw the distance between the lower and the upper bound of the elevation.

    `width_in`: width of the figure [in].

    >>> from survey.data.dem import Dem
    >>> from survey.data.grid import Grid
    >>> grid = Grid((0.0, 0.0, 40.0, 20.0), 10.0)
    >>> level = Dem.on(grid, np.ones(grid.shape))
    >>> width_map(Reconstruction(level, level, np.ones(grid.shape), "gp", {})).axes[0].get_title(loc="left")
    'Between the bounds'
    """
    lower, upper = reconstruction.interval()
    width = np.where(reconstruction.support == UNSEEN, np.nan, upper.elevation - lower.elevation)
    drawing = map_figure(width_in, view(reconstruction.mean, None))
    stated = width[np.isfinite(width)]
    top = float(np.percentile(stated, 99.0)) if stated.size else 1.0
    image = draw_raster(
        drawing.maps[0], width, reconstruction.mean, DEVIATION, Normalize(0.0, max(top, 1e-9))
    )
    add_colour_bar(image, drawing, "Upper - lower [m]", extend="max" if (stated > top).any() else "neither")
    label_maps(drawing, "Between the bounds", crs=reconstruction.mean.crs)
    return drawing.figure


def quantity_plot(dem: Dem, label: str, *, area: SurveyArea, route: Route) -> Figure:
    """Draw the map of a quantity; `label` is its name and unit."""
    values = _inside_area(dem, area)
    low, high = (float(v) for v in np.nanpercentile(values, [0.5, 99.5]))
    limits = Normalize(low, max(high, low + 1e-9))
    words = (label.split(" [", maxsplit=1)[0], label)
    return _field_map(dem, values, (colormaps["cividis"], limits), words, (area, route))


def uncertainty_plot(dem: Dem, label: str, *, area: SurveyArea, route: Route) -> Figure:
    """Draw the standard deviation of a quantity; `label` is the quantity's name and unit."""
    values = _inside_area(dem, area)
    limits = Normalize(0.0, max(float(np.nanpercentile(values, 99.5)), 1e-9))
    words = ("Claimed uncertainty (1 σ)", f"1 σ of {label}")
    return _field_map(dem, values, (DEVIATION, limits), words, (area, route))


def probability_plot(dem: Dem, title: str, *, area: SurveyArea, route: Route) -> Figure:
    """Draw a map of probabilities."""
    words = (title, "Probability")
    return _field_map(dem, _inside_area(dem, area), (DEVIATION, Normalize(0.0, 1.0)), words, (area, route))


def _inside_area(dem: Dem, area: SurveyArea) -> FloatArray:
    return np.where(area.contains(dem.xy).reshape(dem.shape), dem.elevation, np.nan)


@styled
def _field_map(
    dem: Dem,
    values: FloatArray,
    colours: tuple[Colormap, Normalize],
    words: tuple[str, str],
    place: tuple[SurveyArea, Route],
) -> Figure:
    """Draw values on the grid of a raster, half a page wide, with a title and the label of the colours."""
    drawing = map_figure(HALF_IN, view(dem, place[0]))
    image = draw_raster(drawing.maps[0], values, dem, *colours)
    draw_area(drawing.maps[0], place[0])
    draw_route_lines(drawing.maps[0], place[1])
    add_colour_bar(image, drawing, words[1])
    label_maps(drawing, words[0], crs=dem.crs)
    return drawing.figure


@styled
def intensity_map(intensity: Dem, way: FloatArray, source: tuple[FloatArray, float] | None = None) -> Figure:
    """Draw an intensity [counts/s] in orders of magnitude, the way of the detector (N, 2) [m], and a circle about a source.

    `source`: place (2,) and radius [m].
    """
    logarithm = np.log10(np.maximum(intensity.elevation, 1e-9))
    low, high = (float(v) for v in np.nanpercentile(logarithm, [0.5, 99.5]))
    drawing = _map_of_counts(intensity, logarithm, (colormaps["cividis"], low, max(high, low + 0.1)), way)
    if source is not None:
        (x, y), radius_m = source
        circle = Circle((x, y), radius_m, fill=False, edgecolor=NO_GO, linewidth=1.4, zorder=5)
        drawing.maps[0].add_patch(circle)
    label_maps(drawing, "Intensity, log₁₀ of counts per second", crs=intensity.crs)
    return drawing.figure


@styled
def interval_map(factor: Dem, way: FloatArray) -> Figure:
    """Draw by which factor the 95 % interval of an intensity reaches beyond its median, and the way of the detector (N, 2) [m]."""
    high = max(float(np.nanpercentile(factor.elevation, 99.5)), 1.1)
    drawing = _map_of_counts(factor, factor.elevation, (DEVIATION, 1.0, high), way)
    label_maps(drawing, "Factor to the end of the 95 % interval", crs=factor.crs)
    return drawing.figure


def _map_of_counts(
    dem: Dem, values: FloatArray, colours: tuple[Colormap, float, float], way: FloatArray
) -> MapFigure:
    drawing = map_figure(HALF_IN, view(dem, None))
    colour_map, low, high = colours
    image = draw_raster(drawing.maps[0], values, dem, colour_map, Normalize(low, high))
    drawing.maps[0].plot(*way.T, color=INK, linewidth=0.5, alpha=0.6, zorder=3.5)
    add_colour_bar(image, drawing, "", extend="both")
    return drawing


@styled
def landmark_map(
    points: SurfacePoints,
    terrain: Dem,
    *,
    area: SurveyArea | None = None,
    route: Route | None = None,
    name: str = "Landmarks",
) -> Figure:
    """Draw the density of the measured points.

    Points are counted in squares of a round size, about thirty to the longer side.

    Parameters
    ----------
    points : SurfacePoints
        Landmarks or other measured points.
    terrain : Dem
        Gives the extent of the map.
    $area_extent
    $swaths
    name : str
        What the points are.

    $half_page

    Examples
    --------
    >>> from survey.data.grid import Grid
    >>> grid = Grid((0.0, 0.0, 60.0, 40.0), 2.0)
    >>> flat = Dem.on(grid, np.zeros(grid.shape))
    >>> xyz = np.column_stack([grid.xy, np.zeros(len(grid.xy))])
    >>> points = SurfacePoints(xyz, sigma_m=np.full(len(xyz), 0.1), crs="EPSG:32608")
    >>> landmark_map(points, flat).axes[0].get_xlabel()
    'Easting [m]'
    """
    bounds = view(terrain, area)
    drawing = map_figure(HALF_IN, bounds)
    axes = drawing.maps[0]
    xmin, ymin, xmax, ymax = bounds
    cell = round_number(max(xmax - xmin, ymax - ymin) / 30.0)
    east, north = np.arange(xmin, xmax + cell, cell), np.arange(ymin, ymax + cell, cell)
    x, y = points.xy.T
    counts = np.histogram2d(x, y, bins=[east, north])[0].T
    top = float(np.percentile(counts[counts > 0], 98.0)) if counts.any() else 1.0
    shown = np.where(counts > 0, counts, np.nan)
    image = axes.pcolormesh(east, north, shown, cmap=DENSITY, norm=Normalize(0.0, top), zorder=1)
    axes.plot(
        *points.xy.T, ".", color=INK, alpha=0.5, markersize=1.2, markeredgewidth=0, zorder=2, rasterized=True
    )
    axes.set(xlim=(xmin, xmax), ylim=(ymin, ymax))
    draw_outline_and_route(axes, area, route)
    add_colour_bar(
        image, drawing, f"Points per {cell:g} m square", extend="max" if counts.max() > top else "neither"
    )
    label_maps(drawing, f"{name} ({grouped(len(points))})", crs=points.crs)
    return drawing.figure


@styled
def change_map(change: Change, outlines: Mapping[str, Polygon | MultiPolygon]) -> Figure:
    """Draw the difference of two surveys; changes that are not significant are veiled.

    `outlines`: drawn on top [m].

    >>> import shapely
    >>> from survey.data.dem import Dem
    >>> from survey.data.grid import Grid
    >>> grid = Grid((0.0, 0.0, 40.0, 20.0), 10.0)
    >>> difference = Dem.on(grid, np.linspace(-1.0, 1.0, 15).reshape(grid.shape))
    >>> change = Change(difference, np.full(grid.shape, 0.2), np.ones(grid.shape), (), "variogram")
    >>> change_map(change, {"ice": shapely.box(5.0, 5.0, 20.0, 15.0)}).axes[0].get_xlabel()
    'Easting [m]'
    """
    difference = decimate(change.difference)
    step = round(difference.step_m / change.difference.step_m)
    doubtful = np.asarray(change.significant)[::step, ::step] == 0
    drawing = map_figure(FULL_IN, view(change.difference, None))
    axes = drawing.maps[0]
    limits = symmetric_limits(difference.elevation)
    image = draw_raster(axes, difference.elevation, difference, ERROR, limits)
    mark_signs(axes, np.where(doubtful, 0.0, difference.elevation), difference, limits)
    veil = np.full((*difference.shape, 4), 255, dtype=np.uint8)
    veil[..., 3] = np.where(doubtful & np.isfinite(difference.elevation), 166, 0)
    draw_cells(axes, veil, difference, zorder=1.5)
    for shape in outlines.values():
        axes.add_patch(PathPatch(outline_path(shape), fill=False, edgecolor=INK, linewidth=1.3, zorder=4))
    add_colour_bar(image, drawing, "Change of height [m]", extend="both")
    label_maps(drawing, "Later \u2212 earlier", crs=change.difference.crs)
    handles = [
        Line2D([], [], color=INK, linewidth=1.3, label="Outline"),
        Patch(facecolor="white", edgecolor=VEIL, label="Pale: not significant at 95 %"),
    ]
    add_legend(drawing, handles)
    return drawing.figure


@styled
def distance_map(found: "CloudDistances", outlines: Mapping[str, Polygon | MultiPolygon]) -> Figure:
    """Draw the distances between two point clouds at the core points; those below the level of detection are pale.

    `outlines`: drawn on top [m].
    """
    x, y = found.xyz[:, :2].T
    west, south, east, north = widen((x.min(), y.min(), x.max(), y.max()))
    margin = max(0.02 * (east - west), found.scales.spacing_m)
    drawing = map_figure(FULL_IN, (west - margin, south - margin, east + margin, north + margin))
    axes = drawing.maps[0]
    # Half of the spacing to each side, in points of the printed map.
    width_pt = 72.0 * axes.get_position().width * FULL_IN / (east - west + 2.0 * margin)
    size = max(1.0, (found.scales.spacing_m * width_pt) ** 2)
    limits, beyond = symmetric_limits(found.distance_m), found.significant != 0
    look: dict[str, Any] = {
        "marker": "s",
        "cmap": ERROR,
        "norm": limits,
        "linewidths": 0.0,
        "rasterized": True,
    }
    for chosen, alpha in ((~beyond, 0.35), (beyond, 1.0)):
        points = axes.scatter(x[chosen], y[chosen], size, found.distance_m[chosen], alpha=alpha, **look)
    for shape in outlines.values():
        axes.add_patch(PathPatch(outline_path(shape), fill=False, edgecolor=INK, linewidth=1.3, zorder=4))
    add_colour_bar(points, drawing, "Distance along the normal [m]", extend="both")
    label_maps(drawing, "Later \u2212 earlier", crs=found.crs)
    add_legend(
        drawing, [Patch(facecolor="white", edgecolor=VEIL, label="Pale: below the level of detection (95 %)")]
    )
    return drawing.figure
