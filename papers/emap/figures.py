"""Figures and table of the EMap paper for OctoMap, springs and the field lattice."""

import time
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path

import numpy as np

from papers.emap.drawing import (
    draw_curves,
    draw_histogram,
    draw_hits,
    draw_range,
    draw_surfaces,
    draw_table,
    draw_times,
    mean_and_std,
)
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


def figure_4(folder: Path, *, quick: bool, progress: Progress) -> None:
    """Draw how the Raw scenario's errors at the nodes are spread (Fig. 4), and where they lie."""
    runs = list(_runs((OCTOMAP, EMAP, FIELD), quick, progress, n_runs=3))
    mse = {m: 1e4 * np.mean([s[m].squared_m2 for s in runs], axis=0) / _n_scans(quick) for m in runs[0]}
    edges = np.geomspace(1e-3, 1e4, 36)
    counts = [np.histogram(np.maximum(values, edges[0]), edges)[0] for values in mse.values()]
    write_csv(
        folder / "histogram.csv",
        ("from_cm2", "to_cm2", *mse),
        zip(edges[:-1], edges[1:], *counts, strict=True),
    )
    write_figure(folder / "histogram.png", draw_histogram(edges, mse))


def figure_5(folder: Path, *, quick: bool, progress: Progress) -> None:
    """Follow the Gaussian scenario's error along the drive (Fig. 5)."""
    runs = list(_runs((OCTOMAP, EMAP, FIELD), quick, progress, n_runs=3))
    curves = {m: np.mean([s[m].weighted["Gaussian"] for s in runs], axis=0) for m in runs[0]}
    distance = SCAN_STEP_M * np.arange(_n_scans(quick), dtype=np.float64)
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
    them, OctoMap included, and the curves say more than the range.
    """
    thresholds = np.arange(4.0, 10.01, 0.25)
    sums = {method: np.zeros((2, len(thresholds))) for method in (OCTOMAP, EMAP, FIELD)}
    drives = [EmapRun(run=k, n_scans=_n_scans(quick)) for k in range(1 if quick else 3)]
    for k, drive in enumerate(drives, start=1):
        _sum_over_thresholds(drive, thresholds, sums)
        progress("runs", k, len(drives))
    curves = {method: 1e4 * top / bottom for method, (top, bottom) in sums.items()}
    allowed = curves[OCTOMAP][0]
    reach = {m: float(thresholds[curve <= allowed].max(initial=0.0)) for m, curve in curves.items()}
    write_csv(
        folder / "error_against_threshold.csv",
        ("r_s_m", *curves),
        zip(thresholds, *curves.values(), strict=True),
    )
    write_csv(folder / "range.csv", ("method", "r_m_m"), reach.items())
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
    """Add one drive's Σ e² F² and Σ F² for every threshold r_s."""
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
