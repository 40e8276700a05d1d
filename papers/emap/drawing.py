"""Drawings of the EMap study: surfaces, errors, times."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from papers.emap.runs import EMAP, FIELD, METHODS, SCENARIOS, SIDE_M, RunScore
from survey.core.arrays import FloatArray
from survey.figures.style import DENSITY, ELEVATION, ERROR, FULL_IN, INK, ROVERS, styled
from survey.reconstruction.nodes import NodeWindow

COLOURS = dict(zip(METHODS, (INK, "#8a8f94", ROVERS[0], ROVERS[1]), strict=True))


def mean_and_std(values: Sequence[float]) -> tuple[float, float]:
    """Return mean and sample standard deviation; 0 for one value."""
    return float(np.mean(values)), float(np.std(values, ddof=1)) if len(values) > 1 else 0.0


@styled
def draw_surfaces(surfaces: Mapping[str, FloatArray], window: NodeWindow) -> Figure:
    """Draw the real surface, reconstructions, and their errors."""
    figure = Figure(figsize=(FULL_IN, 5.4), layout="constrained")
    axes = figure.subplots(2, len(surfaces), sharex=True, sharey=True)
    west, south, east, north = window.bounds
    extent = (west, east, south, north)
    reference = surfaces["Surface"].reshape(window.shape)
    axes[1, 0].axis("off")
    for k, (name, heights) in enumerate(surfaces.items()):
        z = heights.reshape(window.shape)
        height = axes[0, k].imshow(z, origin="lower", extent=extent, cmap=ELEVATION, vmin=-1, vmax=1)
        axes[0, k].set_title(name)
        if k:
            error = axes[1, k].imshow(
                z - reference, origin="lower", extent=extent, cmap=ERROR, vmin=-0.5, vmax=0.5
            )
            axes[1, k].set_xlabel("easting [m]")
    axes[0, 0].set_ylabel("northing [m]")
    figure.colorbar(height, ax=axes[0], label="height [m]", shrink=0.8)
    figure.colorbar(error, ax=axes[1], label="error [m]", shrink=0.8)
    return figure


@styled
def draw_hits(edges: FloatArray, counts: FloatArray, density: FloatArray) -> Figure:
    """Draw hits and their density against distance."""
    figure = Figure(figsize=(FULL_IN, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.stairs(counts, edges, fill=True, color=ROVERS[1])
    left.set(xlabel="distance from the sensor [m]", ylabel="hits per scan and 0.25 m", title="Hits")
    right.stairs(density, edges, color=ROVERS[0], linewidth=1.5)
    right.set(xlabel="distance from the sensor [m]", ylabel="hits per m²", title="Density", yscale="log")
    return figure


@styled
def draw_table(runs: Sequence[dict[str, RunScore]]) -> Figure:
    """Draw mean and spread of the weighted errors of all methods."""
    figure = Figure(figsize=(FULL_IN, 3.4), layout="constrained")
    axes: Axes = figure.subplots()
    width = 0.8 / len(METHODS)
    for k, method in enumerate(METHODS):
        values = np.array([mean_and_std([s[method].mean(name) for s in runs]) for name in SCENARIOS])
        x = np.arange(len(SCENARIOS)) + (k - 1.5) * width
        axes.bar(x, values[:, 0], width, yerr=values[:, 1], color=COLOURS[method], label=method, capsize=2)
    axes.set_xticks(np.arange(len(SCENARIOS)), SCENARIOS)
    axes.set(yscale="log", ylabel="weighted mean square error [cm²]", title="Mean and spread of the runs")
    axes.legend(ncols=2)
    return figure


@styled
def draw_histogram(edges: FloatArray, mse: Mapping[str, FloatArray]) -> Figure:
    """Draw the distribution of node errors, and a map of them for each method."""
    figure = Figure(figsize=(FULL_IN, 3.0), layout="constrained")
    axes = figure.subplots(1, 1 + len(mse), width_ratios=[2.2] + [1.0] * len(mse))
    for method, values in mse.items():
        axes[0].hist(
            np.maximum(values, edges[0]), edges, histtype="step", color=COLOURS[method], label=method
        )
    axes[0].set(xscale="log", xlabel="mean square error of a node [cm²]", ylabel="nodes", title="Raw")
    axes[0].legend(loc="upper left")
    n = round(np.sqrt(len(next(iter(mse.values())))))
    half = 0.5 * SIDE_M
    for place, (method, values) in zip(axes[1:], mse.items(), strict=True):
        image = place.imshow(
            np.sqrt(values.reshape(n, n)),
            origin="lower",
            extent=(-half, half, -half, half),
            cmap=DENSITY,
            vmin=0,
            vmax=40,
        )
        place.set_title(method, fontsize=8)
        place.set_xlabel("x [m]")
    figure.colorbar(image, ax=axes[1:], label="RMS error [cm]", shrink=0.7)
    return figure


@styled
def draw_curves(distance: FloatArray, curves: Mapping[str, FloatArray]) -> Figure:
    """Draw the error along the drive."""
    figure = Figure(figsize=(FULL_IN, 3.0), layout="constrained")
    axes: Axes = figure.subplots()
    for method, values in curves.items():
        axes.plot(distance, values, color=COLOURS[method], label=method)
    axes.set(xlabel="distance driven [m]", ylabel="error, Gaussian [cm²]", yscale="log")
    axes.set_title("Error along the drive")
    axes.legend()
    return figure


@styled
def draw_times(rows: FloatArray) -> Figure:
    """Draw the time of a scan against the number of nodes."""
    figure = Figure(figsize=(FULL_IN, 3.2), layout="constrained")
    axes: Axes = figure.subplots()
    for column, method in ((1, EMAP), (2, FIELD)):
        axes.loglog(rows[:, 0], rows[:, column], "o-", color=COLOURS[method], label=method)
    axes.plot(rows[:, 0], rows[0, 1] * rows[:, 0] / rows[0, 0], ":", color="#8a8f94", label="as the nodes")
    axes.axhline(50.0, color=INK, linewidth=0.8)
    axes.annotate("the paper, 1,600 nodes: 50 ms", (rows[0, 0], 55.0), fontsize=8)
    axes.set(xlabel="nodes", ylabel="CPU time of a scan [ms]", title="Time of a scan")
    axes.legend()
    return figure


@styled
def draw_range(thresholds: FloatArray, curves: Mapping[str, FloatArray], allowed: float) -> Figure:
    """Draw the error against the threshold of the CDF scenario."""
    figure = Figure(figsize=(FULL_IN, 3.0), layout="constrained")
    axes: Axes = figure.subplots()
    for method, values in curves.items():
        axes.plot(thresholds, values, color=COLOURS[method], label=method)
    axes.axhline(allowed, color="#8a8f94", linestyle=":", label="OctoMap at 4 m")
    axes.set(xlabel="threshold r_s of the CDF scenario [m]", ylabel="error, CDF [cm²]", yscale="log")
    axes.set_title("How far the map is as good as OctoMap's at 4 m")
    axes.legend()
    return figure
