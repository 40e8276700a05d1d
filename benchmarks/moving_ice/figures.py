"""Figures of the surveys on moving ice, from the outcomes of all cases."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from benchmarks.moving_ice.surveys import Case
from benchmarks.report import Row

Outcomes = Mapping[Case, Mapping[str, Any]]


def rows(found: Outcomes, velocities: Sequence[float]) -> Iterator[Row]:
    """Yield the rows of maps and of motions."""
    still = [case for case in found if case.velocity == 0.0]
    yield from _still(found, still)
    for n_stakes in (4, 0):
        for hours in (8.0, 24.0):
            for velocity in velocities:
                mine = [case for case in found if _is(case, velocity, hours, n_stakes)]
                if mine:
                    yield from _maps(found, mine, f"{velocity:g} m/day, {hours:g} h, {n_stakes} stakes")
    moving = [case for case in found if case.velocity and case.flow == "uniform" and not case.has_planes]
    yield from _coverage(found, moving, "all velocities and durations")
    for n_stakes in (4, 0):
        yield from _motions(found, [case for case in moving if case.n_stakes == n_stakes], n_stakes)
    yield from _other_models(found)


def _is(case: Case, velocity: float, hours: float, n_stakes: int) -> bool:
    same = (case.velocity, case.hours, case.n_stakes) == (velocity, hours, n_stakes)
    return same and case.flow == "uniform" and not case.has_planes


def _still(found: Outcomes, still: Sequence[Case]) -> Iterator[Row]:
    """Compare maps of still ice with its motion estimated and without."""
    if not still:
        return
    ratio = _rms(found, still, "moving") / _rms(found, still, "static")
    yield Row.of("still ice: RMSE over that of the static estimate", ratio, "x", "<=", 1.01)
    before, after = (_mean(found, still, kind, "coverage") for kind in ("static", "moving"))
    yield Row("still ice: coverage of 95 %, static estimate", before, "1")
    yield Row.of("still ice: change of the coverage of 95 %", abs(after - before), "1", "<=", 0.01)
    scores = np.abs(_scores(found, still, "velocity_scores"))
    yield Row.of(
        "still ice: velocities of 0 within two standard deviations",
        float(np.mean(scores < 2.0)),
        "1",
        ">=",
        0.9,
    )


def _maps(found: Outcomes, mine: Sequence[Case], name: str) -> Iterator[Row]:
    """Compare maps with those of the same surveys on still ice."""
    pairs = [(case, Case(0.0, case.hours, case.n_stakes, case.seed)) for case in mine]
    pairs = [(case, still) for case, still in pairs if still in found]
    if pairs:
        moved, static = (_rms(found, [case for case, _ in pairs], kind) for kind in ("moving", "static"))
        rested = _rms(found, [still for _, still in pairs], "static")
        yield Row.of(f"{name}: RMSE over that on still ice", moved / rested, "x", "<=", 1.15)
        yield Row(f"{name}: the static estimate's RMSE over that on still ice", static / rested, "x")
    yield Row(f"{name}: coverage of 95 %", _mean(found, mine, "moving", "coverage"), "1")
    yield Row(
        f"{name}: coverage of 95 % of the static estimate", _mean(found, mine, "static", "coverage"), "1"
    )


def _coverage(found: Outcomes, mine: Sequence[Case], name: str) -> Iterator[Row]:
    yield Row("surveys on moving ice", float(len(mine)), "1")
    coverage = _mean(found, mine, "moving", "coverage")
    yield Row(f"{name}: coverage of 95 %", coverage, "1", "0.93 to 0.97", 0.93 <= coverage <= 0.97)
    yield Row(
        f"{name}: coverage of 95 % of the static estimate", _mean(found, mine, "static", "coverage"), "1"
    )


def _motions(found: Outcomes, mine: Sequence[Case], n_stakes: int) -> Iterator[Row]:
    """Yield coverage and standard deviations of velocity and lowering."""
    if not mine:
        return
    name = f"{n_stakes} stakes"
    for what in ("velocity", "lowering"):
        scores = np.abs(_scores(found, mine, f"{what}_scores"))
        coverage = float(np.mean(scores <= 1.959964))
        yield Row(f"{name}: {what} within 95 %", coverage, "1", "0.93 to 0.97", 0.93 <= coverage <= 0.97)
        sigma = float(np.mean([found[case]["moving"][f"{what}_sigma"] for case in mine]))
        shown = f"{name}: standard deviation of the {what}"
        yield Row.of(shown, sigma, "m/day", "<=", 0.1) if n_stakes == 4 else Row(shown, sigma, "m/day")


def _other_models(found: Outcomes) -> Iterator[Row]:
    """Yield the rows of flow and melt that the estimate does not have in its model."""
    kinds = {
        "valley glacier, one velocity estimated": lambda c: c.flow == "valley" and not c.has_planes,
        "valley glacier, velocity with planes estimated": lambda c: c.flow == "valley" and c.has_planes,
        "melt with a daily cycle": lambda c: c.flow == "uniform" and c.diurnal_share > 0.0,
    }
    for name, is_kind in kinds.items():
        mine = [case for case in found if is_kind(case)]
        if mine:
            yield Row(f"{name}: coverage of 95 %", _mean(found, mine, "moving", "coverage"), "1")
            yield Row(f"{name}: RMSE", _rms(found, mine, "moving"), "m")


def _rms(found: Outcomes, mine: Sequence[Case], kind: str) -> float:
    return float(np.sqrt(np.mean([found[case][kind]["rmse_m"] ** 2 for case in mine])))


def _mean(found: Outcomes, mine: Sequence[Case], kind: str, name: str) -> float:
    return float(np.mean([found[case][kind][name] for case in mine]))


def _scores(found: Outcomes, mine: Sequence[Case], name: str) -> np.ndarray:
    return np.array([score for case in mine for score in found[case]["moving"][name]])
