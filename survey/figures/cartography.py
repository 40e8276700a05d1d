"""What a map is drawn with: relief, contours, outlines, routes, scale bar and north arrow."""

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from affine import Affine
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Colormap, LightSource, Normalize
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch, Rectangle
from matplotlib.path import Path as Outline
from matplotlib.ticker import FuncFormatter, MaxNLocator
from pyproj import CRS
from scipy.ndimage import distance_transform_edt
from shapely import MultiPolygon, Polygon, get_coordinates, get_parts

from survey.core.arrays import Bounds, FloatArray
from survey.core.map_scale import MapScale
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.legs import Leg
from survey.data.route import Route
from survey.figures.style import ELEVATION, INK, MUTED, NO_GO, ROVERS, VEIL, round_number

_MOST_CELLS = 1500
_TALLEST_MAP_IN = 6.2
_CASING = [patheffects.withStroke(linewidth=3.2, foreground="white")]


class MapFigure(NamedTuple):
    """A figure with its maps, left to right, and the place of their colour bar."""

    figure: Figure
    maps: list[Axes]
    bar: Axes


def view(dem: Dem, area: SurveyArea | None) -> Bounds:
    """Return what a map shows: the area with a margin of 4 %, as far as the DEM reaches.

    Strips are shown with ground on both sides, so that title, scale and colour bar have room.
    """
    west, south, east, north = dem.bounds
    if area is None:
        return widened((west, south, east, north))
    xmin, ymin, xmax, ymax = area.bounds
    margin = 0.04 * max(xmax - xmin, ymax - ymin)
    shown = (
        max(xmin - margin, west),
        max(ymin - margin, south),
        min(xmax + margin, east),
        min(ymax + margin, north),
    )
    return widened(shown if shown[0] < shown[2] and shown[1] < shown[3] else dem.bounds)


def widened(bounds: Bounds) -> Bounds:
    """Grow the shorter side to half of the width or to 1 / 2.2 of the height."""
    xmin, ymin, xmax, ymax = bounds
    width, height = xmax - xmin, ymax - ymin
    x, y = 0.5 * max(height / 2.2 - width, 0.0), 0.5 * max(0.5 * width - height, 0.0)
    return xmin - x, ymin - y, xmax + x, ymax + y


def map_figure(width_in: float, bounds: Bounds, *, n_maps: int = 1, legend: bool = False) -> MapFigure:
    """Return empty maps side by side with room for a colour bar, so that figures of one width line up.

    Sizes are set by hand [in]: an automatic layout would place every map a little differently.
    """
    left, right, gap, top = 0.92, 0.94, 0.14, 0.46
    bottom = 0.95 if legend else 0.52
    xmin, ymin, xmax, ymax = bounds
    aspect = (ymax - ymin) / (xmax - xmin)
    room = width_in - left - right
    map_width = min((room - gap * (n_maps - 1)) / n_maps, _TALLEST_MAP_IN / aspect)
    map_height = map_width * aspect
    # A map that is too tall for the page's width stands in its middle.
    left += 0.5 * (room - n_maps * map_width - (n_maps - 1) * gap)
    height_in = bottom + map_height + top
    figure = Figure(figsize=(width_in, height_in))

    def add(start: float, width: float) -> Axes:
        return figure.add_axes(
            (start / width_in, bottom / height_in, width / width_in, map_height / height_in)
        )

    maps = [add(left + index * (map_width + gap), map_width) for index in range(n_maps)]
    bar = add(left + n_maps * (map_width + gap) - gap + 0.1, 0.11)
    for index, axes in enumerate(maps):
        _set_up_map(axes, bounds, first=index == 0, crowded=n_maps > 1)
    return MapFigure(figure, maps, bar)


def thinned(dem: Dem) -> Dem:
    """Return every n-th cell, so that a page's worth of pixels remains."""
    n = math.ceil(max(dem.shape) / _MOST_CELLS)
    if n == 1:
        return dem
    # The kept cells' centres stay in place: the corner moves back by half of what the cell has grown.
    step, shift = dem.step_m, 0.5 * (n - 1) * dem.step_m
    transform = Affine(n * step, 0.0, dem.transform.c - shift, 0.0, -n * step, dem.transform.f + shift)
    return Dem(dem.elevation[::n, ::n], transform, dem.crs, dem.vertical_datum)


def _set_up_map(axes: Axes, bounds: Bounds, *, first: bool, crowded: bool) -> None:
    """Give the axes a map's limits, true proportions, and easting and northing in metres."""
    xmin, ymin, xmax, ymax = bounds
    axes.set(xlim=(xmin, xmax), ylim=(ymin, ymax), aspect="equal", facecolor=VEIL, xlabel="Easting [m]")
    axes.spines[:].set_visible(True)
    decimals = 0 if max(xmax - xmin, ymax - ymin) >= 20.0 else 1
    # Where maps stand close together, labels at their edges would run into each other.
    edge = 0.1 * (xmax - xmin) if crowded else 0.0

    def easting(value: float, _: int | None) -> str:
        return grouped(value, decimals) if xmin + edge <= value <= xmax - edge else ""

    axes.xaxis.set_major_formatter(FuncFormatter(easting))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: grouped(value, decimals)))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(nbins=4, steps=[1, 2, 5, 10]))
    axes.tick_params(axis="y", labelleft=first)
    if first:
        axes.set_ylabel("Northing [m]")


def grouped(value: float, decimals: int = 0) -> str:
    """Write a number with thin spaces between thousands.

    Examples
    --------
    >>> grouped(6712400.0).split()
    ['6', '712', '400']
    """
    return f"{value:,.{decimals}f}".replace(",", "\u2009").replace("-", "\u2212")


def draw_raster(axes: Axes, values: FloatArray, dem: Dem, colours: Colormap, limits: Normalize) -> AxesImage:
    """Draw one value for each cell of `dem`."""
    xmin, ymin, xmax, ymax = dem.bounds
    bounds = axes.get_xlim(), axes.get_ylim()
    image = axes.imshow(values, cmap=colours, norm=limits, extent=(xmin, xmax, ymin, ymax), zorder=1)
    axes.set(xlim=bounds[0], ylim=bounds[1])
    return image


def draw_terrain(axes: Axes, dem: Dem, limits: Normalize, *, exaggeration: float) -> AxesImage:
    """Draw elevation in colours under a hillshade."""
    dem = thinned(dem)
    image = draw_raster(axes, dem.elevation, dem, ELEVATION, limits)
    draw_relief(axes, dem, exaggeration=exaggeration)
    return image


def draw_relief(axes: Axes, dem: Dem, *, exaggeration: float) -> None:
    """Draw the hillshade alone, to lie over colours."""
    dem = thinned(dem)
    xmin, ymin, xmax, ymax = dem.bounds
    axes.imshow(
        _shade(dem, exaggeration), extent=(xmin, xmax, ymin, ymax), interpolation="bilinear", zorder=1.5
    )
    axes.set(xlim=axes.get_xlim(), ylim=axes.get_ylim())


def relief_exaggeration(dem: Dem) -> float:
    """Return the factor that makes gentle terrain's shading readable: steep ground stays as it is."""
    steepness = float(np.nanpercentile(np.hypot(*thinned(dem).gradient()), 90.0))
    return float(np.clip(math.tan(math.radians(30.0)) / max(steepness, 1e-6), 1.0, 10.0))


def _shade(dem: Dem, exaggeration: float) -> FloatArray:
    """Black shadows and white highlights (H, W, 4), light from the north-west."""
    unknown = ~np.isfinite(dem.elevation)
    nearest = distance_transform_edt(unknown, return_distances=False, return_indices=True)
    filled = dem.elevation[tuple(nearest)]
    light = LightSource(azdeg=315.0, altdeg=45.0)
    shade = light.hillshade(filled, vert_exag=exaggeration, dx=dem.step_m, dy=dem.step_m)
    flat = math.sin(math.radians(45.0))
    overlay = np.zeros((*dem.shape, 4))
    overlay[..., :3] = (shade > flat)[..., None]
    strength = np.where(shade > flat, (shade - flat) / (1.0 - flat) * 0.40, (flat - shade) / flat * 0.50)
    overlay[..., 3] = np.where(unknown, 0.0, np.clip(strength, 0.0, 0.6))
    return overlay


def elevation_limits(*dems: Dem) -> Normalize:
    """Return one pair of colour limits for all the given DEMs."""
    low = min(float(np.nanmin(dem.elevation)) for dem in dems)
    high = max(float(np.nanmax(dem.elevation)) for dem in dems)
    return Normalize(low, max(high, low + 1e-6))


def draw_contours(axes: Axes, dem: Dem) -> list[Line2D]:
    """Draw about a dozen contours, every fifth one strong and labelled; return legend entries."""
    dem = thinned(dem)
    if dem.relief_m < 1e-6:
        return []
    interval = round_number(dem.relief_m / 8.0)
    low, high = float(np.nanmin(dem.elevation)), float(np.nanmax(dem.elevation))
    steps = np.arange(math.ceil(low / interval), math.floor(high / interval) + 1)
    if not len(steps):
        return []
    widths = np.where(steps % 5 == 0, 0.9, 0.45)
    lines = axes.contour(
        dem.x,
        dem.y,
        dem.elevation,
        levels=steps * interval,
        colors=INK,
        linewidths=widths,
        alpha=0.55,
        zorder=2,
    )
    decimals = max(0, -math.floor(math.log10(interval)))
    strong = (steps[steps % 5 == 0] if (steps % 5 == 0).any() else steps[[len(steps) // 2]]) * interval
    labels = axes.clabel(lines, levels=strong, fontsize=7, fmt=lambda level: f"{level:.{decimals}f}")
    for label in labels:
        label.set_path_effects([patheffects.withStroke(linewidth=2.0, foreground="white")])
    return [Line2D([], [], color=INK, linewidth=0.6, alpha=0.7, label=f"Contours, {interval:g} m")]


def draw_area(axes: Axes, area: SurveyArea, *, veil: bool = True) -> list[Patch]:
    """Draw the outline, a veil over what lies outside, and no-go ground hatched; return legend entries."""
    axes.add_patch(PathPatch(outline_path(area.polygon), fill=False, edgecolor=INK, linewidth=1.3, zorder=4))
    if veil:
        (xmin, xmax), (ymin, ymax) = axes.get_xlim(), axes.get_ylim()
        outside = Polygon([(xmin, ymin), (xmax, ymin), (xmax, ymax), (xmin, ymax)]).difference(area.polygon)
        if outside.area > 0.0:
            axes.add_patch(
                PathPatch(outline_path(outside), facecolor="white", edgecolor="none", alpha=0.6, zorder=3)
            )
    handles = [Patch(fill=False, edgecolor=INK, linewidth=1.3, label="Survey area")]
    style: dict[str, Any] = {"facecolor": "#ffffff80", "edgecolor": NO_GO, "linewidth": 0.9, "hatch": "////"}
    for zone in area.no_go:
        axes.add_patch(PathPatch(outline_path(zone), zorder=4, **style))
    if area.no_go:
        handles.append(Patch(label="No-go", **style))
    return handles


def outline_path(shape: Polygon | MultiPolygon) -> Outline:
    """Turn polygons with holes into one compound path."""
    rings = [
        Outline(get_coordinates(ring), closed=True)
        for part in get_parts(shape)
        if part.geom_type == "Polygon"
        for ring in (part.exterior, *part.interiors)
    ]
    return Outline.make_compound_path(*rings)


def draw_route_lines(axes: Axes, route: Route) -> None:
    """Draw the swaths as thin neutral lines, for maps that are about something else."""
    for leg in route.swaths:
        axes.plot(*leg.xy.T, color="#000000", linewidth=0.7, alpha=0.55, zorder=3.5)


def draw_route(axes: Axes, route: Route) -> list[Line2D]:
    """Draw swaths with numbers and arrows, transits dashed, one colour for each rover; return legend entries."""
    handles = []
    for rover in range(route.n_rovers):
        colour = ROVERS[rover % len(ROVERS)]
        swaths = [leg for leg in route.swaths if leg.rover == rover]
        for leg in route.legs:
            if leg.rover == rover:
                _draw_leg(axes, leg, colour)
        _number_swaths(axes, swaths, colour)
        _mark_ends(axes, route.path(rover), colour)
        name = "Swaths" if route.n_rovers == 1 else f"Rover {rover + 1}, swaths"
        handles.append(Line2D([], [], color=colour, linewidth=2.0, label=f"{name} ({len(swaths)})"))
    colour = ROVERS[0] if route.n_rovers == 1 else MUTED
    if any(leg.kind == "transit" for leg in route.legs):
        handles.append(Line2D([], [], color=colour, linewidth=1.3, linestyle=(0, (3, 2)), label="Transit"))
    for marker, label in (("^", "Start"), ("s", "End")):
        handles.append(
            Line2D(
                [],
                [],
                color=colour,
                marker=marker,
                markeredgecolor="white",
                markersize=7,
                linestyle="none",
                label=label,
            )
        )
    return handles


def _draw_leg(axes: Axes, leg: Leg, colour: str) -> None:
    if leg.kind == "transit":
        axes.plot(
            *leg.xy.T, color=colour, linewidth=1.3, linestyle=(0, (3, 2)), path_effects=_CASING, zorder=5
        )
        return
    axes.plot(*leg.xy.T, color=colour, linewidth=2.0, path_effects=_CASING, zorder=5.2)
    # The arrow's head follows the straight line over a twentieth of the swath, so that windings do not turn it.
    tail, head = along(leg.xy, 0.48), along(leg.xy, 0.53)
    axes.annotate(
        "",
        xy=(head[0], head[1]),
        xytext=(tail[0], tail[1]),
        arrowprops={
            "arrowstyle": "-|>",
            "color": colour,
            "mutation_scale": 19,
            "linewidth": 0.0,
            "shrinkA": 0.0,
            "shrinkB": 0.0,
        },
        zorder=5.4,
    )


def along(xy: FloatArray, shares: npt.ArrayLike) -> FloatArray:
    """Return the places (..., 2) at shares of the length of a polyline (N, 2).

    Examples
    --------
    >>> along(np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0]]), 0.75)
    array([4., 2.])
    """
    distance = np.r_[0.0, np.cumsum(np.hypot(*np.diff(xy, axis=0).T))]
    wanted = np.asarray(shares) * distance[-1]
    return np.stack([np.interp(wanted, distance, xy[:, axis]) for axis in (0, 1)], axis=-1)


def _number_swaths(axes: Axes, swaths: list[Leg], colour: str) -> None:
    """Write the swaths' numbers in driving order, at most a dozen of them."""
    every = math.ceil(len(swaths) / 12)
    box = {"boxstyle": "circle,pad=0.22", "facecolor": "white", "edgecolor": colour, "linewidth": 1.0}
    for number, leg in enumerate(swaths, start=1):
        if (number - 1) % every == 0:
            place = along(leg.xy, 0.2)
            axes.text(
                place[0], place[1], str(number), ha="center", va="center", fontsize=7.5, bbox=box, zorder=6
            )


def _mark_ends(axes: Axes, path: FloatArray, colour: str) -> None:
    for marker, place in (("^", path[0]), ("s", path[-1])):
        axes.plot(
            place[0],
            place[1],
            marker=marker,
            color=colour,
            markersize=8,
            markeredgecolor="white",
            clip_on=False,
            zorder=7,
        )


def draw_scale_and_north(drawing: MapFigure, *, north: bool = True, crs: CRS | None = None) -> None:
    """Draw a scale bar and, where the map has one, a grid-north arrow above the map, where they cover nothing.

    With `crs` the bar counts on the ground where the scale factor of the CRS differs from 1 by more than 1 %.
    """
    axes = drawing.maps[0]
    xmin, xmax = axes.get_xlim()
    width = xmax - xmin
    factor = 1.0 if crs is None else _scale_factor(axes, crs)
    ground_m = round_number(width / factor / 4.0)
    length = ground_m * factor
    end = xmax - 0.09 * width
    place = axes.get_xaxis_transform()
    inch = 1.0 / (axes.get_position().height * drawing.figure.get_figheight())
    for start, colour in ((end - length, INK), (end - length / 2.0, "white")):
        bar: dict[str, Any] = {
            "facecolor": colour,
            "edgecolor": INK,
            "linewidth": 0.8,
            "clip_on": False,
            "transform": place,
        }
        axes.add_patch(Rectangle((start, 1.0 + 0.10 * inch), length / 2.0, 0.08 * inch, **bar))
    text = f"{grouped(ground_m / 1000.0)} km" if ground_m >= 1000.0 else f"{ground_m:g} m"
    middle = 1.0 + 0.14 * inch
    axes.text(
        end - length - 0.015 * width, middle, text, transform=place, ha="right", va="center", fontsize=8
    )
    if not north:
        return
    axes.text(0.955, middle, "N", transform=axes.transAxes, ha="center", va="center", fontweight="bold")
    arrow = {"arrowstyle": "-|>", "color": INK, "mutation_scale": 12, "shrinkA": 0, "shrinkB": 0}
    axes.annotate(
        "",
        xy=(0.985, 1.0 + 0.34 * inch),
        xytext=(0.985, 1.0 + 0.03 * inch),
        xycoords="axes fraction",
        arrowprops=arrow,
        annotation_clip=False,
    )


def _scale_factor(axes: Axes, crs: CRS) -> float:
    """Return the linear scale factor of a CRS over what a map shows; 1 within 1 %."""
    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    return MapScale.over(crs, (west, south, east, north)).notable_factor


def add_colour_bar(
    mappable: ScalarMappable, drawing: MapFigure, label: str, *, extend: str = "neither"
) -> None:
    """Fill the drawing's place for the colour bar."""
    bar = drawing.figure.colorbar(mappable, cax=drawing.bar, label=label, extend=extend)
    bar.outline.set_visible(False)
