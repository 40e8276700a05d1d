"""Figures of the honesty benchmark, from the outcomes of its surveys."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from benchmarks.honesty.priors import BAD
from benchmarks.honesty.priors import KINDS as PRIORS
from benchmarks.honesty.surveys import BEFORE, CLASS_3_M, NAME_BEFORE, NAME_MISMATCHED, NO_PRIOR
from benchmarks.honesty.terrains import KINDS as TERRAINS
from benchmarks.report import Row
from survey.reconstruction.terrain_map import CHECK, CLAIM

Outcomes = Sequence[dict[str, Any]]
TRUTHFUL = ("truthful", "truthful, stated so")


def rows(found: Outcomes, earlier: Outcomes) -> Iterator[Row]:
    """Yield the rows of a run; `earlier` are maps of some of its surveys by the code of commit e7dc4dd."""
    yield Row("surveys", float(len({(one["terrain"], one["seed"]) for one in found})), "1")
    yield Row("landmarks, median", float(np.median([one["landmarks"] for one in found])), "1")
    yield from _coverage(found)
    yield from _tenths(found)
    yield from _levels(found)
    yield from _checks(found)
    yield from _certificates(found)
    yield from _errors(found)
    yield from _before(found)
    yield from _over_earlier(found, earlier)


def chosen(found: Outcomes, **values: Any) -> list[dict[str, Any]]:
    """Return the outcomes with these values; the estimator's unless an oracle's are named."""
    wanted = {"is_oracle": False, **values}
    return [one for one in found if all(one[name] == value for name, value in wanted.items())]


def _mean(found: Outcomes, name: str) -> float:
    return float(np.mean([one[name] for one in found])) if found else float("nan")


def _between(name: str, value: float, low: float, high: float) -> Row:
    return Row(name, value, "1", f"{low:g} to {high:g}", bool(low <= value <= high))


def _coverage(found: Outcomes) -> Iterator[Row]:
    for kind in PRIORS:
        mine = chosen(found, prior=kind)
        yield _between(f"{kind}: coverage of 95 %, mean over surveys", _mean(mine, "coverage"), 0.93, 0.97)
    yield Row(
        "no prior: coverage of 95 %, mean over surveys", _mean(chosen(found, prior=NO_PRIOR), "coverage"), "1"
    )
    mismatched = chosen(found, prior=NAME_MISMATCHED)
    if mismatched:
        yield Row(f"{NAME_MISMATCHED}: coverage of 95 %", _mean(mismatched, "coverage"), "1")
    cells = {
        (terrain, kind): _mean(chosen(found, prior=kind, terrain=terrain), "coverage")
        for terrain in TERRAINS
        for kind in PRIORS
    }
    (terrain, kind), least = min(cells.items(), key=lambda item: item[1])
    yield Row.of(
        f"worst terrain and prior ({terrain}, {kind}): coverage, mean over seeds", least, "1", ">=", 0.88
    )
    for terrain in TERRAINS:
        mine = [one for kind in PRIORS for one in chosen(found, prior=kind, terrain=terrain)]
        yield Row(f"{terrain}: coverage, mean over priors and seeds", _mean(mine, "coverage"), "1")


def _tenths(found: Outcomes) -> Iterator[Row]:
    counts = np.array([one["tenths"] for kind in PRIORS for one in chosen(found, prior=kind)], dtype=float)
    shares = (counts / counts.sum(axis=1, keepdims=True)).mean(axis=0)
    for name, value in (("least", shares.min()), ("greatest", shares.max())):
        yield _between(f"tenths of the probability integral, {name}", float(value), 0.08, 0.12)
    yield _between(
        "tenths of the probability integral, both outer ones", float(shares[[0, -1]].mean()), 0.08, 0.12
    )


def _levels(found: Outcomes) -> Iterator[Row]:
    """Compare the vertical offset of maps with its stated standard deviation."""
    for kind in (*PRIORS, NO_PRIOR, NAME_MISMATCHED):
        mine = chosen(found, prior=kind)
        ratio = [one["offset_m"] / one["found"][CLAIM]["offset_sigma_m"] for one in mine]
        if mine:
            value = float(np.sqrt(np.mean(np.square(ratio))))
            yield Row(f"{kind}: offset of maps over its standard deviation, root mean square", value, "1")


def _checks(found: Outcomes) -> Iterator[Row]:
    """Count maps whose standard deviation was widened because swaths that were left out contradict it."""
    tested = [one["found"][CHECK] for one in found if CHECK in one["found"]]
    contradicted = [check["contradicts"] for check in tested]
    yield Row("share of maps that swaths left out contradict", float(np.mean(contradicted)), "1")


def _certificates(found: Outcomes) -> Iterator[Row]:
    """Count maps whose claimed RMSE meets Class 3, and those among them whose true one does not."""
    mine = [one for kind in PRIORS for one in chosen(found, prior=kind)]
    yield from _limits(mine)
    for label, is_certified in _CERTIFICATES.items():
        certified = [one for one in mine if is_certified(one)]
        good = [one for one in mine if one["rmse_m"] <= CLASS_3_M]
        wrong = sum(one["rmse_m"] > CLASS_3_M for one in certified)
        yield Row(f"{label}: share of maps certified for Class 3", len(certified) / len(mine), "1")
        share = wrong / max(len(certified), 1)
        if label == "posterior of RMSE":
            yield Row.of(f"{label}: false certificates", share, "1", "<=", 0.05)
        else:
            yield Row(f"{label}: false certificates", share, "1")
        missed = sum(not is_certified(one) for one in good)
        yield Row(f"{label}: maps that meet Class 3 and are not certified", missed / max(len(good), 1), "1")


def _limits(found: Outcomes) -> Iterator[Row]:
    """Count maps whose error exceeds what their posterior states with a probability of 95 %."""
    squared = np.array([[one["rmse_m"] ** 2, one["rmse_m"] ** 2 - one["offset_m"] ** 2] for one in found])
    for name, errors_m2 in zip(("absolute", "relative"), squared.T, strict=True):
        limits_m = np.array([one["found"][CLAIM][name]["upper_m"] for one in found])
        share = float(np.mean(errors_m2 > limits_m**2))
        yield Row.of(f"posterior of RMSE, {name}: share of maps above its 95 % limit", share, "1", "<=", 0.05)


_CERTIFICATES: dict[str, Callable[[dict[str, Any]], bool]] = {
    "posterior of RMSE": lambda one: one["found"][CLAIM]["absolute"]["upper_m"] <= CLASS_3_M,
    "expected RMSE alone": lambda one: one["claimed_m"] <= CLASS_3_M,
}
"""Rules that certify a map from its outcome."""


def _errors(found: Outcomes) -> Iterator[Row]:
    none = _mean(chosen(found, prior=NO_PRIOR), "rmse_m")
    for kind, what in PRIORS.items():
        ours = chosen(found, prior=kind)
        best = chosen(found, prior=what.reference, is_oracle=True)
        ratio = _mean(_of_surveys(ours, best), "rmse_m") / _mean(best, "rmse_m")
        yield Row.of(f"{kind}: RMSE over that of an oracle", ratio, "x", "<=", 1.10)
        ratio = _mean(ours, "rmse_m") / none
        if kind in BAD:
            yield Row.of(f"{kind}: RMSE over that without a prior", ratio, "x", "<=", 1.02)
        else:
            yield Row(f"{kind}: RMSE over that without a prior", ratio, "x")


def _of_surveys(found: Outcomes, others: Outcomes) -> list[dict[str, Any]]:
    """Return the outcomes of the surveys that others belong to."""
    wanted = {(one["terrain"], one["seed"]) for one in others}
    return [one for one in found if (one["terrain"], one["seed"]) in wanted]


def _before(found: Outcomes) -> Iterator[Row]:
    """Compare with an isotropic kernel that the points alone choose, and an exact level, on the first surveys."""
    for terrain in BEFORE:
        old = chosen(found, prior=NAME_BEFORE, terrain=terrain)
        if not old:
            continue
        for kind in TRUTHFUL:
            mine = chosen(found, prior=kind, terrain=terrain)
            over = f"{terrain}, {kind}: RMSE over that of an isotropic kernel and an exact level"
            yield Row(over, _mean(_of_surveys(mine, old), "rmse_m") / _mean(old, "rmse_m"), "x")
            yield Row.of(f"{terrain}, {kind}: coverage", _mean(mine, "coverage"), "1", ">=", 0.92)
        plain = _of_surveys(chosen(found, prior=NO_PRIOR), old)
        cost = _mean(plain, "kernel_cpu_s") / _mean(old, "kernel_cpu_s")
        yield Row.of(
            f"{terrain}: CPU time of the fit of kernels over that of isotropic ones", cost, "x", "<=", 1.5
        )


def _over_earlier(found: Outcomes, earlier: Outcomes) -> Iterator[Row]:
    """Compare with the maps of the earlier code; ridges and moraine also on the survey where it errs most."""
    for terrain in BEFORE:
        old = [one for one in earlier if one["terrain"] == terrain]
        if not old:
            continue
        worst = max(old, key=lambda one: one["rmse_m"])
        yield Row(f"{terrain}, e7dc4dd: coverage", _mean(old, "coverage"), "1")
        yield Row(f"{terrain}, e7dc4dd: RMSE, largest", worst["rmse_m"], "m")
        for kind in TRUTHFUL:
            new = _of_surveys(chosen(found, prior=kind, terrain=terrain), old)
            over = f"{terrain}, {kind}: RMSE over that of e7dc4dd"
            mean = _mean(new, "rmse_m") / _mean(old, "rmse_m")
            if terrain == "SRTM windows":
                yield Row.of(over, mean, "x", "<=", 1.10)
                yield Row(f"{over}, without the offset of each map", _relative_m(new) / _relative_m(old), "x")
            else:
                yield Row(over, mean, "x")
                there = _mean(_of_surveys(new, [worst]), "rmse_m") / worst["rmse_m"]
                yield Row.of(f"{over}, on its worst survey", there, "x", "<=", 0.35)


def _relative_m(found: Outcomes) -> float:
    """Return the mean error of maps without their offset [m]."""
    return float(np.mean([np.sqrt(one["rmse_m"] ** 2 - one["offset_m"] ** 2) for one in found]))
