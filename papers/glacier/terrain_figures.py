"""Figures of the terrain study: maps, their errors, and two coverages."""

import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from PIL import Image

import survey
from sim.world.site import World
from survey.core.arrays import FloatArray
from survey.core.files.writing import replacing
from survey.data.route import Route
from survey.data.surface_points import SurfacePoints
from survey.figures.layout import add_colour_bar, map_figure
from survey.figures.map_layers import (
    draw_area,
    draw_raster,
    draw_terrain,
    elevation_limits,
    relief_exaggeration,
)
from survey.figures.style import ERROR, ESTIMATE, FULL_IN, INK, MUTED, png_bytes, styled, symmetric_limits
from survey.reconstruction import Reconstruction
from survey.scoring import Coverage

SAMPLE_M = 50.0


@dataclass(frozen=True)
class Traverse:
    """Drive over the site and its landmarks."""

    world: World
    route: Route
    points: SurfacePoints


def map_error(result: Reconstruction, done: Traverse) -> FloatArray:
    """Return the error of a map (H, W) [m]."""
    mean = result.mean
    error: FloatArray = mean.elevation - done.world.terrain.at(mean.xy).reshape(mean.shape)
    return error


def convex_hull(points: SurfacePoints) -> shapely.Geometry:
    """Return the convex hull of points."""
    return shapely.convex_hull(shapely.multipoints(points.xy))


@styled
def draw_terrains(maps: dict[str, Reconstruction], done: Traverse) -> Figure:
    """Draw maps with the path and the landmarks' convex hull."""
    area = done.world.area
    drawing = map_figure(FULL_IN, area.bounds, n_maps=len(maps))
    inner = done.world.terrain.window(area.bounds)
    limits, exaggeration = elevation_limits(inner), relief_exaggeration(inner)
    for axes, (name, result) in zip(drawing.maps, maps.items(), strict=True):
        image = draw_terrain(axes, result.mean, limits, exaggeration=exaggeration)
        _draw_traverse(axes, done)
        axes.set_title(name)
    add_colour_bar(image, drawing, "Elevation [m]", extend="both")
    return drawing.figure


@styled
def draw_errors(maps: dict[str, Reconstruction], done: Traverse) -> Figure:
    """Draw the errors of maps."""
    area = done.world.area
    drawing = map_figure(FULL_IN, area.bounds, n_maps=len(maps))
    errors = [map_error(result, done) for result in maps.values()]
    limits = symmetric_limits(errors[-1])
    for axes, name, error in zip(drawing.maps, maps, errors, strict=True):
        image = draw_raster(axes, error, maps[name].mean, ERROR, limits)
        _draw_traverse(axes, done)
        axes.set_title(name)
    add_colour_bar(image, drawing, "Error [m]", extend="both")
    return drawing.figure


def _draw_traverse(axes: Axes, done: Traverse) -> None:
    """Draw the path as a solid line and the landmarks' convex hull as a dashed one, as the paper does."""
    draw_area(axes, done.world.area, veil=False)
    axes.plot(*done.route.path().T, color=INK, linewidth=1.3, zorder=5)
    axes.plot(
        *np.array(convex_hull(done.points).exterior.coords).T,
        color=INK,
        linestyle="--",
        linewidth=0.9,
        zorder=5,
    )


@styled
def draw_coverages(area: survey.SurveyArea, route: Route, coverage: Coverage) -> Figure:
    """Draw a route as the distance driven, and as samples with their distances to the centre."""
    figure = Figure(figsize=(FULL_IN, 4.4), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    xmin, ymin, xmax, ymax = area.bounds
    for axes in (left, right):
        axes.set(xlim=(xmin, xmax), ylim=(ymin, ymax), aspect="equal", xlabel="Easting [m]")
        axes.spines[:].set_visible(True)
    left.plot(*route.path().T, color=ESTIMATE, linewidth=2.0)
    left.set(ylabel="Northing [m]", title=f"Robot-centric: {route.length_m:,.0f} m driven")
    half = 0.5 * SAMPLE_M
    centres = np.arange(xmin + half, xmax, SAMPLE_M), np.arange(ymin + half, ymax, SAMPLE_M)
    possible = np.column_stack([axis.ravel() for axis in np.meshgrid(*centres)])
    right.plot(*possible.T, ".", color=MUTED, markersize=2)
    within = np.clip(route.sample(10.0).xy, [xmin, ymin], [xmax - 1e-6, ymax - 1e-6])
    samples = np.unique(np.floor((within - [xmin, ymin]) / SAMPLE_M), axis=0)
    for corner in samples * SAMPLE_M + [xmin, ymin]:
        right.add_patch(Rectangle(tuple(corner), SAMPLE_M, SAMPLE_M, color=ESTIMATE, alpha=0.35, linewidth=0))
    centre = np.array([0.5 * (xmin + xmax), 0.5 * (ymin + ymax)])
    for corner in samples[::3] * SAMPLE_M + [xmin + half, ymin + half]:
        right.plot(*np.array([centre, corner]).T, color=INK, linewidth=0.4, alpha=0.5)
    right.plot(*centre, "+", color=INK, markersize=9)
    right.set_title(f"Science-centric: SCC {coverage.scc:.1%} of {SAMPLE_M:g} m cells")
    return figure


def write_quantized(path: Path, figure: Figure) -> None:
    """Write a map in 192 colours, which shading does not need more of: a fifth of the bytes."""
    image = Image.open(io.BytesIO(png_bytes(figure))).convert("RGB")
    with replacing(path) as draft:
        image.quantize(192, dither=Image.Dither.NONE).save(draft, "PNG", optimize=True)
