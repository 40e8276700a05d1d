"""Errors, intervals and cost of maps of real ground, beside those of other gridders on the same samples.

``python -m benchmarks.gridders_on_real_ground [--quick] [--json FILE]``

Windows and landscapes are those of `benchmarks.promise_on_real_ground`: settings are chosen on the development landscapes,
whose rows have no bars; the judgement landscapes are others. Each window is surveyed along lines of three densities, at most
six of each landscape; the middle one by landmarks, and that of two landscapes of each half by ground points. Maps are judged
on all nodes to the fence.

Other gridders are left out where they are not installed (``pip install firnline[peers]``; ``gdal_grid`` is a program of
GDAL), and named. Needs the real data (FIRNLINE_DATA). Scores are stored as they are found; a run that was ended goes on
from them. All of it takes about 45 minutes of CPU.
"""

import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Literal

import numpy as np

from benchmarks.gridders_on_real_ground.figure import ratio_figure
from benchmarks.gridders_on_real_ground.gridders import MATERN, PEERS
from benchmarks.gridders_on_real_ground.scores import Half, Judged, Score, cases, judged, missing
from benchmarks.gridders_on_real_ground.surveys import LINES, N_NODES, NOISE_M, SCATTERED
from benchmarks.promise_on_real_ground.windows import FOLDER, SEED, fine_dem, windows
from benchmarks.report import Row, fastest, main
from benchmarks.writer import TABLES
from survey.core.arrays import FloatArray
from survey.core.streams import stream
from survey.figures.style import png_bytes
from survey.reconstruction import GaussianProcessConfig
from survey.reconstruction.gp.conditioning import ConditioningTask, condition_all
from survey.reconstruction.gp.engine_choice import is_little_work
from survey.reconstruction.gp.kernel_average import averaged_kernels

KINDS = (*LINES, *SCATTERED)
SPARSEST = next(iter(LINES))
HALVES: tuple[Half, ...] = ("development", "judgement")
_N_TIMED = 5000
_N_WORST = 3

Ratio = Callable[[Judged], float]
Bar = tuple[Literal["<=", ">="], float]


def over_best_peer(one: Judged) -> float:
    """Return our error over the least of the others."""
    return one.without.rmse_m / one.best_peer_m


def prior_over_without(one: Judged) -> float:
    """Return our error with the prior over that without it."""
    return one.with_prior.rmse_m / one.without.rmse_m


def prior_over_best_peer(one: Judged) -> float:
    """Return our error with the prior over the least of the others."""
    return one.with_prior.rmse_m / one.best_peer_m


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows of both halves, then the CPU time; draw the figure of a full run."""
    if not FOLDER.is_dir():
        sys.exit(f"the folder of real data {FOLDER} is not here; set FIRNLINE_DATA.")
    yield Row(f"peers, without {', '.join(missing()) or 'exception'}", len(PEERS) - len(missing()), "")
    every: dict[Half, list[Judged]] = {}
    for half in HALVES:
        every[half] = [judged(case) for case in cases(half, quick=quick)]
        yield from _RowsOf(half, every[half]).all()
    if not quick:
        drawn = png_bytes(ratio_figure(every["judgement"], KINDS))
        (TABLES / "gridders_on_real_ground.png").write_bytes(drawn)
    yield from _cpu(1 if quick else 3)


class _RowsOf:
    """Rows of one half, with bars where it is judged."""

    def __init__(self, half: Half, found: list[Judged]) -> None:
        self.half, self.found = half, found

    def all(self) -> Iterator[Row]:
        """Yield every row."""
        landscapes = {one.case.landscape for one in self.found}
        places = {one.case[:2] for one in self.found}
        for name, found in (("landscapes", landscapes), ("windows", places), ("surveys", self.found)):
            yield self._row(name, len(found), "")
        yield from self._errors()
        yield from self._with_prior()
        for name, score_of in (
            ("without prior", lambda one: one.without),
            ("with prior", lambda one: one.with_prior),
        ):
            yield from self._coverage(f"coverage of 95 % {name}", score_of)
        crps = np.array([one.without.crps_m / one.best_crps_m for one in self.found])
        yield self._row(
            "CRPS over the best peer with a deviation, median", np.median(crps), "x", ("<=", 0.95)
        )
        yield self._row("CRPS over the best peer with a deviation, 95 %", np.quantile(crps, 0.95), "x")
        yield from self._by_landscape()
        yield from self._by_peer()

    def _row(self, name: str, value: float, unit: str, bar: Bar | None = None) -> Row:
        full = f"{self.half}: {name}"
        if bar is None or self.half == "development":
            return Row(full, float(value), unit)
        return Row.of(full, float(value), unit, *bar)

    def _errors(self) -> Iterator[Row]:
        """Yield our errors without a prior over those of others."""
        name = "RMSE over the best peer"
        yield from self._quantiles(name, over_best_peer, ("<=", 0.97), ("<=", 1.05))
        yield from self._worst(name, over_best_peer)
        yield from self._by_kind(name, over_best_peer)
        name = f"RMSE over {MATERN}"

        def over_matern(one: Judged) -> float:
            return one.without.rmse_m / one.peers[MATERN].rmse_m

        yield from self._quantiles(name, over_matern, ("<=", 0.95))
        yield from self._by_kind(name, over_matern)

    def _with_prior(self) -> Iterator[Row]:
        """Yield our errors with the prior over those without it, and over those of others."""
        yield from self._by_kind("RMSE with over without prior", prior_over_without, ("<=", 1.02))
        yield from self._worst("RMSE with over without prior", prior_over_without)
        for kind, chosen in self._kinds():
            bar: Bar | None = ("<=", 0.60) if kind == SPARSEST else None
            ratios = [prior_over_best_peer(one) for one in chosen]
            name = f"RMSE with prior over the best peer, {kind}"
            yield self._row(f"{name}: median", np.median(ratios), "x", bar)
            yield self._row(f"{name}: 95 %", np.quantile(ratios, 0.95), "x")

    def _quantiles(self, name: str, ratio: Ratio, median: Bar, worst: Bar | None = None) -> Iterator[Row]:
        ratios = np.array([ratio(one) for one in self.found])
        yield self._row(f"{name}, median", np.median(ratios), "x", median)
        yield self._row(f"{name}, 95 %", np.quantile(ratios, 0.95), "x")
        yield self._row(f"{name}, worst", ratios.max(), "x", worst)

    def _kinds(self) -> Iterator[tuple[str, list[Judged]]]:
        """Yield the surveys of each kind; a quick run has the first two."""
        for kind in KINDS:
            chosen = [one for one in self.found if one.case.kind == kind]
            if chosen:
                yield kind, chosen

    def _by_kind(self, name: str, ratio: Ratio, worst: Bar | None = None) -> Iterator[Row]:
        for kind, chosen in self._kinds():
            ratios = np.array([ratio(one) for one in chosen])
            yield self._row(f"{name}, {kind}: median", np.median(ratios), "x")
            yield self._row(f"{name}, {kind}: 95 %", np.quantile(ratios, 0.95), "x")
            yield self._row(f"{name}, {kind}: worst", ratios.max(), "x", worst if kind in LINES else None)

    def _worst(self, name: str, ratio: Ratio) -> Iterator[Row]:
        """Yield the surveys with the greatest ratios."""
        for one in sorted(self.found, key=ratio, reverse=True)[:_N_WORST]:
            yield self._row(f"{name}, among the worst: {one.case}", ratio(one), "x")

    def _coverage(self, name: str, score_of: Callable[[Judged], Score]) -> Iterator[Row]:
        """Yield the share of ground within intervals: all nodes count equally, for maps have as many."""
        shares = np.array([score_of(one).coverage for one in self.found])
        landscapes = np.array([one.case.landscape for one in self.found])
        yield self._row(f"{name}, pooled", shares.mean(), "1", (">=", 0.93))
        yield self._row(f"{name}, pooled, not too wide", shares.mean(), "1", ("<=", 0.97))
        by_landscape = {each: shares[landscapes == each].mean() for each in np.unique(landscapes)}
        least = min(by_landscape, key=lambda each: by_landscape[each])
        yield self._row(f"{name}, worst landscape", by_landscape[least], "1", (">=", 0.90))
        yield self._row(f"{name}, there: {least}", by_landscape[least], "1")
        yield self._row(f"{name}, worst survey", shares.min(), "1", (">=", 0.85))
        for k in np.argsort(shares, kind="stable")[:_N_WORST]:
            yield self._row(f"{name}, among the worst: {self.found[k].case}", shares[k], "1")

    def _by_landscape(self) -> Iterator[Row]:
        """Yield the medians of each landscape."""
        for landscape in dict.fromkeys(one.case.landscape for one in self.found):
            mine = [one for one in self.found if one.case.landscape == landscape]
            for name, ratio in (
                ("RMSE over the best peer", over_best_peer),
                ("RMSE with over without prior", prior_over_without),
            ):
                yield self._row(f"{landscape}: {name}, median", np.median([ratio(one) for one in mine]), "x")
            for name, shares in (
                ("without", [one.without.coverage for one in mine]),
                ("with", [one.with_prior.coverage for one in mine]),
            ):
                yield self._row(f"{landscape}: coverage {name} prior", float(np.mean(shares)), "1")

    def _by_peer(self) -> Iterator[Row]:
        """Yield how each of the others does beside the best of them, and on how many surveys it finds no surface."""
        for peer in PEERS:
            ratios = [
                one.peers[peer.name].rmse_m / one.best_peer_m for one in self.found if peer.name in one.peers
            ]
            if ratios:
                yield self._row(f"{peer.name}: RMSE over the best peer, median", np.median(ratios), "x")
                if len(ratios) < len(self.found):
                    yield self._row(
                        f"{peer.name}: surveys without a surface", len(self.found) - len(ratios), ""
                    )


def _cpu(n: int) -> Iterator[Row]:
    """Yield the CPU time of the choice of kernels, and of what their average adds to one conditioning."""
    bounds, rng, n_nodes = windows("hills")[0], stream(SEED, "gridders", "timed"), (N_NODES + 1) ** 2
    xy: FloatArray = rng.uniform(bounds[:2], bounds[2:], (_N_TIMED, 2))
    z = fine_dem("hills").at(xy) + NOISE_M * rng.standard_normal(_N_TIMED)
    data = xy, z - z.mean(), np.full(_N_TIMED, NOISE_M**2)
    has_patches = is_little_work(_N_TIMED, n_nodes)
    found, choice_s = fastest(lambda: averaged_kernels(*data, has_patches=has_patches), n)
    task = ConditioningTask("gp", GaussianProcessConfig(), bounds, "constant", n_nodes=n_nodes)
    _, one_s = fastest(lambda: condition_all(task, replace(found, average=()), *data), n)
    _, all_s = fastest(lambda: condition_all(task, found, *data), n)
    name = f"CPU on {_N_TIMED} points"
    yield Row(f"{name}: choice of kernels", choice_s, "s")
    yield Row(f"{name}: one conditioning", one_s, "s")
    yield Row.of(f"{name}: choice of kernels and average", choice_s + all_s - one_s, "s", "<=", 4.0)


if __name__ == "__main__":
    main(
        "Gridders on real ground", measure, ("numpy", "scipy", "scikit-learn", "verde", "pykrige", "gstools")
    )
