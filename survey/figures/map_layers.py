"""Layers of maps: survey areas and routes, rasters, shaded relief, contours.

The functions draw into given axes, in metres of the CRS. `decimate` takes every n-th cell of a raster that has
more cells than a page has pixels.
"""

import math
from collections.abc import Collection, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from affine import Affine
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import Colormap, LightSource, Normalize
from matplotlib.contour import ContourSet
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path as Outline
from scipy.ndimage import distance_transform_edt, zoom
from shapely import (
    LineString,
    MultiLineString,
    MultiPoint,
    MultiPolygon,
    Polygon,
    get_coordinates,
    get_parts,
    intersection,
)

from survey.core import FloatArray, round_number
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.route import Leg, Route
from survey.figures.style import DEVIATION, ELEVATION, INK, MUTED, NO_GO, ROVERS

_HALO = [patheffects.withStroke(linewidth=2.0, foreground="white")]


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


def draw_left_out(axes: Axes, pieces: Sequence[Polygon]) -> list[Patch]:
    """Draw pieces of the area where rovers cannot be, dotted; return legend entries."""
    look: dict[str, Any] = {"facecolor": "#ffffff80", "edgecolor": MUTED, "linewidth": 0.6, "hatch": "...."}
    for piece in pieces:
        axes.add_patch(PathPatch(outline_path(piece), zorder=3.8, **look))
    return [Patch(label="Not drivable", **look)] if pieces else []


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
    width = min(0.7, _line_width_pt(axes, route))
    for leg in route.swaths:
        axes.plot(*leg.xy.T, color="#000000", linewidth=width, alpha=0.55, zorder=3.5)


_COVERED_SHARE = 0.15


def _line_width_pt(axes: Axes, route: Route) -> float:
    """Return the width at which the swaths cover 15 % of the area that they span; what lies below stays visible."""
    width_in = axes.bbox.width / axes.figure.dpi
    points_per_m = 72.0 * width_in / float(np.ptp(axes.get_xlim()))
    hull = MultiPoint(np.vstack([leg.xy for leg in route.swaths])).convex_hull
    length_m = sum(float(np.hypot(*np.diff(leg.xy, axis=0).T).sum()) for leg in route.swaths)
    # A single line spans no area; it is as wide as the widest.
    spacing_m = hull.area / max(length_m, 1e-9) or math.inf
    return max(_COVERED_SHARE * spacing_m * points_per_m, 0.1)


_WIDEST_PT = 2.0


def draw_route(axes: Axes, route: Route) -> list[Line2D]:
    """Draw swaths with numbers and arrows, transits dashed, one colour for each rover; return legend entries."""
    handles = []
    width = min(_WIDEST_PT, _line_width_pt(axes, route))
    for rover in range(route.n_rovers):
        colour = ROVERS[rover % len(ROVERS)]
        for leg in route.legs:
            if leg.rover == rover:
                _draw_leg(axes, leg, colour, width)
        swaths = [leg for leg in route.swaths if leg.rover == rover]
        _number_swaths(axes, swaths, colour)
        _mark_ends(axes, route.path(rover), colour, f"R{rover + 1}" if route.n_rovers > 1 else "")
        name = "Swaths" if route.n_rovers == 1 else f"Rover {rover + 1}, swaths"
        is_cut = route.n_rovers == 1 and route.n_lines < len(swaths)
        count = f"{route.n_lines} lines in {len(swaths)} pieces" if is_cut else f"{len(swaths)}"
        handles.append(Line2D([], [], color=colour, linewidth=2.0, label=f"{name} ({count})"))
    colour = ROVERS[0] if route.n_rovers == 1 else MUTED
    if any(leg.kind == "transit" for leg in route.legs):
        handles.append(Line2D([], [], color=colour, linewidth=1.3, linestyle=(0, (3, 2)), label="Transit"))
    look: dict[str, Any] = {"color": colour, "markeredgecolor": "white", "markersize": 7, "linestyle": "none"}
    ends = [
        Line2D([], [], marker=marker, label=label, **look) for marker, label in (("^", "Start"), ("s", "End"))
    ]
    return [*handles, *ends]


def _draw_leg(axes: Axes, leg: Leg, colour: str, width_pt: float) -> None:
    casing = [patheffects.withStroke(linewidth=1.6 * width_pt, foreground="white")]
    look: dict[str, Any] = {"color": colour, "path_effects": casing}
    if leg.kind == "transit":
        axes.plot(*leg.xy.T, linewidth=0.65 * width_pt, linestyle=(0, (3, 2)), zorder=5, **look)
        return
    axes.plot(*leg.xy.T, linewidth=width_pt, zorder=5.2, **look)


def _draw_arrow(axes: Axes, leg: Leg, colour: str) -> None:
    """Draw the direction in the middle of a swath."""
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

    >>> along(np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0]]), 0.75)
    array([4., 2.])
    """
    distance = np.r_[0.0, np.cumsum(np.hypot(*np.diff(xy, axis=0).T))]
    wanted = np.asarray(shares) * distance[-1]
    return np.stack([np.interp(wanted, distance, xy[:, axis]) for axis in (0, 1)], axis=-1)


def _number_swaths(axes: Axes, swaths: list[Leg], colour: str) -> None:
    """Write the swaths' numbers in driving order with arrows, at most a dozen of them."""
    every = math.ceil(len(swaths) / 12)
    box = {"boxstyle": "circle,pad=0.22", "facecolor": "white", "edgecolor": colour, "linewidth": 1.0}
    for number, leg in enumerate(swaths, start=1):
        if (number - 1) % every == 0:
            _draw_arrow(axes, leg, colour)
            place = along(leg.xy, 0.2)
            axes.text(
                place[0], place[1], str(number), ha="center", va="center", fontsize=8, bbox=box, zorder=6
            )


def _mark_ends(axes: Axes, path: FloatArray, colour: str, name: str) -> None:
    """Mark start and end of a path; the name at the start distinguishes rovers without colour."""
    axes.annotate(
        name,
        (path[0, 0], path[0, 1]),
        xytext=(5.0, 5.0),
        textcoords="offset points",
        fontweight="bold",
        path_effects=_HALO,
        zorder=7,
    )
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


_MOST_CELLS = 1500
# A mesh of so many cells takes less time than an image of them, which is resampled in floating point, and tens of MB less.
_MOST_IN_MESH = 400_000
# Cells of a smooth surface are divided into so many along each side at most.
_FINEST = 5
Raster = AxesImage | QuadMesh
"""A raster that was drawn."""
_MOST_CONTOURS = 120


def decimate(dem: Dem) -> Dem:
    """Return every n-th cell, so that a page's worth of pixels remains."""
    n = math.ceil(max(dem.shape) / _MOST_CELLS)
    if n == 1:
        return dem
    # The kept cells' centres stay in place: the corner moves back by half of what the cell has grown.
    step, shift = dem.step_m, 0.5 * (n - 1) * dem.step_m
    transform = Affine(n * step, 0.0, dem.transform.c - shift, 0.0, -n * step, dem.transform.f + shift)
    return Dem(dem.elevation[::n, ::n], transform, dem.crs, dem.vertical_datum)


def draw_raster(axes: Axes, values: FloatArray, dem: Dem, colours: Colormap, limits: Normalize) -> Raster:
    """Draw one value for each cell of `dem`."""
    return draw_cells(axes, values, dem, cmap=colours, norm=limits, zorder=1)


def draw_smooth(axes: Axes, std: Dem, ground: Polygon | MultiPolygon) -> Raster:
    """Draw values at cell centres as a smooth surface, cut to the outline of the ground."""
    unknown = ~np.isfinite(std.elevation)
    nearest = distance_transform_edt(unknown, return_distances=False, return_indices=True)
    top = max(float(np.nanmax(std.elevation)), 1e-9)
    smooth = _refined(std.elevation[tuple(nearest)])
    image = draw_raster(axes, smooth, std, DEVIATION, Normalize(0.0, top))
    image.set_clip_path(PathPatch(outline_path(ground), transform=axes.transData))
    return image


def draw_cells(axes: Axes, values: npt.NDArray[Any], dem: Dem, **style: Any) -> Raster:
    """Draw values (H, W) by a colour map, or colours (H, W, 4), on the ground of `dem`; the axes keep their limits."""
    xmin, ymin, xmax, ymax = dem.bounds
    bounds = axes.get_xlim(), axes.get_ylim()
    rows, columns = values.shape[:2]
    image: Raster
    if rows * columns > _MOST_IN_MESH:
        image = axes.imshow(values, extent=(xmin, xmax, ymin, ymax), **style)
    else:
        x, y = np.linspace(xmin, xmax, columns + 1), np.linspace(ymax, ymin, rows + 1)
        image = axes.pcolormesh(x, y, values, rasterized=True, **style)
    axes.set(xlim=bounds[0], ylim=bounds[1])
    return image


def _refined(values: FloatArray) -> FloatArray:
    """Return the values of cells on finer ones by cubic splines, where few cells would show as squares."""
    times = min(int(np.sqrt(_MOST_IN_MESH / values.size)), _FINEST)
    if times < 2:
        return values
    refined = zoom(values, times, order=3, mode="nearest", grid_mode=True)
    return np.clip(refined, values.min(), values.max())


def draw_shaded_elevation(axes: Axes, dem: Dem, limits: Normalize, *, exaggeration: float) -> Raster:
    """Draw elevation in colours under a hillshade."""
    dem = decimate(dem)
    image = draw_raster(axes, dem.elevation, dem, ELEVATION, limits)
    draw_relief(axes, dem, exaggeration=exaggeration)
    return image


def draw_relief(axes: Axes, dem: Dem, *, exaggeration: float) -> None:
    """Draw the hillshade alone, to lie over colours."""
    dem = decimate(dem)
    draw_cells(axes, _shade(dem, exaggeration), dem, zorder=1.5)


def relief_exaggeration(dem: Dem) -> float:
    """Return the factor that makes gentle terrain's shading readable: steep ground stays as it is."""
    slopes = np.hypot(*decimate(dem).gradient())
    if not np.isfinite(slopes).any():
        return 1.0
    steepness = float(np.nanpercentile(slopes, 90.0))
    return float(np.clip(math.tan(math.radians(30.0)) / max(steepness, 1e-6), 1.0, 10.0))


def _shade(dem: Dem, exaggeration: float) -> npt.NDArray[np.uint8]:
    """Return black shadows and white highlights (H, W, 4), light from the north-west."""
    unknown = ~np.isfinite(dem.elevation)
    nearest = distance_transform_edt(unknown, return_distances=False, return_indices=True)
    filled = dem.elevation[tuple(nearest)]
    light = LightSource(azdeg=315.0, altdeg=45.0)
    shade = light.hillshade(filled, vert_exag=exaggeration, dx=dem.step_m, dy=dem.step_m)
    flat = math.sin(math.radians(45.0))
    shade = _refined(shade)
    strength = np.where(shade > flat, (shade - flat) / (1.0 - flat) * 0.40, (flat - shade) / flat * 0.50)
    unknown = np.kron(unknown, np.ones(np.array(shade.shape) // dem.shape, dtype=bool))
    overlay = np.zeros((*shade.shape, 4), dtype=np.uint8)
    overlay[..., :3] = np.where(shade > flat, 255, 0)[..., None]
    overlay[..., 3] = np.rint(255.0 * np.where(unknown, 0.0, np.clip(strength, 0.0, 0.6)))
    return overlay


def _relief_m(dem: Dem, within: SurveyArea | None) -> float:
    """Return highest minus lowest cell of a DEM, or of its part in an area where that part is not much flatter [m]."""
    if within is None:
        return dem.relief_m
    heights = dem.elevation[within.contains(dem.xy).reshape(dem.shape) & np.isfinite(dem.elevation)]
    least = dem.relief_m * 8.0 / _MOST_CONTOURS
    return max(float(np.ptp(heights)), least) if len(heights) else dem.relief_m


def elevation_limits(*dems: Dem) -> Normalize:
    """Return one pair of colour limits for all the given DEMs."""
    low = min(float(np.nanmin(dem.elevation)) for dem in dems)
    high = max(float(np.nanmax(dem.elevation)) for dem in dems)
    return Normalize(low, max(high, low + 1e-6))


def draw_contours(axes: Axes, dem: Dem, *, within: SurveyArea | None = None) -> list[Line2D]:
    """Draw about a dozen contours, every fifth one strong and labelled; return legend entries.

    With `within` the dozen is that of the area, where the labels stand; steep ground beside it has up to
    `_MOST_CONTOURS`.
    """
    dem = decimate(dem)
    if dem.relief_m < 1e-6:
        return []
    interval = round_number(_relief_m(dem, within) / 8.0)
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
    places = {} if within is None else _label_places(lines, within, strong.tolist())
    strong = list(places) or strong
    labels = axes.clabel(
        lines,
        levels=strong,
        fontsize=8,
        fmt=lambda level: f"{level:.{decimals}f}",
        manual=list(places.values()) if places else False,
    )
    for label in labels:
        label.set(path_effects=_HALO, alpha=1.0)
    return [Line2D([], [], color=INK, linewidth=0.6, alpha=0.7, label=f"Contours, {interval:g} m")]


_MOST_LABELS = 6


def _label_places(
    lines: ContourSet, area: SurveyArea, strong: Collection[float]
) -> dict[float, tuple[float, float]]:
    """Return places in the area for labels of the strong levels, or else of a few: the middle of a contour's longest run."""
    found: dict[float, tuple[float, float]] = {}
    for level, path in zip(lines.levels, lines.get_paths(), strict=True):
        parts = [np.asarray(part, float) for part in path.to_polygons(closed_only=False)]
        contour = [LineString(part) for part in parts if len(part) > 1]
        inside = get_parts(intersection(MultiLineString(contour), area.polygon))
        longest = max(inside, key=lambda piece: piece.length, default=None)
        if longest is not None and longest.length > 0.0:
            middle = longest.interpolate(0.5, normalized=True)
            found[float(level)] = middle.x, middle.y
    chosen = {level: place for level, place in found.items() if level in strong}
    every = max(math.ceil(len(found) / _MOST_LABELS), 1)
    return chosen or dict(list(found.items())[every // 2 :: every])


_MOST_SIGNS = 24
_MARKED_SHARE = 0.25


def mark_signs(axes: Axes, values: FloatArray, dem: Dem, limits: Normalize) -> None:
    """Write + and − where blocks of signed values are clearly off zero: in grey, both ends of the colours look alike."""
    n = math.ceil(max(dem.shape) / _MOST_SIGNS)
    rows, columns = (size // n * n for size in dem.shape)
    blocks = values[:rows, :columns].reshape(rows // n, n, columns // n, n)
    x = dem.x[:columns].reshape(-1, n).mean(axis=1)
    y = dem.y[:rows].reshape(-1, n).mean(axis=1)
    mean = np.where(np.isfinite(blocks), blocks, 0.0).mean(axis=(1, 3))
    for sign, marker in ((1.0, "+"), (-1.0, "_")):
        row, column = np.nonzero(sign * mean > _MARKED_SHARE * float(limits.vmax or 0.0))
        if len(row):
            look: dict[str, Any] = {"markersize": 3.0, "markeredgewidth": 0.5, "alpha": 0.7, "zorder": 1.4}
            axes.plot(x[column], y[row], marker, color=INK, **look)
