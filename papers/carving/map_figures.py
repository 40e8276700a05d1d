"""Figures of the maps of the carving study: surfaces, sections, contributions, the downhill drive."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from papers.carving.world import CRS, HALF_M, ScanTrial
from survey.core.arrays import FloatArray
from survey.data.grid import Grid
from survey.figures.style import (
    CLAIM,
    DENSITY,
    ELEVATION,
    ERROR,
    ESTIMATE,
    FULL_IN,
    INK,
    PRIOR,
    ROVERS,
    styled,
)

GRID = Grid((-HALF_M, -HALF_M, HALF_M, HALF_M), 0.25, CRS)
EXTENT = (-HALF_M, HALF_M, -HALF_M, HALF_M)
SECTIONS = {"A": ("north", 0.0), "B": ("north", -8.0), "C": ("east", 0.0), "D": ("east", 9.0)}
"""Four cross-sections: the axis along which each stays, and where [m]."""


def section_line(name: str, along: FloatArray) -> FloatArray:
    """Return the places (N, 2) of a cross-section at distances along it [m]."""
    axis, at = SECTIONS[name]
    still = np.full_like(along, at)
    return np.column_stack([along, still] if axis == "north" else [still, along])


@styled
def draw_surfaces(maps: dict[str, FloatArray], xy: FloatArray) -> Figure:
    """Draw ground, estimate and both surfaces, the points, and the distance between the surfaces."""
    figure = Figure(figsize=(FULL_IN, 6.0), layout="constrained")
    all_axes = figure.subplots(2, 3, sharex=True, sharey=True)
    places = (all_axes[0, 0], all_axes[0, 1], all_axes[1, 0], all_axes[1, 1])
    for axes, (name, z) in zip(places, maps.items(), strict=True):
        image = axes.imshow(z, extent=EXTENT, cmap=ELEVATION, vmin=-2.0, vmax=2.5)
        axes.set_title(name)
    all_axes[0, 2].plot(*xy.T, ",", color=INK)
    all_axes[0, 2].set(title="points", aspect="equal")
    width = all_axes[1, 2].imshow(
        maps["upper surface"] - maps["lower surface"], extent=EXTENT, cmap=DENSITY, vmin=0.0, vmax=6.0
    )
    all_axes[1, 2].set_title("upper minus lower")
    for axes in all_axes[1]:
        axes.set_xlabel("east [m]")
    for axes in all_axes[:, 0]:
        axes.set_ylabel("north [m]")
    figure.colorbar(image, ax=all_axes[:, :2], label="height [m]", shrink=0.7, extend="both")
    figure.colorbar(width, ax=all_axes[1, 2], label="distance [m]", shrink=0.8, extend="max")
    return figure


@styled
def draw_sections(trial: ScanTrial, along: FloatArray, cuts: dict[str, FloatArray]) -> Figure:
    """Draw the surfaces along the four cross-sections."""
    figure = Figure(figsize=(FULL_IN, 7.2), layout="constrained")
    all_axes = figure.subplots(len(cuts), 1, sharex=True, sharey=True)
    for axes, (name, (ground, mean, lower, upper)) in zip(all_axes, cuts.items(), strict=True):
        axes.fill_between(
            along, mean, np.maximum(upper, mean), color=CLAIM, alpha=0.35, label="to the upper surface"
        )
        axes.fill_between(
            along, np.minimum(lower, mean), mean, color=ROVERS[3], alpha=0.3, label="to the lower surface"
        )
        axes.plot(along, ground, color=INK, linewidth=0.9, label="ground")
        axes.plot(along, mean, color=ESTIMATE, label="estimate")
        axis, at = SECTIONS[name]
        stays, runs = (1, 0) if axis == "north" else (0, 1)
        near = np.abs(trial.train.xyz[:, stays] - at) < 0.1
        axes.plot(
            trial.train.xyz[near, runs],
            trial.train.z[near],
            ".",
            color=INK,
            markersize=2.5,
            label="points within 0.1 m",
        )
        axes.set(ylim=(-4.5, 5.5), ylabel="height [m]")
        axes.set_title(f"{name}: {axis} {at:+g} m")
    all_axes[0].legend(ncols=5, loc="upper center")
    all_axes[-1].set_xlabel("along the section [m]")
    return figure


@styled
def draw_places(trial: ScanTrial) -> Figure:
    """Draw the points and where the cross-sections are."""
    figure = Figure(figsize=(FULL_IN * 0.6, 5.0), layout="constrained")
    axes: Axes = figure.subplots()
    axes.plot(*trial.train.xy.T, ".", color=PRIOR, markersize=1.0)
    for colour, (name, (axis, _)) in zip(ROVERS, SECTIONS.items(), strict=False):
        ends = section_line(name, np.array([-HALF_M, HALF_M]))
        axes.plot(*ends.T, color=colour)
        east, north = ends[1] + (0.4, 0.0) if axis == "north" else ends[1] + (0.0, 0.5)
        axes.text(east, north, name, color=colour, weight="bold", ha="center", va="center", clip_on=False)
    axes.set(aspect="equal", xlabel="east [m]", ylabel="north [m]", xlim=(-15, 15.8), ylim=(-15, 15.8))
    axes.set_title("Where the sections lie", pad=12)
    return figure


@styled
def draw_contributions(rays: FloatArray, points: FloatArray, counts: FloatArray) -> Figure:
    """Draw what lines of sight and points contribute to the estimate, and the hits per cell."""
    figure = Figure(figsize=(FULL_IN, 2.9), layout="constrained")
    all_axes = figure.subplots(1, 3, sharey=True)
    norm = LogNorm(0.01, 30.0)
    for axes, title, total in zip(all_axes, ("lines of sight", "points"), (rays, points), strict=False):
        image = axes.imshow(np.maximum(total, 1e-6), extent=EXTENT, cmap=DENSITY, norm=norm)
        axes.set_title(title)
    figure.colorbar(image, ax=all_axes[:2], label="sum of |α| in 0.5 m cells [m]", shrink=0.8, extend="both")
    hits = all_axes[2].imshow(np.maximum(counts, 1e-6), extent=EXTENT, cmap=DENSITY, norm=LogNorm(0.8, 100.0))
    all_axes[2].set_title("hits")
    figure.colorbar(hits, ax=all_axes[2], label="points in 0.5 m cells", shrink=0.8)
    for axes in all_axes:
        axes.set_xlabel("east [m]")
    all_axes[0].set_ylabel("north [m]")
    return figure


@styled
def draw_downhill(maps: dict[str, FloatArray], xyz: FloatArray) -> Figure:
    """Draw the errors of maps of a downhill drive, the points, and a profile."""
    figure = Figure(figsize=(FULL_IN, 5.8), layout="constrained")
    above, below = figure.subfigures(2, 1, squeeze=False, height_ratios=[1.1, 1.0]).ravel()
    top, profile = above.subplots(1, 3), below.subplots()
    ground = maps["ground"]
    for axes, name in zip(top[:2], ("points alone", "and lines of sight"), strict=True):
        error = (maps[name] - ground).reshape(GRID.shape)
        image = axes.imshow(error, extent=EXTENT, cmap=ERROR, vmin=-0.8, vmax=0.8)
        axes.set_title(f"error, {name}")
    above.colorbar(image, ax=top[:2], label="error [m]", shrink=0.85, extend="both")
    top[2].plot(*xyz[:, :2].T, ",", color=INK)
    top[2].set(title="points", aspect="equal", xlim=EXTENT[:2], ylim=EXTENT[2:])
    row = int(np.argmin(np.abs(GRID.y)))
    for name, colour in (("ground", INK), ("points alone", PRIOR), ("and lines of sight", ESTIMATE)):
        profile.plot(GRID.x, maps[name].reshape(GRID.shape)[row], color=colour, label=name)
    near = np.abs(xyz[:, 1]) < 0.1
    profile.plot(xyz[near, 0], xyz[near, 2], ".", color=INK, markersize=3)
    profile.set(xlabel="east, down the lane [m]", ylabel="height [m]", title="Along the lane")
    profile.legend()
    return figure
