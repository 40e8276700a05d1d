"""Errors and times of the carving paper (Table I, Figs. 11 and 12), and its Algorithm 1 as printed.

In Algorithm 1 a point and its line of sight are visited together, one learning rate serves both and falls with every
basis, and nothing limits what a line of sight may press down. The line is searched at equal steps with the exact surface.
It is compared with the space-carving kernels on 3,000 points of one seed each, because the time of the exact search along
every line of sight grows with their square.
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, NamedTuple, Self

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numba import njit

from papers.carving.world import N_TRAIN, SENSOR_HEIGHT_M, TERRAINS, ScanTrial
from papers.outputs import write_csv, write_figure
from survey import Grid
from survey.core import FloatArray, IntArray, Progress, stream
from survey.data.surface_points import SurfacePoints
from survey.figures.style import ESTIMATE, FULL_IN, PRIOR, ROVERS, styled
from survey.reconstruction.carving.config import SpaceCarvingConfig
from survey.reconstruction.carving.descent import (
    BY_POINT,
    BY_RAY,
    Bases,
    Fresh,
    LevelCells,
    Step,
    add_fresh,
    fresh_height,
    height_at,
)
from survey.reconstruction.carving.space_carving import SpaceCarvingKernel, contributions
from survey.reconstruction.line_of_sight.returns import checked_origins

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
    """How far kernels reach at first [m], and the height at which the surface begins."""

    first_length_m: float
    begins: Literal["sensor", "ground under it", "median"]

    def config(self, trial: ScanTrial, *, carve: bool) -> SpaceCarvingConfig:
        """Return the settings for a trial."""
        return SpaceCarvingConfig(
            bounds=False,
            carve=carve,
            first_length_m=self.first_length_m,
            prior_m=self._prior_m(trial),
        )

    def _prior_m(self, trial: ScanTrial) -> float | None:
        """Return the height at which the surface begins [m]; None for the median of the points."""
        if self.begins == "median":
            return None
        return trial.sensor_height_m - (SENSOR_HEIGHT_M if self.begins == "ground under it" else 0.0)


REGIMES = {
    "short reach": Regime(1.0, "sensor"),
    "short reach from the median": Regime(1.0, "median"),
    "5 m": Regime(5.0, "median"),
}
"""The paper does not state how its length scale begins in Table I, nor which height is 0: heights in the
sensor's own frame and kernels that reach 1 m give errors and gains like its own; the others are kinder."""
ON_CLUTTER = Regime(1.0, "ground under it")
"""The frame of a vehicle, whose height 0 is the ground that it stands on, for the scans with clutter."""
CLUTTER_M = (0.0, 0.1, 0.25)
"""Clutter on every terrain, fixed before the first run: none; the root of the paper's least error, 0.014 m²; and that of
its flat ground, 0.061 m², on which a smooth surface errs by nothing else."""


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
        model = SpaceCarvingKernel(REGIMES["short reach"].config(trial, carve=True)).begin(trial.train)
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
    "clutter_m",
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
    """Yield the rows of every frame without clutter, seen from one place and from three, then those with clutter."""
    clear = [(n_views, name, regime, 0.0) for n_views in (1, 3) for name, regime in REGIMES.items()]
    frames = clear + [(1, "short reach from the ground", ON_CLUTTER, clutter_m) for clutter_m in CLUTTER_M]
    for k, (n_views, name, regime, clutter_m) in enumerate(frames, start=1):
        for terrain, paper in zip(TERRAINS, PAPER, strict=True):
            trials = [ScanTrial.new(terrain, seed, n_views=n_views, clutter_m=clutter_m) for seed in seeds]
            without, carved = np.mean([errors(trial, regime) for trial in trials], axis=0)
            test, on_grid = (float(100.0 * (carved[j] / without[j] - 1.0)) for j in (0, 1))
            yield (
                n_views,
                name,
                clutter_m,
                terrain,
                *(float(without[0]), float(carved[0]), test),
                *(float(without[1]), float(carved[1]), on_grid),
                *paper,
            )
        progress("frames", k, len(frames))


@styled
def _draw_table(rows: list[tuple[object, ...]]) -> Figure:
    """Draw the frames side by side: those without clutter, then the vehicle's with more and more of it."""
    frames = [(name, 0.0) for name in REGIMES]
    frames += [("short reach from the ground", clutter_m) for clutter_m in CLUTTER_M]
    figure = Figure(figsize=(FULL_IN, 8.6), layout="constrained")
    all_axes = figure.subplots(4, 3, sharey=True, sharex=True)
    x = np.arange(len(TERRAINS))
    for n, (regime, clutter_m) in enumerate(frames):
        chosen = [row for row in rows if row[:3] == (1, regime, clutter_m)]
        for j, (first, where) in enumerate(((4, "test points"), (7, "grid"))):
            axes = all_axes[2 * (n // 3) + j, n % 3]
            for k, (colour, label) in enumerate(((PRIOR, "points alone"), (ESTIMATE, "and lines of sight"))):
                heights = [float(str(values[first + k])) for values in chosen]
                axes.bar(x + 0.4 * k - 0.2, heights, 0.38, color=colour, label=label)
                if j == 0:
                    paper = [pair[k] for pair in PAPER]
                    axes.scatter(x + 0.4 * k - 0.2, paper, s=60, marker="_", color="black", zorder=3)
            if n == j == 0:
                axes.plot([], [], "_", color="black", label="the paper's five")
                axes.legend(loc="upper right")
            axes.set(yscale="log", ylim=(2e-5, 9.0))
            clutter = f", clutter {clutter_m:g} m" if n >= len(REGIMES) else ""
            axes.set_title(f"{regime.removeprefix('short reach ') if n else regime}{clutter}: {where}")
    for axes in all_axes[-1]:
        axes.set_xticks(x, TERRAINS, rotation=30)
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


_SEARCH_M = 0.2
"""Step of the search along a line of sight [m]; the paper states none."""
_PASSES_TO_SLOW = 4.0


class Progressed(NamedTuple):
    """State after a pass: number of bases made so far, and the factor by which all weights have decayed."""

    n_bases: int
    decayed: float


@dataclass(eq=False)
class LiteralCarving:
    """Surface by Algorithm 1: points and lines of sight in one order, with one learning rate.

    `config`: length scales, η₀, λ, dead-band and prior; `ray_rate`, `ray_sigmas`, `gate` and `bounds` are not
    used. `is_rate_strict`: whether η is proportional to t^(-1/2) from the first basis t on, and not as in
    `config`, after four passes' worth of bases.
    """

    config: SpaceCarvingConfig
    is_rate_strict: bool = False
    n_bases_: int = field(default=0, init=False)
    _bases: Bases | None = field(default=None, init=False)
    _corner: FloatArray = field(default_factory=lambda: np.zeros(2), init=False)
    _prior_m: float = field(default=0.0, init=False)

    def fit(self, points: SurfacePoints) -> Self:
        """Make all passes over the points."""
        config, origins = self.config, checked_origins(points)
        lengths = config.lengths_m()
        low = np.minimum(points.xy.min(axis=0), origins[:, :2].min(axis=0)) - lengths[0]
        high = np.maximum(points.xy.max(axis=0), origins[:, :2].max(axis=0)) + lengths[0]
        shift = np.array([*low, 0.0])
        xyz, sensors = points.xyz - shift, origins - shift
        cells = LevelCells.over(lengths, *(high - low).tolist())
        self._corner, self._bases = low, Bases.none(cells)
        self._prior_m = float(np.median(points.z)) if config.prior_m is None else config.prior_m
        rng, progressed = stream(config.seed, "algorithm 1"), Progressed(0, 1.0)
        for level in range(len(lengths)):
            fresh = Fresh.on(cells, level, 2 * len(xyz))
            order = rng.permutation(len(xyz))
            progressed = visit(xyz, sensors, order, (self._bases, fresh), self._step(len(xyz)), progressed)
            self._bases = self._bases.merged(fresh.taken(level))
        self._bases = self._bases._replace(weight=self._bases.weight * progressed.decayed)
        self.n_bases_ = progressed.n_bases
        return self

    def predict(self, xy: FloatArray) -> FloatArray:
        """Return the surface's height (N,) at places (N, 2) [m]."""
        assert self._bases is not None
        return self._prior_m + self._bases.heights(xy - self._corner)

    def contributions(self, grid: Grid) -> tuple[FloatArray, FloatArray]:
        """Return the sums of |α| (H, W) [m] of the bases that rays and that points made, in the cell about each node."""
        assert self._bases is not None
        return contributions(self._bases, self._corner, grid)

    def _step(self, n: int) -> Step:
        config = self.config
        slow_after = 1.0 if self.is_rate_strict else _PASSES_TO_SLOW * n
        rate = config.rate
        return Step(
            self._prior_m, config.dead_band_m, rate, slow_after, config.decay, config.carve, ray_rate=rate
        )


@njit(cache=True)
def visit(  # noqa: PLR0917 - compiled functions take no keywords
    xyz: FloatArray,
    sensors: FloatArray,
    order: IntArray,
    bases: tuple[Bases, Fresh],
    step: Step,
    progressed: Progressed,
) -> Progressed:
    """Visit every point and its line of sight once, in the given order; weights are stored relative to the decay so far."""
    fresh = bases[1]
    t, decayed = progressed.n_bases, progressed.decayed
    for i in order:
        x, y, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
        residual = _height(bases, x, y, step.prior_m, decayed) - z
        if abs(residual) > step.dead_band_m:
            add_fresh(fresh, x, y, -_rate(step, t) * residual / decayed, BY_POINT)
            t += 1
        if step.carve:
            x, y, depth = _worst(bases, xyz[i], sensors[i], step.prior_m, decayed)
            if depth > step.dead_band_m:
                add_fresh(fresh, x, y, -_rate(step, t) * depth / decayed, BY_RAY)
                t += 1
        decayed *= 1.0 - _rate(step, t) * step.decay
    return Progressed(t, decayed)


@njit(cache=True)
def _rate(step: Step, t: int) -> float:
    """Return the learning rate η_t."""
    return float(step.rate / np.sqrt(1.0 + t / step.slow_after))


@njit(cache=True)
def _height(bases: tuple[Bases, Fresh], x: float, y: float, prior_m: float, decayed: float) -> float:
    """Return the height of the surface [m]."""
    return prior_m + decayed * (height_at(bases[0], x, y) + fresh_height(bases[1], x, y))


@njit(cache=True)
def _worst(
    bases: tuple[Bases, Fresh], hit: FloatArray, sensor: FloatArray, prior_m: float, decayed: float
) -> tuple[float, float, float]:
    """Return where a line of sight is deepest under the surface, and how deep [m]; 0 where it is nowhere."""
    dx, dy, dz = sensor[0] - hit[0], sensor[1] - hit[1], sensor[2] - hit[2]
    n = int(np.sqrt(dx * dx + dy * dy) / _SEARCH_M)
    at_x, at_y, deepest = hit[0], hit[1], 0.0
    for k in range(1, n + 1):
        u = k / n
        x, y = hit[0] + u * dx, hit[1] + u * dy
        depth = _height(bases, x, y, prior_m, decayed) - (hit[2] + u * dz)
        if depth > deepest:
            at_x, at_y, deepest = x, y, depth
    return at_x, at_y, deepest


OURS, LITERAL, STRICT = "kernels of firnline", "Algorithm 1", "Algorithm 1, rate t^(-1/2)"
METHODS = (OURS, LITERAL, STRICT)
N_POINTS = 3000
_COMPARED = ("short reach", "5 m")
_HEADING = (
    "regime",
    "terrain",
    "method",
    "test_without_m2",
    "test_with_m2",
    "grid_without_m2",
    "grid_with_m2",
    "bases",
    "cpu_s",
)


def algorithm_1(folder: Path, *, quick: bool, progress: Progress) -> None:
    """Compare Algorithm 1, with one order and one rate, with the space-carving kernels, with and without lines of sight."""
    rows = list(_rows(quick, progress))
    write_csv(folder / "comparison.csv", _HEADING, rows)
    write_figure(folder / "comparison.png", _draw(rows))


def _rows(quick: bool, progress: Progress) -> Iterator[tuple[object, ...]]:
    """Yield the facts of every regime, terrain and method."""
    for k, terrain in enumerate(TERRAINS, start=1):
        trial = ScanTrial.new(terrain, SEEDS[0], n_train=1000 if quick else N_POINTS)
        for name in _COMPARED:
            for method in METHODS:
                yield name, terrain, method, *_judged(method, trial, REGIMES[name])
        progress("terrains", k, len(TERRAINS))


def _judged(method: str, trial: ScanTrial, regime: Regime) -> tuple[float, ...]:
    """Return errors without and with lines of sight [m²], then bases and CPU time [s] with them."""
    model = _model(method, regime.config(trial, carve=False))
    without = trial.errors(model.fit(trial.train).predict)
    model = _model(method, regime.config(trial, carve=True))
    began = time.process_time()
    carved = trial.errors(model.fit(trial.train).predict)
    seconds = time.process_time() - began
    n_bases = model.n_bases_ if isinstance(model, LiteralCarving) else sum(model.n_bases())
    return without[0], carved[0], without[1], carved[1], float(n_bases), seconds


def _model(method: str, config: SpaceCarvingConfig) -> LiteralCarving | SpaceCarvingKernel:
    if method == OURS:
        return SpaceCarvingKernel(config)
    return LiteralCarving(config, is_rate_strict=method == STRICT)


@styled
def _draw(rows: list[tuple[object, ...]]) -> Figure:
    figure = Figure(figsize=(FULL_IN, 3.4), layout="constrained")
    x = np.arange(len(TERRAINS))
    for axes, regime in zip(figure.subplots(1, len(_COMPARED)), _COMPARED, strict=True):
        for k, (colour, method) in enumerate(zip((ESTIMATE, PRIOR, ROVERS[2]), METHODS, strict=True)):
            carved = [float(str(row[6])) for row in rows if row[0] == regime and row[2] == method]
            axes.bar(x + 0.27 * (k - 1), carved, 0.25, color=colour, label=method)
        axes.set(yscale="log", title=f"{regime}: grid, with lines of sight")
        axes.set_xticks(x, TERRAINS, rotation=30)
        axes.set_ylabel("mean square error [m²]")
    axes.legend(loc="upper right")
    return figure
