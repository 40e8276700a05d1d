"""Figures and table of the EMap paper for OctoMap, springs and the field lattice.

The studies come first; the drawings of surfaces, errors and times follow.
"""

import time
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from papers.emap.runs import (
    EMAP,
    FIELD,
    METHODS,
    OCTOMAP,
    OCTOMAP_COARSE,
    SCENARIOS,
    SIDE_M,
    STEP_M,
    RunScore,
    below,
    mapper,
    run,
)
from papers.emap.world import N_RUNS, N_SCANS, RANGE_M, SCAN_STEP_M, EmapRun, sine_hills, utilities
from papers.outputs import write_csv, write_figure
from survey.core.arrays import FloatArray, Progress
from survey.figures.style import DENSITY, ELEVATION, ERROR, FULL_IN, INK, ROVERS, styled
from survey.reconstruction.lattice.config import FieldLatticeConfig, SpringLatticeConfig
from survey.reconstruction.lattice.field_lattice import FieldLattice
from survey.reconstruction.lattice.spring_lattice import SpringLattice
from survey.reconstruction.nodes import NodeWindow

PAPER = {
    "Raw": (74.6, 45.8),
    "Nearest": (88.8, 50.0),
    "Gaussian": (1.21, 0.86),
    "CDF": (0.93, 0.59),
}
"""Table 1 of the paper: OctoMap and EMap, whose unit it gives as cm."""


def figure_1(folder: Path, *, quick: bool, progress: Progress) -> None:
    """Draw the surface, and its reconstruction by springs and field after a drive (Fig. 1)."""
    drive = EmapRun(run=5, n_scans=12 if quick else N_SCANS)
    models = {method: mapper(method) for method in (EMAP, FIELD)}
    place = drive.sensors()[-1]
    for k, (_, points) in enumerate(drive.scans(), start=1):
        for model in models.values():
            model.take(points)
        progress("scans", k, drive.n_scans)
    window = NodeWindow.around(place, SIDE_M, STEP_M)
    surfaces = {"Surface": sine_hills(window.xy)}
    surfaces |= {name: model.heights(window.xy) for name, model in models.items()}
    write_csv(folder / "rms_error.csv", ("method", "rms_error_m"), _rms_rows(surfaces))
    write_figure(folder / "surface.png", draw_surfaces(surfaces, window))


def figure_2(folder: Path, *, quick: bool, progress: Progress) -> None:
    """Count the scanner's hits against distance (Fig. 2)."""
    n_scans = 5 if quick else N_SCANS
    edges = np.arange(0.0, RANGE_M + 0.25, 0.25)
    counts = np.zeros(len(edges) - 1)
    for k, (place, points) in enumerate(EmapRun(n_scans=n_scans).scans(), start=1):
        counts += np.histogram(np.hypot(*(points.xy - place[:2]).T), edges)[0] / n_scans
        progress("scans", k, n_scans)
    density = counts / (np.pi * np.diff(edges**2))
    rows = zip(edges[:-1], edges[1:], counts, density, strict=True)
    write_csv(folder / "hits.csv", ("from_m", "to_m", "hits_per_scan", "hits_per_m2"), rows)
    write_figure(folder / "hits.png", draw_hits(edges, counts, density))


def table_1(folder: Path, *, quick: bool, progress: Progress) -> None:
    """Score ten runs under four utility functions, split into seen, gap and outside (Table 1)."""
    runs = list(_runs(METHODS, quick, progress))
    write_csv(folder / "table.csv", _TABLE, _table_rows(runs))
    parts = [
        (method, part, *mean_and_std([float(np.nanmean(scores[method].parts[part])) for scores in runs]))
        for method in METHODS
        for part in ("seen", "gap", "outside")
    ]
    write_csv(folder / "parts.csv", ("method", "part", "mse_cm2", "std_cm2"), parts)
    write_figure(folder / "table.png", draw_table(runs))


def errors_at_nodes_cm2(*, quick: bool, progress: Progress) -> dict[str, FloatArray]:
    """Return the mean squared error of three runs at each node of the lattice that follows, method by method [cm²]."""
    runs = list(_runs((OCTOMAP, EMAP, FIELD), quick, progress, n_runs=3))
    return {m: 1e4 * np.mean([s[m].squared_m2 for s in runs], axis=0) / _n_scans(quick) for m in runs[0]}


def write_histogram(folder: Path, name: str, mse: Mapping[str, FloatArray], side_m: float) -> None:
    """Write how errors at the nodes of a square are spread [cm²], as a table and a figure with their map."""
    edges = np.geomspace(1e-3, 1e4, 36)
    counts = [np.histogram(np.maximum(values, edges[0]), edges)[0] for values in mse.values()]
    rows = zip(edges[:-1], edges[1:], *counts, strict=True)
    write_csv(folder / f"{name}.csv", ("from_cm2", "to_cm2", *mse), rows)
    write_figure(folder / f"{name}.png", draw_histogram(edges, mse, side_m))


def figure_5(folder: Path, *, quick: bool, progress: Progress) -> None:
    """Follow the Gaussian scenario's error along three periods of the hills, 2π² m each (Fig. 5)."""
    n_runs, n_scans = 2 if quick else 3, 3 * _n_scans(quick)
    runs = []
    for k in range(n_runs):
        runs.append(run(EmapRun(run=k, n_scans=n_scans), (OCTOMAP, EMAP, FIELD)))
        progress("runs", k + 1, n_runs)
    curves = {m: np.mean([s[m].weighted["Gaussian"] for s in runs], axis=0) for m in runs[0]}
    distance = SCAN_STEP_M * np.arange(n_scans, dtype=np.float64)
    write_csv(
        folder / "along_the_drive.csv",
        ("distance_m", *curves),
        zip(distance, *curves.values(), strict=True),
    )
    write_figure(folder / "along_the_drive.png", draw_curves(distance, curves))


def figure_6(folder: Path, *, quick: bool, progress: Progress) -> None:
    """Time a scan against the number of nodes, to a million on the same 20 × 20 m (Fig. 6)."""
    sides = (40, 80, 160) if quick else (20, 40, 80, 160, 320, 1000)
    scans = [points for _, points in islice(EmapRun().scans(), 5)]
    rows = []
    for k, n in enumerate(sides, start=1):
        step_m = SIDE_M / n
        springs = SpringLattice(SpringLatticeConfig(step_m=step_m, side_m=SIDE_M))
        config = FieldLatticeConfig(step_m=step_m, side_m=SIDE_M, stiffness=200.0, range_m=20.0, n_draws=1)
        seconds = [_median_seconds(model, scans) for model in (springs, FieldLattice(config))]
        rows.append((n * n, *(1e3 * s for s in seconds)))
        progress("sizes", k, len(sides))
    write_csv(folder / "time_per_scan.csv", ("nodes", "springs_cpu_ms", "field_cpu_ms"), rows)
    write_figure(folder / "time_per_scan.png", draw_times(np.array(rows)))


def range_extension(folder: Path, *, quick: bool, progress: Progress) -> None:
    """Find how far r_s of the CDF scenario may be moved before a method errs as OctoMap does at 4 m.

    As read here, the error falls as r_s grows for every method, because the blind cone under
    the sensor counts for less: the range so defined is then the scanner's own for all of
    them, OctoMap included, and the curves say more than the range. Eq. 4 as printed, the mean over
    all nodes whatever they count, rises with r_s and gives a range of its own.
    """
    thresholds = np.arange(4.0, 10.01, 0.25)
    sums = {method: np.zeros((3, len(thresholds))) for method in (OCTOMAP, EMAP, FIELD)}
    drives = [EmapRun(run=k, n_scans=_n_scans(quick)) for k in range(1 if quick else 3)]
    for k, drive in enumerate(drives, start=1):
        _sum_over_thresholds(drive, thresholds, sums)
        progress("runs", k, len(drives))
    curves = {method: 1e4 * top / bottom for method, (top, bottom, _) in sums.items()}
    printed = {method: 1e4 * top / n for method, (top, _, n) in sums.items()}
    allowed = curves[OCTOMAP][0]
    reach = [
        (m, *(float(thresholds[of[m] <= of[OCTOMAP][0]].max(initial=0.0)) for of in (curves, printed)))
        for m in curves
    ]
    write_csv(
        folder / "error_against_threshold.csv",
        ("r_s_m", *curves, *(f"{method}, Eq. 4 as printed" for method in printed)),
        zip(thresholds, *curves.values(), *printed.values(), strict=True),
    )
    write_csv(folder / "range.csv", ("method", "r_m_m", "r_m_by_printed_eq4_m"), reach)
    write_figure(folder / "range.png", draw_range(thresholds, curves, allowed))


def _n_scans(quick: bool) -> int:
    return 10 if quick else N_SCANS


def _runs(
    methods: Sequence[str], quick: bool, progress: Progress, n_runs: int = N_RUNS
) -> Iterator[dict[str, RunScore]]:
    """Yield the scores of run after run."""
    n = 2 if quick else n_runs
    for k in range(n):
        yield run(EmapRun(run=k, n_scans=_n_scans(quick)), methods)
        progress("runs", k + 1, n)


def _sum_over_thresholds(drive: EmapRun, thresholds: FloatArray, sums: Mapping[str, FloatArray]) -> None:
    """Add one drive's Σ e² F², Σ F² and number of nodes for every threshold r_s."""
    mappers = {method: mapper(method) for method in sums}
    for place, points in drive.scans():
        nodes = NodeWindow.around(place, SIDE_M, STEP_M).xy
        # Moving the threshold by d is moving every node inwards by d.
        offset = nodes - place[:2]
        r = np.hypot(*offset.T)
        weights = [
            utilities(np.column_stack([r - (t - thresholds[0]), 0.0 * r]))["CDF"] ** 2 for t in thresholds
        ]
        for method, each in mappers.items():
            each.take(points)
            squared = (each.heights(nodes) - drive.height(nodes)) ** 2
            sums[method][0] += [float(squared @ weight) for weight in weights]
            sums[method][1] += [float(weight.sum()) for weight in weights]
            sums[method][2] += len(nodes)


def _median_seconds(model: SpringLattice | FieldLattice, scans: Sequence[object]) -> float:
    seconds = []
    for points in scans:
        began = time.process_time()
        model.update(points)  # type: ignore[arg-type]  # scans of a drive
        seconds.append(time.process_time() - began)
    return float(np.median(seconds[1:]))


_TABLE = (
    "scenario",
    "method",
    "mse_cm2",
    "std_cm2",
    "printed_eq4_cm2",
    "below_octomap_0.10_percent",
    "below_octomap_0.25_percent",
    "paper",
)


def _table_rows(runs: Sequence[dict[str, RunScore]]) -> Iterator[tuple[object, ...]]:
    for scenario in SCENARIOS:
        means = {m: mean_and_std([s[m].mean(scenario) for s in runs]) for m in METHODS}
        for method in METHODS:
            printed = float(np.mean([np.mean(s[method].printed[scenario]) for s in runs]))
            paper = {OCTOMAP: PAPER[scenario][0], EMAP: PAPER[scenario][1]}.get(method, "")
            gains = [below(means[method][0], means[base][0]) for base in (OCTOMAP, OCTOMAP_COARSE)]
            yield scenario, method, *means[method], printed, *gains, paper


def _rms_rows(surfaces: Mapping[str, FloatArray]) -> Iterator[tuple[str, float]]:
    for name, heights in list(surfaces.items())[1:]:
        yield name, float(np.sqrt(np.mean((heights - surfaces["Surface"]) ** 2)))


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
def draw_histogram(edges: FloatArray, mse: Mapping[str, FloatArray], side_m: float = SIDE_M) -> Figure:
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
    half = 0.5 * side_m
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
