"""Algorithm 1 as printed beside the space-carving kernels: errors, bases and time on the study's five terrains.

From 3,000 points of one seed each: the time of the exact search along every line of sight grows with their square.
"""

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from papers.carving.algorithm_1 import LiteralCarving
from papers.carving.bounds_and_timing import REGIMES, SEEDS, Regime
from papers.carving.world import TERRAINS, ScanTrial
from papers.outputs import write_csv, write_figure
from survey.core.arrays import Progress
from survey.figures.style import ESTIMATE, FULL_IN, PRIOR, ROVERS, styled
from survey.reconstruction.carving.config import SpaceCarvingConfig
from survey.reconstruction.carving.space_carving import SpaceCarvingKernel

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
