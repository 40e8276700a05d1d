"""Figure of a surface that may overhang: its map, and vertical sections with their 95 % bands and returns."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from survey.core import BoolArray, FloatArray
from survey.data.surface_points import SurfacePoints
from survey.figures.style import CLAIM, ELEVATION, ESTIMATE, FULL_IN, INK, NO_GO, VEIL, styled
from survey.reconstruction.terrain_map import SIGMAS_95

if TYPE_CHECKING:
    from survey.reconstruction import FreeSurface  # loads compiled loops
    from survey.reconstruction.lattice.steep_places import SteepSection

_BAND, _LETTERS, _PANEL_IN = "#a6cee3", "ABC", 2.5
# In a plane along a wall the band would be of any width.
_LEAST_IN_PLANE = 0.3
_MOST_PLACES = 64


@styled
def overhang_sections(
    surface: "FreeSurface", sections: "Sequence[SteepSection]", returns: SurfacePoints
) -> Figure:
    """Draw a map of a surface with its overhanging parts, and vertical sections with 95 % bands and the returns beside them.

    Parameters
    ----------
    surface : FreeSurface
        Surface with standard deviations.
    sections : sequence of SteepSection
        Up to three.
    returns : SurfacePoints
        Those within half a step of a section are drawn.

    Returns
    -------
    matplotlib.figure.Figure
        As wide as a page.
    """
    n = len(sections)
    figure = Figure(figsize=(FULL_IN, 0.6 * FULL_IN if n < 2 else n * _PANEL_IN), layout="constrained")
    grid = figure.add_gridspec(max(n, 1), 2 if n else 1)
    axes = figure.add_subplot(grid[:, 0])
    datum = np.floor(surface.nodes[:, :2].min(axis=0))
    _draw_map(axes, surface, datum)
    if returns.origins is not None:
        _draw_places(axes, returns.origins[:, :2] - datum)
    for row, one in enumerate(sections):
        ends = np.stack([one.start, one.end]) - datum
        axes.plot(*ends.T, color=INK, linewidth=1.0, zorder=5)
        axes.annotate(
            _LETTERS[row],
            ends.mean(axis=0),  # the steep place; the ends may lie beyond the map
            fontweight="bold",
            zorder=6,
            xytext=(2, 2),
            textcoords="offset points",
        )
        panel = figure.add_subplot(grid[row, 1])
        _draw_section(panel, one, one.beside(returns.xyz, 0.5 * surface.step_m))
        panel.set_title(f"Section {_LETTERS[row]}, {one.steepness_deg:.0f}° steep")
    if sections:
        figure.axes[-1].set_xlabel("Along the section [m]")
    figure.legend(handles=_legend(), loc="outside lower center", ncols=4)
    return figure


def _draw_map(axes: Axes, surface: "FreeSurface", datum: FloatArray) -> None:
    """Draw all facets in the order of their heights, unsupported ones veiled, and overhanging ones on top."""
    corners = surface.nodes[surface.triangles]
    height = corners[:, :, 2].mean(axis=1)
    order = np.argsort(height, kind="stable")
    plan = corners[:, :, :2] - datum
    supported = surface.is_supported[surface.triangles].all(axis=1)
    facets = PolyCollection(
        list(plan[order]),
        array=height[order],
        cmap=ELEVATION,
        edgecolors="face",
        linewidths=0.2,
        rasterized=True,
    )
    axes.add_collection(facets)
    for which, colour, alpha in ((~supported, VEIL, 0.8), (supported & _overhangs(corners), NO_GO, 0.5)):
        axes.add_collection(
            PolyCollection(list(plan[which]), facecolors=colour, alpha=alpha, linewidths=0.0, rasterized=True)
        )
    axes.autoscale_view()
    axes.set_aspect("equal")
    axes.set(
        xlabel=f"Easting − {datum[0]:.0f} [m]",
        ylabel=f"Northing − {datum[1]:.0f} [m]",
        title="Surface from above",
    )
    axes.figure.colorbar(facets, ax=axes, label="Elevation [m]", location="bottom", shrink=0.8)


def _overhangs(corners: FloatArray) -> BoolArray:
    """Return which triangles (M, 3, 3), counter-clockwise as seen from the scanner, are clockwise from above (M,)."""
    a, b, c = corners[:, 0, :2], corners[:, 1, :2], corners[:, 2, :2]
    u, v = b - a, c - a
    turned: BoolArray = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0] < 0.0
    return turned


def _draw_places(axes: Axes, places: FloatArray) -> None:
    """Draw the places of a scanner that stood still, where the map shows them."""
    places = np.unique(places, axis=0)
    if len(places) > _MOST_PLACES:
        return
    limits = axes.get_xlim(), axes.get_ylim()
    axes.plot(*places.T, "^", color=ESTIMATE, markersize=5.0, zorder=6)
    axes.set(xlim=limits[0], ylim=limits[1])


def _draw_section(axes: Axes, section: "SteepSection", beside: FloatArray) -> None:
    """Draw lines, 95 % band and returns of one section, distances and heights in one scale."""
    lines = section.lines
    ends = np.stack([lines.along_m, lines.z_m], axis=2)
    in_plane = np.linalg.norm(lines.normals, axis=1)
    normals = lines.normals / np.maximum(in_plane, _LEAST_IN_PLANE)[:, None] ** 2
    width = SIGMAS_95 * lines.sigma_m[:, :, None] * normals[:, None, :]
    band = np.concatenate([ends + width, (ends - width)[:, ::-1]], axis=1)
    axes.add_collection(
        PolyCollection(list(band), facecolors=_BAND, edgecolors=_BAND, linewidths=0.4, zorder=1)
    )
    axes.plot(*beside.T, ".", color=INK, markersize=1.4, markeredgewidth=0.0, zorder=2, rasterized=True)
    for which, colour in ((lines.is_supported, CLAIM), (~lines.is_supported, ESTIMATE)):
        axes.add_collection(LineCollection(list(ends[which]), colors=colour, linewidths=1.1, zorder=3))
    axes.autoscale_view()
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(ylabel="Elevation [m]")
    axes.grid(visible=True, color=VEIL)


def _legend() -> list[Line2D | Patch]:
    return [
        Patch(facecolor=NO_GO, alpha=0.5, label="Overhanging"),
        Patch(facecolor=VEIL, label="Unsupported"),
        Line2D([], [], marker="^", linestyle="", color=ESTIMATE, label="Scanner"),
        Line2D([], [], marker=".", linestyle="", color=INK, markersize=3.0, label="Returns"),
        Line2D([], [], color=CLAIM, label="Surface"),
        Line2D([], [], color=ESTIMATE, label="Surface without returns"),
        Patch(facecolor=_BAND, label="95 % interval"),
    ]
