"""Figures of a drive: planned, driven and estimated path, and the distance between them."""

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from survey.core.arrays import FloatArray
from survey.data.area import SurveyArea
from survey.data.route import Route
from survey.figures.cartography.layout import map_figure, widened
from survey.figures.cartography.routes import draw_area
from survey.figures.cartography.scale_bar import draw_scale_and_north
from survey.figures.style import CLAIM, ESTIMATE, FULL_IN, INK, MUTED, styled


@styled
def executed_route(
    route: Route, driven: FloatArray, estimated: FloatArray | None = None, *, area: SurveyArea | None = None
) -> Figure:
    """Draw the driven path over the planned one.

    Parameters
    ----------
    route : Route
        The plan, of one rover.
    driven : (N, 2+) ndarray
        Where the rover went: easting, northing [m].
    estimated : (M, 2+) ndarray, optional
        Its position as estimated while driving [m].
    area : SurveyArea, optional
        Its outline.

    Returns
    -------
    matplotlib.figure.Figure
        As wide as a page.

    Examples
    --------
    >>> from survey.data.route import Leg
    >>> plan = Route((Leg("swath", np.array([[0.0, 0.0], [50.0, 0.0]])),), "EPSG:32608", "by hand")
    >>> executed_route(plan, np.array([[0.0, 0.1], [50.0, 1.0]])).axes[0].get_xlabel()
    'Easting [m]'
    """
    planned = route.path()
    lines = [line[:, :2] for line in (planned, driven, estimated) if line is not None]
    if area is not None:
        lines.append(np.reshape(area.bounds, (2, 2)))
    low, high = np.vstack(lines).min(axis=0), np.vstack(lines).max(axis=0)
    margin = 0.05 * max(float((high - low).max()), 1.0)
    (west, south), (east, north) = (low - margin).tolist(), (high + margin).tolist()
    drawing = map_figure(FULL_IN, widened((west, south, east, north)), legend=True)
    drawing.bar.set_visible(False)
    axes = drawing.maps[0]
    handles: list[Line2D] = []
    if area is not None:
        draw_area(axes, area, veil=False)
    handles += axes.plot(*planned.T, color=MUTED, linewidth=4.0, alpha=0.45, label="Planned")
    handles += _draw_both(axes, driven[:, :2], None if estimated is None else estimated[:, :2])
    handles += axes.plot(*driven[0, :2], "o", color=INK, markersize=5, label="Start")
    draw_scale_and_north(drawing, crs=route.crs)
    axes.set_title("Driven against planned path")
    drawing.figure.legend(handles=handles, loc="lower center", ncols=len(handles), columnspacing=1.6)
    return drawing.figure


@styled
def deviation_from_route(route: Route, driven: FloatArray, estimated: FloatArray | None = None) -> Figure:
    """Draw the true and the estimated distance from the route against the share of the drive.

    Parameters
    ----------
    route : Route
        The plan, of one rover.
    driven, estimated : (N, 2+) and (M, 2+) ndarray
        As for `executed_route`.

    Returns
    -------
    matplotlib.figure.Figure
        As wide as a page.

    Examples
    --------
    >>> from survey.data.route import Leg
    >>> plan = Route((Leg("swath", np.array([[0.0, 0.0], [50.0, 0.0]])),), "EPSG:32608", "by hand")
    >>> deviation_from_route(plan, np.array([[0.0, 0.1], [50.0, 1.0]])).axes[0].get_ylabel()
    'Distance from route [m]'
    """
    figure = Figure(figsize=(FULL_IN, 2.4), layout="constrained")
    axes = figure.subplots()
    travelled_off = _travelled_and_off(route, driven)
    _draw_both(axes, travelled_off, None if estimated is None else _travelled_and_off(route, estimated))
    travelled, off = travelled_off.T
    worst = float(np.percentile(off, 95.0))
    axes.set_title(
        f"Distance from the planned path: mean {off.mean():.2f} m, 95 % within {worst:.2f} m, most {off.max():.2f} m"
    )
    axes.set(xlabel="Distance driven [m]", ylabel="Distance from route [m]")
    axes.set_xlim(0.0, max(float(travelled[-1]), 1e-3))
    axes.set_ylim(bottom=0.0)
    axes.grid(visible=True, axis="y")
    axes.legend(loc="upper left", ncols=2)
    return figure


def _draw_both(axes: Axes, driven: FloatArray, estimated: FloatArray | None) -> list[Line2D]:
    """Draw the driven line over the estimated one (N, 2); return the handles of the legend."""
    drawn: list[Line2D] = []
    if estimated is not None:
        drawn += axes.plot(*estimated.T, color=CLAIM, linewidth=0.9, label="Estimated on board")
    return drawn + axes.plot(*driven.T, color=ESTIMATE, linewidth=1.4, label="Driven")


def _travelled_and_off(route: Route, path: FloatArray) -> FloatArray:
    """Return (N, 2): how far the rover had driven, and how far from its route it was then [m]."""
    travelled = np.r_[0.0, np.cumsum(np.hypot(*np.diff(path[:, :2], axis=0).T))]
    off = shapely.distance(shapely.LineString(route.path()), shapely.points(path[:, :2]))
    return np.column_stack([travelled, off])
