"""Table and error figures of the carving paper (Table I, Figs. 11 and 12)."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from papers.carving.world import N_TRAIN, TERRAINS, ScanTrial
from papers.outputs import write_csv, write_figure
from survey.core.arrays import FloatArray, Progress
from survey.figures.style import ESTIMATE, FULL_IN, PRIOR, ROVERS, styled
from survey.reconstruction.carving.config import SpaceCarvingConfig
from survey.reconstruction.carving.space_carving import SpaceCarvingKernel

PAPER = (
    (0.059, 0.014),
    (0.045, 0.025),
    (0.120, 0.035),
    (0.098, 0.096),
    (0.061, 0.065),
)
"""Table I of the paper: mean square errors of five terrains without and with visibility, its unit not given."""
SEEDS = (0, 1, 2)


class Regime(NamedTuple):
    """How far kernels reach at first [m], and whether the surface begins at the sensor's height or the points' median."""

    first_length_m: float
    from_sensor: bool

    def config(self, trial: ScanTrial, *, carve: bool) -> SpaceCarvingConfig:
        """Return the settings for a trial."""
        return SpaceCarvingConfig(
            bounds=False,
            carve=carve,
            first_length_m=self.first_length_m,
            prior_m=trial.sensor_height_m if self.from_sensor else None,
        )


REGIMES = {
    "short reach": Regime(1.0, True),
    "short reach from the median": Regime(1.0, False),
    "5 m": Regime(5.0, False),
}
"""The paper does not state how its length scale begins in Table I, nor which height is 0: heights in the
sensor's own frame and kernels that reach 1 m give errors and gains like its own; the others are kinder."""


class Errors(NamedTuple):
    """Mean square errors [m²] on the test points and on the grid."""

    test_m2: float
    grid_m2: float


def errors(trial: ScanTrial, regime: Regime) -> tuple[Errors, Errors]:
    """Return the errors without and with lines of sight."""
    fitted = (
        SpaceCarvingKernel(regime.config(trial, carve=carve)).fit(trial.train) for carve in (False, True)
    )
    without, carved = (Errors(*trial.errors(model.predict)) for model in fitted)
    return without, carved


def table_1(folder: Path, *, quick: bool, progress: Progress) -> None:
    """Score five terrains with and without lines of sight, from one place and from three (Table I)."""
    seeds = SEEDS[:1] if quick else SEEDS
    rows = list(_table_rows(seeds, progress))
    write_csv(folder / "table.csv", _TABLE, rows)
    write_figure(folder / "table.png", _draw_table(rows))


def figure_11(folder: Path, *, quick: bool, progress: Progress) -> None:
    """Follow the error as more points are learned from (Fig. 11)."""
    sizes = (500, 2000, 8000) if quick else (500, 1000, 2000, 4000, 8000, 16_000)
    regime = REGIMES["short reach"]
    rows = []
    for k, n in enumerate(sizes, start=1):
        pairs = [errors(ScanTrial.new("piles", seed, n_train=n), regime) for seed in SEEDS[:2]]
        without, carved = (np.mean([pair[j] for pair in pairs], axis=0) for j in (0, 1))
        rows.append((n, *without.tolist(), *carved.tolist()))
        progress("sizes", k, len(sizes))
    heading = ("points", "test_without_m2", "grid_without_m2", "test_with_m2", "grid_with_m2")
    write_csv(folder / "error_against_points.csv", heading, rows)
    write_figure(folder / "error_against_points.png", _draw_sizes(np.array(rows)))


def figure_12(folder: Path, *, quick: bool, progress: Progress) -> None:
    """Follow the error on every terrain from pass to pass (Fig. 12)."""
    curves = {}
    for k, name in enumerate(TERRAINS, start=1):
        trial = ScanTrial.new(name, SEEDS[0], n_train=2000 if quick else N_TRAIN)
        model = SpaceCarvingKernel(REGIMES["5 m"].config(trial, carve=True)).begin(trial.train)
        curves[name] = [trial.errors(model.predict)[0] for _ in model.passes()]
        progress("terrains", k, len(TERRAINS))
    passes = range(1, len(next(iter(curves.values()))) + 1)
    write_csv(
        folder / "convergence.csv",
        ("pass", *(f"{name}_m2" for name in curves)),
        zip(passes, *curves.values(), strict=True),
    )
    write_figure(folder / "convergence.png", _draw_convergence(curves))


_TABLE = (
    "views",
    "regime",
    "terrain",
    "test_without_m2",
    "test_with_m2",
    "test_change_percent",
    "grid_without_m2",
    "grid_with_m2",
    "grid_change_percent",
    "paper_without",
    "paper_with",
)


def _table_rows(seeds: tuple[int, ...], progress: Progress) -> Iterator[tuple[object, ...]]:
    n_done = 0
    for n_views in (1, 3):
        for terrain, paper in zip(TERRAINS, PAPER, strict=True):
            trials = [ScanTrial.new(terrain, seed, n_views=n_views) for seed in seeds]
            for name, regime in REGIMES.items():
                pairs = np.array([errors(trial, regime) for trial in trials])
                without, carved = pairs.mean(axis=0)
                test, on_grid = (float(100.0 * (carved[j] / without[j] - 1.0)) for j in (0, 1))
                yield (
                    n_views,
                    name,
                    terrain,
                    *(float(without[0]), float(carved[0]), test),
                    *(float(without[1]), float(carved[1]), on_grid),
                    *paper,
                )
            n_done += 1
            progress("terrains", n_done, 2 * len(TERRAINS))


@styled
def _draw_table(rows: list[tuple[object, ...]]) -> Figure:
    figure = Figure(figsize=(FULL_IN, 5.2), layout="constrained")
    all_axes = figure.subplots(2, len(REGIMES), sharey="row", sharex=True)
    x = np.arange(len(TERRAINS))
    for column, regime in enumerate(REGIMES):
        chosen = [row for row in rows if row[:2] == (1, regime)]
        for row, (first, where) in enumerate(((3, "test points"), (6, "grid"))):
            axes = all_axes[row, column]
            for k, (colour, label) in enumerate(((PRIOR, "points alone"), (ESTIMATE, "and lines of sight"))):
                heights = [float(str(values[first + k])) for values in chosen]
                axes.bar(x + 0.4 * k - 0.2, heights, 0.38, color=colour, label=label)
            if regime == "short reach" and row == 0:
                for k, marker in enumerate(("_", "_")):
                    paper = [pair[k] for pair in PAPER]
                    axes.scatter(x + 0.4 * k - 0.2, paper, s=60, marker=marker, color="black", zorder=3)
                axes.plot([], [], "_", color="black", label="the paper's five")
                axes.legend(loc="upper right")
            axes.set(yscale="log", ylim=(2e-5, 9.0))
            axes.set_title(f"{regime}: {where}" if column != 1 else f"… from the median: {where}")
        all_axes[1, column].set_xticks(x, TERRAINS, rotation=30)
    for axes in all_axes[:, 0]:
        axes.set_ylabel("mean square error [m²]")
    return figure


@styled
def _draw_sizes(rows: FloatArray) -> Figure:
    figure = Figure(figsize=(FULL_IN, 3.2), layout="constrained")
    for k, (axes, where) in enumerate(zip(figure.subplots(1, 2), ("test points", "grid"), strict=True)):
        axes.plot(rows[:, 0], rows[:, 1 + k], "o-", color=PRIOR, label="points alone")
        axes.plot(rows[:, 0], rows[:, 3 + k], "o-", color=ESTIMATE, label="and lines of sight")
        axes.set(xscale="log", yscale="log", xlabel="points learned from", title=where)
        axes.set_ylabel("mean square error [m²]")
        axes.legend()
    return figure


@styled
def _draw_convergence(curves: dict[str, list[float]]) -> Figure:
    figure = Figure(figsize=(FULL_IN, 3.2), layout="constrained")
    axes: Axes = figure.subplots()
    for colour, (name, values) in zip(ROVERS, curves.items(), strict=False):
        axes.plot(np.arange(1, len(values) + 1), values, "o-", color=colour, label=name)
    axes.set(xlabel="pass", ylabel="mean square error, test points [m²]", yscale="log")
    axes.set_title("Convergence")
    axes.legend(ncols=5, loc="upper right")
    return figure
