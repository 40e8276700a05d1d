"""Predicted errors of maps beside those of the maps, on windows of real ground.

``python -m benchmarks.prediction [--quick] [--json FILE]``

Windows are those of `benchmarks.promise_on_real_ground`. Each is surveyed along 4, 8 and 16 lines, and mapped by `reconstruct`
with two priors: exact means over cells with white and common errors, and what a product would show, smoothed, shifted and with
correlated errors. The settings of the prediction were chosen on eleven landscapes, whose rows have no bars; the landslide slope
is fresh. A wish for an error is tried at eleven multiples of the predicted one. Parts are stored; about 35 minutes of CPU.
"""

import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Literal, NamedTuple, Self

import numpy as np

from benchmarks.gridders_on_real_ground.surveys import LINES, N_STEPS, NOISE_M, Survey, survey_of
from benchmarks.promise_on_real_ground.windows import FOLDER, LANDSCAPES, site_of, windows
from benchmarks.report import Row, main
from benchmarks.stored_parts import code_digest, stored
from planners.prediction.assumptions import MapAssumptions
from planners.prediction.error_distribution import ErrorDistribution
from planners.prediction.error_model import ErrorModel
from survey import Dem, SurfacePoints
from survey.core.arrays import FloatArray
from survey.reconstruction import reconstruct

_MOST_WINDOWS = 6
_PRIORS = ("exact means", "product")
_MULTIPLES = np.array([0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.15, 1.3, 1.5, 1.8, 2.2])
_N_BINS, _LEAST_IN_BIN = 10, 20


class Case(NamedTuple):
    """A map by its window, number of lines and prior."""

    landscape: str
    window: int
    lines: str
    prior: str


@dataclass(frozen=True)
class Judged:
    """Predicted and actual error of a map [m], bounds that the error lies between with 80 % [m], and P(error within wishes)."""

    case: Case
    predicted_m: float
    actual_m: float
    bounds_m: tuple[float, float]
    chances: FloatArray

    @classmethod
    def of(cls, case: Case, found: ErrorDistribution, actual_m: float) -> Self:
        """Judge a predicted distribution by the error of the map that was made [m]."""
        chances = np.array([found.probability(multiple * found.rmse_m) for multiple in _MULTIPLES])
        return cls(case, found.rmse_m, actual_m, (found.quantile_m(0.1), found.quantile_m(0.9)), chances)

    @property
    def ratio(self) -> float:
        """Predicted over actual error."""
        return self.predicted_m / self.actual_m


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows of the landscapes that settings were chosen on, then of the fresh one."""
    if not FOLDER.is_dir():
        sys.exit(f"the folder of real data {FOLDER} is not here; set FIRNLINE_DATA.")
    for name, halves in (("chosen on", ("development", "judgement")), ("fresh", ("fresh",))):
        landscapes = [one.name for one in LANDSCAPES if one.half in halves]
        found = [_judged(case) for case in _cases(landscapes[: 2 if quick else None], quick=quick)]
        yield from _rows(name, found, is_judged=name == "fresh")


def _cases(landscapes: Sequence[str], *, quick: bool) -> Iterator[Case]:
    """Yield the maps of some windows of each landscape, evenly taken."""
    for landscape in landscapes:
        n = len(windows(landscape))
        chosen = np.unique(np.linspace(0, n - 1, min(n, 1 if quick else _MOST_WINDOWS)).round().astype(int))
        for window in chosen.tolist():
            yield from (Case(landscape, window, lines, prior) for lines in LINES for prior in _PRIORS)


def _judged(case: Case) -> Judged:
    """Predict a map before it is made, and judge it."""
    survey = survey_of(case.landscape, case.window, case.lines)
    model = _model(case.landscape, case.window, case.prior)
    found = model.predictor.distribution(survey.xy, model.posterior)
    actual_m = stored(_file(case), lambda: _actual_m(survey, _prior(case.landscape, case.window, case.prior)))
    return Judged.of(case, found, actual_m)


@cache
def _model(landscape: str, window: int, prior: str) -> ErrorModel:
    """Return the predictor of a window, for samples without an error that all share."""
    site = site_of(landscape, window)
    sigma_m = site.prior_sigma_m if prior == "product" else 1.0
    step_m = (site.area.bounds[2] - site.area.bounds[0]) / N_STEPS
    assumed = MapAssumptions(noise_m=NOISE_M, sample_step_m=step_m, shared_m=0.0, prior_sigma_m=sigma_m)
    return ErrorModel.from_prior(site.area, _prior(landscape, window, prior), assumed)


def _prior(landscape: str, window: int, prior: str) -> Dem:
    if prior == "product":
        return site_of(landscape, window).prior
    return survey_of(landscape, window, next(iter(LINES))).prior


def _actual_m(survey: Survey, prior: Dem) -> float:
    """Return the root mean square error of the map that `reconstruct` makes with its defaults [m]."""
    points = SurfacePoints(
        np.column_stack([survey.xy, survey.z]), sigma_m=survey.sigma_m, crs=survey.grid.crs
    )
    error = reconstruct(points, survey.grid, prior).mean.elevation.ravel() - survey.truth
    return float(np.sqrt(np.mean(error**2)))


def _file(case: Case) -> Path:
    name = "-".join(map(str, case)).replace(" ", "_").replace("/", "_")
    return Path(tempfile.gettempdir()) / "firnline-prediction" / code_digest(("survey",)) / f"{name}.json"


def _rows(name: str, found: Sequence[Judged], *, is_judged: bool) -> Iterator[Row]:
    """Yield how far predicted errors are from actual ones, and how often what is stated holds."""
    yield Row(f"{name}: landscapes", len({one.case.landscape for one in found}), "")
    yield Row(f"{name}: windows", len({one.case[:2] for one in found}), "")
    yield Row(f"{name}: maps", len(found), "")
    title = f"{name}: predicted over actual error"
    row = Bars(is_judged)
    yield from ratio_rows(title, found, row)
    for lines in LINES:
        median = median_of([one for one in found if one.case.lines == lines])
        yield row.of(f"{title}, {lines}: median", median, "x", (">=", 0.95))
        yield row.of(f"{title}, {lines}: median, not too large", median, "x", ("<=", 1.1))
    for prior in _PRIORS:
        yield Row(
            f"{title}, {prior}: median", median_of([one for one in found if one.case.prior == prior]), "x"
        )
    for landscape in dict.fromkeys(one.case.landscape for one in found):
        mine = [one for one in found if one.case.landscape == landscape]
        yield Row(f"{title}, {landscape}: median", median_of(mine), "x")
    yield from chance_rows(name, found, row)


class Bars(NamedTuple):
    """Rows with bars where they are judged."""

    is_judged: bool

    def of(self, name: str, value: float, unit: str, bar: tuple[Literal["<=", ">="], float]) -> Row:
        """Return a row."""
        return Row.of(name, value, unit, *bar) if self.is_judged else Row(name, value, unit)


def median_of(found: Sequence[Judged]) -> float:
    """Return the median of predicted over actual errors."""
    return float(np.median([one.ratio for one in found]))


def ratio_rows(title: str, found: Sequence[Judged], row: Bars) -> Iterator[Row]:
    """Yield the lower and upper tenth of predicted over actual errors."""
    low, high = np.quantile([one.ratio for one in found], [0.1, 0.9]).tolist()
    yield row.of(f"{title}, 10 %", low, "x", (">=", 0.7))
    yield row.of(f"{title}, 90 %", high, "x", ("<=", 1.4))


def chance_rows(name: str, found: Sequence[Judged], row: Bars) -> Iterator[Row]:
    """Yield how many errors lie within the stated range, and the share of wishes met less the stated probability in ten bins."""
    within = float(np.mean([one.bounds_m[0] <= one.actual_m <= one.bounds_m[1] for one in found]))
    yield row.of(f"{name}: actual errors within the stated 80 %", within, "1", (">=", 0.75))
    chances = np.concatenate([one.chances for one in found])
    met = np.concatenate([one.actual_m <= _MULTIPLES * one.predicted_m for one in found])
    bins = np.minimum((_N_BINS * chances).astype(int), _N_BINS - 1)
    off = {
        int(b): float(met[bins == b].mean() - chances[bins == b].mean())
        for b in np.unique(bins)
        if np.sum(bins == b) >= _LEAST_IN_BIN
    }
    for b, each in off.items():
        yield Row(
            f"{name}: share met less P(wish), P of {b / _N_BINS:.1f} to {(b + 1) / _N_BINS:.1f}", each, "1"
        )
    worst = max(off.values(), key=abs, default=0.0)
    yield row.of(f"{name}: share met less P(wish), worst bin", abs(worst), "1", ("<=", 0.08))


if __name__ == "__main__":
    main("Predicted errors on real ground", measure)
