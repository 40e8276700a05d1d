"""Figures of an estimated path: its error ellipses and landmarks, and its error against distance."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from survey.core.arrays import BoolArray, FloatArray, IntArray
from survey.core.quantity_text import round_number
from survey.figures.cartography.layout import (
    MapFigure,
    add_colour_bar,
    grouped,
    map_figure,
)
from survey.figures.cartography.scale_bar import draw_scale_and_north
from survey.figures.style import (
    CLAIM,
    DEVIATION,
    ESTIMATE,
    FULL_IN,
    INK,
    MUTED,
    NO_GO,
    REFERENCE,
    styled,
)

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
    in_the_world : bool
        False for a path that counts from its own start: the axes say so.

    Returns
    -------
    matplotlib.figure.Figure
        As wide as a page.

    Examples
    --------
    >>> path = np.column_stack([np.linspace(0.0, 50.0, 11), np.zeros(11), np.zeros(11)])
    >>> path_map(path, np.tile(0.04 * np.eye(3), (11, 1, 1))).axes[0].get_xlabel()
    'Easting [m]'
    """
    shown = [line[:, :2] for line in (position, fixes, reference) if line is not None]
    drawing = map_figure(FULL_IN, _bounds(np.vstack(shown)), legend=True)
    axes = drawing.maps[0]
    _draw_landmarks(drawing, landmarks, landmark_sigma_m)
    handles = _draw_lines(axes, position, fixes, reference, is_lost)
    if covariance is not None:
        handles.append(_draw_ellipses(axes, position, covariance))
    handles += axes.plot(*position[0, :2], "o", color=INK, markersize=5, label="Start")
    draw_scale_and_north(drawing, north=in_the_world)
    axes.set_title(
        "Estimated path" if landmarks is None else f"Estimated path and {grouped(len(landmarks))} landmarks"
    )
    if not in_the_world:
        axes.set(xlabel="Forward at the start [m]", ylabel="Left at the start [m]")
    drawing.figure.legend(handles=handles, loc="lower center", ncols=len(handles), columnspacing=1.6)
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
        x, y, c=sigma[::every], s=3.0, linewidths=0, cmap=DEVIATION, norm=limits, zorder=1
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

    Parameters
    ----------
    position, reference : (N, 3) ndarray
        Estimated path and where the rover was at the same times [m].
    covariance : (N, 3, 3) ndarray, optional
        Of the positions [m²].
    is_lost : (N,) ndarray of bool, optional
        Where the estimate said that it is lost; shaded.

    Returns
    -------
    matplotlib.figure.Figure
        As wide as a page: the horizontal error with the claimed radial σ, the vertical one
        with its claimed ± 1σ and ± 2σ.

    Examples
    --------
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
