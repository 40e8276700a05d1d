"""Terrain on maps: rasters, shaded relief, contours."""

import math

import numpy as np
from affine import Affine
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, LightSource, Normalize
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch
from scipy.ndimage import distance_transform_edt
from shapely import MultiPolygon, Polygon

from survey.core.arrays import FloatArray
from survey.core.quantity_text import round_number
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.figures.cartography.routes import outline_path
from survey.figures.style import DEVIATION, ELEVATION, INK

_MOST_CELLS = 1500
_MOST_CONTOURS = 120


def thinned(dem: Dem) -> Dem:
    """Return every n-th cell, so that a page's worth of pixels remains."""
    n = math.ceil(max(dem.shape) / _MOST_CELLS)
    if n == 1:
        return dem
    # The kept cells' centres stay in place: the corner moves back by half of what the cell has grown.
    step, shift = dem.step_m, 0.5 * (n - 1) * dem.step_m
    transform = Affine(n * step, 0.0, dem.transform.c - shift, 0.0, -n * step, dem.transform.f + shift)
    return Dem(dem.elevation[::n, ::n], transform, dem.crs, dem.vertical_datum)


def draw_raster(axes: Axes, values: FloatArray, dem: Dem, colours: Colormap, limits: Normalize) -> AxesImage:
    """Draw one value for each cell of `dem`."""
    xmin, ymin, xmax, ymax = dem.bounds
    bounds = axes.get_xlim(), axes.get_ylim()
    image = axes.imshow(values, cmap=colours, norm=limits, extent=(xmin, xmax, ymin, ymax), zorder=1)
    axes.set(xlim=bounds[0], ylim=bounds[1])
    return image


def draw_smooth(axes: Axes, std: Dem, ground: Polygon | MultiPolygon) -> AxesImage:
    """Draw values at cell centres as a smooth surface, cut to the outline of the ground."""
    unknown = ~np.isfinite(std.elevation)
    nearest = distance_transform_edt(unknown, return_distances=False, return_indices=True)
    top = max(float(np.nanmax(std.elevation)), 1e-9)
    image = draw_raster(axes, std.elevation[tuple(nearest)], std, DEVIATION, Normalize(0.0, top))
    image.set_interpolation("bicubic")
    image.set_clip_path(PathPatch(outline_path(ground), transform=axes.transData))
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
    slopes = np.hypot(*thinned(dem).gradient())
    if not np.isfinite(slopes).any():
        return 1.0
    steepness = float(np.nanpercentile(slopes, 90.0))
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

    With `within` the dozen is that of the area; steep ground beside it has up to `_MOST_CONTOURS`.
    """
    dem = thinned(dem)
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
    labels = axes.clabel(lines, levels=strong, fontsize=7, fmt=lambda level: f"{level:.{decimals}f}")
    for label in labels:
        label.set_path_effects([patheffects.withStroke(linewidth=2.0, foreground="white")])
    return [Line2D([], [], color=INK, linewidth=0.6, alpha=0.7, label=f"Contours, {interval:g} m")]
