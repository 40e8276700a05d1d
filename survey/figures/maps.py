"""Maps of a survey: terrain and route, surfaces side by side, standard deviation, support."""

import math

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap, Normalize
from matplotlib.figure import Figure

from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.route import Route
from survey.figures.cartography.layout import (
    add_colour_bar,
    map_figure,
    view,
)
from survey.figures.cartography.relief import (
    draw_contours,
    draw_raster,
    draw_terrain,
    elevation_limits,
    relief_exaggeration,
)
from survey.figures.cartography.routes import draw_area, draw_route, draw_route_lines
from survey.figures.cartography.scale_bar import draw_scale_and_north
from survey.figures.style import DEVIATION, FULL_IN, HALF_IN, styled
from survey.reconstruction.base import INTERPOLATED, MEASURED, RAY_BOUNDED, UNSEEN, Reconstruction

SUPPORT = {
    UNSEEN: ("Unseen", "#dcdcdc"),
    INTERPOLATED: ("Interpolated", "#a6cee3"),
    RAY_BOUNDED: ("Ray-bounded", "#e6ab02"),
    MEASURED: ("Measured", "#1f5f8b"),
}
"""Name and colour of each category of support."""


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

    Returns
    -------
    matplotlib.figure.Figure
        As wide as a page.

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
    drawing = map_figure(FULL_IN, bounds, legend=True)
    axes = drawing.maps[0]
    limits = elevation_limits(terrain)
    image = draw_terrain(axes, terrain, limits, exaggeration=relief_exaggeration(terrain))
    handles: list[Artist] = [*draw_contours(axes, terrain)]
    if area is not None:
        handles += draw_area(axes, area)
    if route is not None:
        handles += draw_route(axes, route)
    add_colour_bar(image, drawing, "Elevation [m]")
    draw_scale_and_north(drawing, crs=terrain.crs)
    axes.set_title("Survey map")
    columns = len(handles) if len(handles) <= 6 else math.ceil(len(handles) / 2)
    drawing.figure.legend(handles=handles, loc="lower center", ncols=columns, columnspacing=1.6)
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
    reconstruction : Reconstruction
        The survey's map.
    prior : Dem, optional
        Prior, e.g. from a satellite.
    area : SurveyArea, optional
        Its outline is drawn and sets what is shown.

    Returns
    -------
    matplotlib.figure.Figure
        As wide as a page; one axes per surface, one colour bar.

    Examples
    --------
    >>> from survey.data.grid import Grid
    >>> grid = Grid((0.0, 0.0, 60.0, 40.0), 2.0)
    >>> flat, raised = (Dem.on(grid, np.full(grid.shape, z)) for z in (5.0, 5.25))
    >>> surveyed = Reconstruction(raised, flat, np.full(grid.shape, 3), "tin", {})
    >>> terrain_comparison(flat, surveyed).axes[0].get_xlabel()
    'Easting [m]'
    """
    bounds = view(reconstruction.mean, area)
    surfaces = {"Reference": reference, "Reconstruction": reconstruction.mean}
    if prior is not None:
        surfaces[f"Prior, {prior.step_m:g} m cells"] = prior
    drawing = map_figure(FULL_IN, bounds, n_maps=len(surfaces))
    shown = [clipped(dem, bounds) for dem in surfaces.values()]
    limits = elevation_limits(*shown)
    exaggeration = relief_exaggeration(reconstruction.mean)
    for axes, name, dem in zip(drawing.maps, surfaces, shown, strict=True):
        image = draw_terrain(axes, dem, limits, exaggeration=exaggeration)
        if area is not None:
            draw_area(axes, area)
        axes.set_title(name)
    add_colour_bar(image, drawing, "Elevation [m]")
    return drawing.figure


@styled
def deviation_map(
    reconstruction: Reconstruction, *, area: SurveyArea | None = None, route: Route | None = None
) -> Figure:
    """Draw the standard deviation of a reconstruction.

    Parameters
    ----------
    reconstruction : Reconstruction
        The survey's map.
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
    >>> deviation_map(surveyed).axes[0].get_xlabel()
    'Easting [m]'
    """
    std = reconstruction.std
    drawing = map_figure(HALF_IN, view(std, area))
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
    axes.set_title("Claimed uncertainty (1 σ)")
    return drawing.figure


@styled
def support_map(
    reconstruction: Reconstruction, *, area: SurveyArea | None = None, route: Route | None = None
) -> Figure:
    """Draw the support of each node: measured, bounded by a line of sight, interpolated, unseen.

    Parameters
    ----------
    reconstruction : Reconstruction
        The survey's map.
    area : SurveyArea, optional
        Its outline is drawn; the shares in the legend then count nodes inside it.
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
    >>> support_map(surveyed).axes[0].get_xlabel()
    'Easting [m]'
    """
    dem = reconstruction.mean
    drawing = map_figure(HALF_IN, view(dem, area))
    axes = drawing.maps[0]
    codes = np.array(reconstruction.support, dtype=np.float64)
    colours = ListedColormap([colour for _, colour in SUPPORT.values()])
    image = draw_raster(axes, codes, dem, colours, BoundaryNorm([-0.5, 0.5, 1.5, 2.5, 3.5], 4))
    draw_outline_and_route(axes, area, route)
    counted = codes.ravel() if area is None else codes.ravel()[area.contains(dem.xy)]
    add_colour_bar(image, drawing, "")
    shares = [f"{name}\n{np.mean(counted == code):.0%}" for code, (name, _) in SUPPORT.items()]
    drawing.bar.set_yticks(list(SUPPORT), shares, fontsize=7)
    drawing.bar.tick_params(length=0)
    axes.set_title("Support")
    return drawing.figure


def draw_outline_and_route(axes: Axes, area: SurveyArea | None, route: Route | None) -> None:
    """Draw the outline of the area and the route as thin lines."""
    if area is not None:
        draw_area(axes, area, veil=False)
    if route is not None:
        draw_route_lines(axes, route)


def clipped(dem: Dem, bounds: tuple[float, float, float, float]) -> Dem:
    """Return the cells within bounds, so that far ones do not set the colours."""
    xmin, ymin, xmax, ymax = bounds
    margin = dem.step_m
    return dem.window((xmin - margin, ymin - margin, xmax + margin, ymax + margin))
