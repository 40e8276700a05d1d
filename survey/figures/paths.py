"""Figures of paths: planned, driven and estimated ones, error ellipses and landmarks, and errors over distance and time.

`path_map`, `error_over_distance` and `error_over_time` compare an estimated path with a reference; `executed_route` and
`deviation_from_route` compare the driven path with the plan.
"""

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from pyproj import CRS

from survey.core import BoolArray, FloatArray, IntArray, round_number, same_crs
from survey.data.area import SurveyArea
from survey.data.route import Route
from survey.data.trajectory import Trajectory
from survey.figures.layout import (
    MapFigure,
    add_colour_bar,
    add_legend,
    grouped,
    label_maps,
    map_figure,
    widen,
)
from survey.figures.map_layers import draw_area
from survey.figures.style import CLAIM, DEVIATION, ESTIMATE, FULL_IN, INK, MUTED, NO_GO, REFERENCE, styled

_AXES = ("East", "North", "Up")
_N_ELLIPSES = 25
_MOST_LANDMARKS = 20_000


@styled
def path_map(
    position: FloatArray,
    covariance: FloatArray | None = None,
    *,
    landmarks: FloatArray | None = None,
    landmark_sigma_m: FloatArray | None = None,
    fixes: FloatArray | None = None,
    reference: FloatArray | None = None,
    is_lost: BoolArray | None = None,
    crs: CRS | None = None,
    in_the_world: bool = True,
) -> Figure:
    """Draw the estimated path with its 1σ ellipses over the landmarks.

    Ellipses that would be too small to see are drawn larger, by a factor that the legend
    states.

    Parameters
    ----------
    position : (N, 3) ndarray
        Estimated path: easting, northing, elevation [m].
    covariance : (N, 3, 3) ndarray, optional
        Of the positions [m²]; about 25 of them are drawn.
    landmarks : (M, 3) ndarray, optional
        Their places [m].
    landmark_sigma_m : (M,) ndarray, optional
        Standard deviation of their elevation [m], their colour.
    fixes : (K, 3) ndarray, optional
        GPS.
    reference : (R, 3) ndarray, optional
        Where the rover was.
    is_lost : (N,) ndarray of bool, optional
        Where the path is not reliable.
    crs : pyproj.CRS, optional
        CRS of the path.
    in_the_world : bool
        False for a path that counts from its own start: the axes say so.

    $page

    Examples
    --------
    >>> path = np.column_stack([np.linspace(0.0, 50.0, 11), np.zeros(11), np.zeros(11)])
    >>> path_map(path, np.tile(0.04 * np.eye(3), (11, 1, 1))).axes[0].get_xlabel()
    'Easting [m]'
    """
    shown = [line[:, :2] for line in (position, fixes, reference) if line is not None]
    drawing = map_figure(FULL_IN, _bounds(np.vstack(shown)))
    axes = drawing.maps[0]
    _draw_landmarks(drawing, landmarks, landmark_sigma_m)
    handles = _draw_lines(axes, position, fixes, reference, is_lost)
    if covariance is not None:
        handles.append(_draw_ellipses(axes, position, covariance))
    handles += axes.plot(*position[0, :2], "o", color=INK, markersize=5, label="Start")
    seen = "" if landmarks is None else f" and {grouped(len(landmarks))} landmarks"
    label_maps(drawing, f"Estimated path{seen}", crs=crs, north=in_the_world)
    if not in_the_world:
        axes.set(xlabel="Forward at the start [m]", ylabel="Left at the start [m]")
    add_legend(drawing, handles)
    return drawing.figure


def _draw_landmarks(drawing: MapFigure, landmarks: FloatArray | None, sigma_m: FloatArray | None) -> None:
    """Draw landmarks in the colour of their σ, thinned to a number that can be seen; without landmarks there is no colour bar."""
    if landmarks is None or not len(landmarks):
        drawing.bar.set_visible(False)
        return
    every = -(-len(landmarks) // _MOST_LANDMARKS)
    sigma = np.full(len(landmarks), 1.0) if sigma_m is None else sigma_m
    limits = Normalize(0.0, max(float(np.percentile(sigma, 98.0)), 1e-6))
    x, y, _ = landmarks[::every].T
    dots = drawing.maps[0].scatter(
        x, y, c=sigma[::every], s=3.0, linewidths=0, cmap=DEVIATION, norm=limits, zorder=1, rasterized=True
    )
    add_colour_bar(dots, drawing, "σ of a landmark's elevation [m]", extend="max")


def _draw_lines(
    axes: Axes,
    position: FloatArray,
    fixes: FloatArray | None,
    reference: FloatArray | None,
    is_lost: BoolArray | None,
) -> list[Line2D]:
    """Draw fixes, reference and path, where it is lost too; return what the legend shows."""
    drawn: list[Line2D] = []
    if fixes is not None:
        drawn += axes.plot(*fixes[:, :2].T, ".", color=CLAIM, markersize=2.5, alpha=0.6, label="GPS fixes")
    if reference is not None:
        x, y = reference[:, :2].T
        drawn += axes.plot(x, y, color=REFERENCE, linewidth=1.0, dashes=(4, 2), label="Reference")
    drawn += axes.plot(*position[:, :2].T, color=ESTIMATE, linewidth=1.3, label="Estimated path")
    if is_lost is not None and is_lost.any():
        where = np.where(is_lost[:, None], position[:, :2], np.nan)
        drawn += axes.plot(*where.T, color=NO_GO, linewidth=4.0, alpha=0.5, label="Lost")
    return drawn


def _bounds(xy: FloatArray) -> tuple[float, float, float, float]:
    """Return the box about places with a margin, wide enough for the title and the scale above it."""
    low, high = xy.min(axis=0), xy.max(axis=0)
    margin = 0.06 * max(float((high - low).max()), 5.0)
    half = 0.5 * (high - low) + margin
    half = np.maximum(half, [0.9 * half[1], 0.5 * half[0]])
    middle = 0.5 * (low + high)
    west, south = (middle - half).tolist()
    east, north = (middle + half).tolist()
    return west, south, east, north


def _draw_ellipses(axes: Axes, position: FloatArray, covariance: FloatArray) -> Line2D:
    """Draw 1σ ellipses at places evenly spread over the travel; return what the legend shows."""
    chosen = _spread(position, _N_ELLIPSES)
    size, axis = np.linalg.eigh(covariance[chosen, :2, :2])
    sigma = np.sqrt(np.maximum(size, 0.0))
    wanted = 0.02 * float(np.ptp(axes.get_xlim()))
    typical = max(float(np.median(sigma[1:, 1])) if len(sigma) > 1 else float(sigma[0, 1]), 1e-9)
    factor = max(1.0, round_number(wanted / typical)) if wanted > typical else 1.0
    angle = np.degrees(np.arctan2(axis[:, 1, 1], axis[:, 0, 1]))
    ellipses = EllipseCollection(
        2.0 * factor * sigma[:, 1],
        2.0 * factor * sigma[:, 0],
        angle,
        units="xy",
        offsets=position[chosen, :2],
        transOffset=axes.transData,
        facecolors="none",
        edgecolors=INK,
        linewidths=0.9,
        zorder=4,
    )
    axes.add_collection(ellipses)
    grown = "" if factor == 1.0 else f", drawn {factor:g} × as large"
    label = f"1σ of the position{grown}"
    return Line2D([], [], color=INK, marker="o", markerfacecolor="none", linewidth=0, label=label)


def _spread(position: FloatArray, n: int) -> IntArray:
    """Return the indices of about `n` places, evenly over the travel."""
    travel = _travelled(position)
    chosen: IntArray = np.unique(np.searchsorted(travel, np.linspace(0.0, travel[-1], n)))
    return chosen.clip(max=len(position) - 1)


def _travelled(position: FloatArray) -> FloatArray:
    travel: FloatArray = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(position, axis=0), axis=1))]
    return travel


@styled
def error_over_distance(
    position: FloatArray,
    reference: FloatArray,
    covariance: FloatArray | None = None,
    is_lost: BoolArray | None = None,
) -> Figure:
    """Draw the error of the position against the distance driven, with the estimated standard deviation.

    `position`, `reference` (N, 3): estimated path and where the rover was at the same times [m]. `covariance`
    (N, 3, 3): of the positions [m²]. `is_lost` (N,) bool: where the estimate said that it is lost; shaded.

    >>> path = np.column_stack([np.linspace(0.0, 50.0, 11), np.zeros(11), np.zeros(11)])
    >>> error_over_distance(path + [0.0, 0.3, -0.1], path).axes[1].get_xlabel()
    'Distance driven [m]'
    """
    travel, error = _travelled(reference), position - reference
    horizontal = np.linalg.norm(error[:, :2], axis=1)
    figure = Figure(figsize=(FULL_IN, 4.2), layout="constrained")
    across, up = figure.subplots(2, 1, sharex=True)
    if covariance is not None:
        radial = np.sqrt(np.trace(covariance[:, :2, :2], axis1=1, axis2=2))
        across.fill_between(travel, 0.0, radial, color=CLAIM, alpha=0.2, linewidth=0, label="Claimed 1σ")
        sigma = np.sqrt(covariance[:, 2, 2])
        for factor, shade in ((2.0, 0.12), (1.0, 0.2)):
            label = f"Claimed ± {factor:.0f}σ"
            up.fill_between(
                travel, -factor * sigma, factor * sigma, color=CLAIM, alpha=shade, linewidth=0, label=label
            )
        inside = float(np.mean(np.abs(error[:, 2]) <= 2.0 * sigma))
        up.set_title(f"{inside:.0%} within ± 2σ", loc="right", fontsize=8, fontweight="normal")
    across.plot(travel, horizontal, color=INK, linewidth=1.1, label="Error")
    up.axhline(0.0, color=MUTED, linewidth=0.7)
    up.plot(travel, error[:, 2], color=INK, linewidth=1.1, label="Error")
    rms = np.sqrt(np.mean(horizontal**2)), np.sqrt(np.mean(error[:, 2] ** 2))
    across.set_title(f"Horizontal error: RMS {rms[0]:.2f} m, at the end {horizontal[-1]:.2f} m")
    up.set_title(f"Vertical error: RMS {rms[1]:.2f} m, at the end {error[-1, 2]:+.2f} m".replace("-", "−"))
    for axes in (across, up):
        if is_lost is not None and is_lost.any():
            axes.fill_between(
                travel, 0, 1, where=is_lost, transform=axes.get_xaxis_transform(), color=NO_GO, alpha=0.15,
                linewidth=0, label="Lost",
            )  # fmt: skip
        axes.set_ylabel("[m]")
        axes.grid(visible=True, axis="y")
        if len(axes.get_legend_handles_labels()[1]) > 1:
            axes.legend(loc="upper left", ncols=3)
    across.set_ylim(bottom=0.0)
    up.set(xlabel="Distance driven [m]", xlim=(0.0, max(float(travel[-1]), 1e-3)))
    return figure


@styled
def error_over_time(estimated: Trajectory, reference: Trajectory) -> Figure:
    """Draw the error of the estimated positions over time, with the claimed ± 2 σ.

    The reference is interpolated linearly at the estimate's times; poses outside its time
    span are left out. Times when the estimate counts itself lost are shaded.

    Parameters
    ----------
    estimated : Trajectory
        With the covariance of each position.
    reference : Trajectory
        Where the rover was.

    Returns
    -------
    matplotlib.figure.Figure
        As wide as a page: east, north and up below each other.

    Raises
    ------
    InputError
        When the two are in different CRS.

    Examples
    --------
    >>> level, spread = np.tile([0.0, 0.0, 0.0, 1.0], (3, 1)), np.tile(np.eye(3), (3, 1, 1))
    >>> driven, estimated = (
    ...     Trajectory(np.arange(3.0), np.full((3, 3), error), level, spread, "EPSG:32608") for error in (0.0, 0.5)
    ... )
    >>> [axes.get_ylabel() for axes in error_over_time(estimated, driven).axes]
    ['East [m]', 'North [m]', 'Up [m]']
    """
    same_crs(estimated.crs, reference.crs, "the trajectory and its reference")
    common = (estimated.time_s >= reference.time_s[0]) & (estimated.time_s <= reference.time_s[-1])
    time = estimated.time_s[common]
    figure = Figure(figsize=(FULL_IN, 4.6), layout="constrained")
    panels = figure.subplots(3, 1, sharex=True)
    unit, seconds = ("min", 60.0) if len(time) and time[-1] > 600.0 else ("s", 1.0)
    for index, (axes, name) in enumerate(zip(panels, _AXES, strict=True)):
        error = estimated.position[common, index] - np.interp(
            time, reference.time_s, reference.position[:, index]
        )
        sigma = np.sqrt(estimated.covariance[common, index, index])
        inside = float(np.mean(np.abs(error) <= 2.0 * sigma)) if len(time) else float("nan")
        axes.fill_between(
            time / seconds, -2 * sigma, 2 * sigma, color=CLAIM, alpha=0.2, linewidth=0, label="Claimed ± 2 σ"
        )
        axes.axhline(0.0, color=MUTED, linewidth=0.7)
        axes.plot(time / seconds, error, color=INK, linewidth=1.0, label="Estimate \u2212 reference")
        _shade_lost(axes, time / seconds, estimated.health[common])
        axes.set_ylabel(f"{name} [m]")
        axes.grid(visible=True, axis="y")
        axes.set_title(f"{inside:.0%} within ± 2 σ", loc="right", fontsize=8, fontweight="normal")
    panels[0].set_title("Error of the position")
    panels[-1].set_xlabel(f"Time [{unit}]")
    if len(time):
        panels[-1].set_xlim(time[0] / seconds, time[-1] / seconds)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def _shade_lost(axes: Axes, time: FloatArray, health: FloatArray) -> None:
    lost = health < 0.5
    if lost.any():
        axes.fill_between(
            time,
            0.0,
            1.0,
            where=lost,
            step="mid",
            transform=axes.get_xaxis_transform(),
            color=ESTIMATE,
            alpha=0.18,
            linewidth=0,
            label="Lost",
        )


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

    $page

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
    drawing = map_figure(FULL_IN, widen((west, south, east, north)))
    drawing.bar.set_visible(False)
    axes = drawing.maps[0]
    handles: list[Line2D] = []
    if area is not None:
        draw_area(axes, area, veil=False)
    handles += axes.plot(*planned.T, color=MUTED, linewidth=4.0, alpha=0.45, label="Planned")
    handles += _draw_both(axes, driven[:, :2], None if estimated is None else estimated[:, :2])
    handles += axes.plot(*driven[0, :2], "o", color=INK, markersize=5, label="Start")
    label_maps(drawing, "Driven against planned path", crs=route.crs)
    add_legend(drawing, handles)
    return drawing.figure


@styled
def deviation_from_route(route: Route, driven: FloatArray, estimated: FloatArray | None = None) -> Figure:
    """Draw the true and the estimated distance from the route against the share of the drive.

    `driven`, `estimated` (N, 2+) and (M, 2+): as for `executed_route`.

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
        drawn += axes.plot(
            *estimated.T, color=CLAIM, linewidth=0.9, dashes=(4, 2), label="Estimated on board"
        )
    return drawn + axes.plot(*driven.T, color=ESTIMATE, linewidth=1.4, label="Driven")


def _travelled_and_off(route: Route, path: FloatArray) -> FloatArray:
    """Return (N, 2): how far the rover had driven, and how far from its route it was then [m]."""
    travelled = np.r_[0.0, np.cumsum(np.hypot(*np.diff(path[:, :2], axis=0).T))]
    off = shapely.distance(shapely.LineString(route.path()), shapely.points(path[:, :2]))
    return np.column_stack([travelled, off])
