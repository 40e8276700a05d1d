"""Figures of the benchmark of missions in images, from the outcomes of its maps."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from benchmarks.honest_missions.chance import chance_of_worst
from benchmarks.honest_missions.maps import NONE, PRIORS, REAL, UNBIASED
from benchmarks.honest_missions.missions import PATTERNS, SINGLE
from benchmarks.report import Row

Earlier = Mapping[tuple[str, int], Mapping[str, float]]
"""Maps of the earlier code by pattern and seed."""
Outcomes = Sequence[Mapping[str, Any]]
_MEAN, _WORST = {UNBIASED: (0.93, 0.97), REAL: (0.93, 0.97), NONE: (0.92, 1.0)}, {UNBIASED: 0.88, NONE: 0.85}
_BARRED_STAKES = {UNBIASED: (0,), REAL: (0, 4), NONE: (0,)}
"""Numbers of stakes for which the figures of a prior have limits."""


def rows(found: Outcomes, earlier: Earlier) -> Iterator[Row]:
    """Yield the rows of a run."""
    yield Row("missions", float(len({(one["pattern"], one["seed"]) for one in found})), "1")
    arrived = float(np.mean([one["ending"] == "arrived" for one in found]))
    yield Row.of("drives that arrived", arrived, "1", ">=", 1.0)
    yield Row("landmarks, fewest", float(min(one["landmarks"] for one in found)), "1")
    for prior in PRIORS:
        for n_stakes in (0, 4):
            mine = [one for one in found if one["prior"] == prior and one["n_stakes"] == n_stakes]
            yield from _coverage(prior, n_stakes, mine)
            yield from _errors(prior, n_stakes, mine)
    yield from _certificates(found)
    yield from _far(found)
    yield from _over_earlier(found, earlier)


def _named(prior: str, n_stakes: int) -> str:
    return f"{prior}, {n_stakes} stakes" if n_stakes else f"{prior}, no stakes"


def _coverage(prior: str, n_stakes: int, mine: Outcomes) -> Iterator[Row]:
    """Yield mean and worst coverage, with limits where there are any."""
    coverage = np.array([one["coverage"] for one in mine])
    name, mean, worst = _named(prior, n_stakes), float(coverage.mean()), float(coverage.min())
    if n_stakes in _BARRED_STAKES[prior]:
        low, high = _MEAN[prior]
        bar = f"{low:g} to {high:g}" if high < 1.0 else f">= {low:g}"
        yield Row(f"{name}: coverage of 95 %, mean", mean, "1", bar, low <= mean <= high)
    else:
        yield Row(f"{name}: coverage of 95 %, mean", mean, "1")
    shown = f"{name}: coverage of 95 %, worst mission"
    if n_stakes in _BARRED_STAKES[prior] and prior in _WORST:
        yield Row.of(shown, worst, "1", ">=", _WORST[prior])
        shares = [(one["offset_sigma_m"] / one["claimed_m"]) ** 2 for one in mine]
        chance = chance_of_worst(shares, _WORST[prior])
        yield Row(f"{shown}, chance of {_WORST[prior]:g} or more with levels as stated", chance, "1")
    else:
        yield Row(shown, worst, "1")
    single = [one["coverage"] for one in mine if one["seed"] == SINGLE]
    if single:
        yield Row(f"{name}: coverage of 95 %, single swaths", float(np.mean(single)), "1")
    contradicted = float(np.mean([one["contradicts"] for one in mine]))
    yield Row(f"{name}: share of maps that swaths left out contradict", contradicted, "1")


def _errors(prior: str, n_stakes: int, mine: Outcomes) -> Iterator[Row]:
    """Yield median error and claim of both patterns."""
    for pattern in PATTERNS:
        here = [one for one in mine if one["pattern"] == pattern]
        if not here:
            continue
        rmse = float(np.median([one["rmse_m"] for one in here]))
        shown = f"{_named(prior, n_stakes)}, {pattern}: RMSE, median"
        if (prior, n_stakes, pattern) == (REAL, 4, "lawnmower"):
            yield Row.of(shown, rmse, "m", "<=", 0.30)
        else:
            yield Row(shown, rmse, "m")
        ratio = float(np.median([one["claimed_m"] / one["rmse_m"] for one in here]))
        yield Row(f"{_named(prior, n_stakes)}, {pattern}: claimed over true RMSE, median", ratio, "x")


def _certificates(found: Outcomes) -> Iterator[Row]:
    """Count certificates that a map does not meet."""
    for prior in PRIORS:
        mine = [one for one in found if one["prior"] == prior]
        yield Row(f"{prior}: classes certified", float(sum(one["n_certified"] for one in mine)), "1")
        n_false = float(sum(one["n_false"] for one in mine))
        shown = f"{prior}: classes certified and false"
        yield Row.of(shown, n_false, "1", "<=", 0.0) if prior == REAL else Row(shown, n_false, "1")


def _far(found: Outcomes) -> Iterator[Row]:
    """Yield the share of points of swaths left out, beyond 5 m of others, that lie within their interval."""
    for prior in PRIORS:
        mine = [one for one in found if one["prior"] == prior and one["n_far"] and one["n_stakes"] == 0]
        coverage = float(np.mean([one["far_coverage"] for one in mine])) if mine else float("nan")
        yield Row.of(f"{prior}: swaths left out, beyond 5 m, within 95 %", coverage, "1", ">=", 0.92)


def _over_earlier(found: Outcomes, earlier: Earlier) -> Iterator[Row]:
    """Compare with the earlier code's maps of the same recordings."""
    mine = [
        one
        for one in found
        if (one["prior"], one["n_stakes"]) == (UNBIASED, 0) and (one["pattern"], one["seed"]) in earlier
    ]
    if not mine:
        return
    before = [earlier[one["pattern"], one["seed"]] for one in mine]
    name = f"{UNBIASED}, code of e7dc4dd"
    yield Row(f"{name}: RMSE, mean", _mean(before, "rmse_m"), "m")
    yield Row(f"{name}: coverage of 95 %, mean", _mean(before, "coverage"), "1")
    yield Row(f"{name}: coverage of 95 %, worst mission", min(one["coverage"] for one in before), "1")
    ratio = _mean(mine, "rmse_m") / _mean(before, "rmse_m")
    yield Row.of(f"{UNBIASED}: RMSE over that of the code of e7dc4dd", ratio, "x", "<=", 1.02)
    cost = _mean(mine, "kernel_s") / _mean(before, "kernel_s")
    yield Row(f"{name}: CPU time of the fit of the kernel, mean", _mean(before, "kernel_s"), "s")
    yield Row.of("CPU time of the fit of the kernel over that of the code of e7dc4dd", cost, "x", "<=", 1.5)


def _mean(found: Outcomes, name: str) -> float:
    return float(np.mean([one[name] for one in found]))
