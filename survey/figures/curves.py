"""Curves: terrain profiles along and across the survey, and the trajectory's error over time."""

from typing import Any

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from survey.core.arrays import FloatArray
from survey.core.crs import same_crs
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.route import Leg, Route
from survey.data.trajectory import Trajectory
from survey.figures.map_layers import along
from survey.figures.style import CLAIM, ESTIMATE, FULL_IN, INK, MUTED, PRIOR, REFERENCE, styled
from survey.reconstruction.terrain_map import Reconstruction

_AXES_OF_SPACE = ("East", "North", "Up")


@styled
def terrain_profile(
    reconstruction: Reconstruction,
    reference: Dem,
    route: Route,
    *,
    prior: Dem | None = None,
    area: SurveyArea | None = None,
) -> Figure:
    """Draw the terrain along the middle swath and across it, with the error below.

    Upper row: heights with a band of mean ± 2 σ. Lower row: reconstruction minus reference
    inside ± 2 σ, at a scale where centimetres can be read.

    Parameters
    ----------
    reconstruction : Reconstruction
        The survey's map.
    reference : Dem
        The terrain as it is.
    route : Route
        Its middle swath is followed; the cross profile is the perpendicular through the
        middle of that swath's axis.
    prior : Dem, optional
        What was known before.
    area : SurveyArea, optional
        Profiles end at its outline.

    Returns
    -------
    matplotlib.figure.Figure
        As wide as a page: four axes, heights above errors.

    Examples
    --------
    >>> from survey.data.grid import Grid
    >>> grid = Grid((0.0, 0.0, 60.0, 40.0), 2.0)
    >>> flat, raised = (Dem.on(grid, np.full(grid.shape, z)) for z in (5.0, 5.25))
    >>> surveyed = Reconstruction(raised, flat, np.full(grid.shape, 3), "tin", {})
    >>> from survey.data.route import Leg
    >>> route = Route((Leg("swath", [[0.0, 20.0], [60.0, 20.0]]),), "EPSG:32608", "line")
    >>> len(terrain_profile(surveyed, flat, route).axes)
    4
    """
    same_crs(reconstruction.mean.crs, reference.crs, "the reconstruction and the reference")
    swath = route.swaths[len(route.swaths) // 2]
    lines = {
        f"Along swath {len(route.swaths) // 2 + 1}": swath.xy,
        "Across the swaths": cross_line(swath, reconstruction.mean, area),
    }
    figure = Figure(figsize=(FULL_IN, 4.9), layout="constrained")
    panels = figure.subplots(2, 2, sharex="col", height_ratios=(2, 1))
    for column, (name, line) in enumerate(lines.items()):
        _draw_profile(
            panels[:, column],
            line,
            reconstruction=reconstruction,
            reference=reference,
            prior=prior,
            area=area,
        )
        panels[0, column].set_title(name)
    _mark_crossings(panels[:, 1], lines["Across the swaths"], route)
    figure.legend(*panels[0, 1].get_legend_handles_labels(), loc="outside lower center", ncols=5)
    return figure


def cross_line(swath: Leg, terrain: Dem, area: SurveyArea | None = None) -> FloatArray:
    """Return both ends (2, 2) [m] of the perpendicular through the middle of a swath's axis.

    It runs to the outermost nodes of the terrain or to the outline of the area.

    Examples
    --------
    >>> from survey.data.grid import Grid
    >>> grid = Grid((0.0, 0.0, 40.0, 20.0), 10.0)
    >>> cross_line(Leg("swath", [[0.0, 5.0], [40.0, 5.0]]), Dem.on(grid, np.zeros(grid.shape)))
    array([[20.,  0.],
           [20., 20.]])
    """
    centre = swath.axis.mean(axis=0)
    direction = swath.axis[1] - swath.axis[0]
    normal = np.array([-direction[1], direction[0]]) / max(float(np.hypot(*direction)), 1e-9)
    # West to east, or south to north when the line runs due north.
    normal = normal if (round(normal[0], 9), normal[1]) > (0.0, 0.0) else -normal
    ground = shapely.box(*terrain.grid().bounds)
    reach = float(np.hypot(*np.ptp(shapely.get_coordinates(ground), axis=0)))
    whole = shapely.LineString([centre - reach * normal, centre + reach * normal])
    cut = whole.intersection(ground if area is None else ground.intersection(area.polygon))
    offsets = (shapely.get_coordinates(cut) - centre) @ normal
    if offsets.size == 0:
        offsets = np.array([-0.5, 0.5]) * terrain.step_m
    ends: FloatArray = centre + np.outer([offsets.min(), offsets.max()], normal)
    return ends


def _draw_profile(
    panels: tuple[Axes, Axes],
    line: FloatArray,
    *,
    reconstruction: Reconstruction,
    reference: Dem,
    prior: Dem | None,
    area: SurveyArea | None,
) -> None:
    """Draw heights above and their error below, against the distance along a line."""
    heights, errors = panels
    distance, xy = _sampled(line, reconstruction.mean.step_m)
    here = np.ones(len(xy), dtype=bool) if area is None else area.contains(xy)
    mean, std, real = (
        np.where(here, dem.at(xy), np.nan) for dem in (reconstruction.mean, reconstruction.std, reference)
    )
    heights.plot(distance, real, color=REFERENCE, linewidth=1.1, label="Reference", zorder=3)
    heights.plot(
        distance,
        mean,
        color=ESTIMATE,
        linewidth=1.2,
        linestyle=(0, (4, 1.5)),
        label="Reconstruction",
        zorder=4,
    )
    band: dict[str, Any] = {"color": ESTIMATE, "alpha": 0.25, "linewidth": 0}
    heights.fill_between(distance, mean - 2 * std, mean + 2 * std, label="± 2 σ", **band)
    if prior is not None:
        before = np.where(here, prior.at(xy), np.nan)
        heights.plot(distance, before, color=PRIOR, linestyle=":", linewidth=1.2, label="Prior", zorder=2)
    errors.fill_between(distance, -2 * std, 2 * std, **band)
    errors.axhline(0.0, color=MUTED, linewidth=0.7)
    errors.plot(distance, mean - real, color=INK, linewidth=1.0)
    heights.set_ylabel("Elevation [m]")
    errors.set(xlabel="Distance [m]", ylabel="Error [m]", xlim=(0.0, distance[-1]))
    for axes in panels:
        axes.grid(visible=True, axis="y")


def _sampled(line: FloatArray, step_m: float) -> tuple[FloatArray, FloatArray]:
    """Return distances (N,) and places (N, 2) about one grid step apart along a polyline."""
    length = float(np.hypot(*np.diff(line, axis=0).T).sum())
    shares = np.linspace(0.0, 1.0, max(int(length / step_m), 1) + 1)
    return shares * length, along(line, shares)


def _mark_crossings(panels: tuple[Axes, Axes], line: FloatArray, route: Route) -> None:
    """Mark, on the profiles, where the route was driven across them."""
    path = shapely.LineString(line)
    crossings = shapely.get_coordinates(shapely.intersection(route.line, path))
    if crossings.size == 0:
        return
    distance = np.unique(np.hypot(*(crossings - line[0]).T).round(3))
    for axes, label in zip(panels, ("Route", None), strict=True):
        axes.plot(
            distance,
            np.zeros(distance.size),
            marker="^",
            color=CLAIM,
            markersize=6,
            linestyle="none",
            transform=axes.get_xaxis_transform(),
            clip_on=False,
            label=label,
            zorder=5,
        )


@styled
def trajectory_error(estimated: Trajectory, reference: Trajectory) -> Figure:
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
    >>> [axes.get_ylabel() for axes in trajectory_error(estimated, driven).axes]
    ['East [m]', 'North [m]', 'Up [m]']
    """
    same_crs(estimated.crs, reference.crs, "the trajectory and its reference")
    common = (estimated.time_s >= reference.time_s[0]) & (estimated.time_s <= reference.time_s[-1])
    time = estimated.time_s[common]
    figure = Figure(figsize=(FULL_IN, 4.6), layout="constrained")
    panels = figure.subplots(3, 1, sharex=True)
    unit, seconds = ("min", 60.0) if len(time) and time[-1] > 600.0 else ("s", 1.0)
    for index, (axes, name) in enumerate(zip(panels, _AXES_OF_SPACE, strict=True)):
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
