"""Figures of the surveys on moving ice, from the outcomes of all cases."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from benchmarks.moving_ice.cases import Case
from benchmarks.moving_ice.chance import interval_of_mean, interval_of_share
from benchmarks.report import Row

Outcomes = Mapping[Case, Mapping[str, Any]]
_BAR, _ROUNDED = (0.93, 0.97), 1e-9


def rows(found: Outcomes, velocities: Sequence[float]) -> Iterator[Row]:
    """Yield the rows of maps and of motions."""
    yield from _still(found, [case for case in found if not case.velocity and _is_plain(case)])
    for n_stakes in (4, 0):
        for hours in (8.0, 24.0):
            for velocity in velocities:
                mine = [case for case in found if _is(case, velocity, hours, n_stakes)]
                if mine:
                    yield from _maps(found, mine, f"{velocity:g} m/day, {hours:g} h, {n_stakes} stakes")
    for n_stakes in (4, 0):
        mine = [case for case in found if case.velocity and _is_plain(case) and case.n_stakes == n_stakes]
        if mine:
            yield from _coverage(found, mine, f"all velocities and durations, {n_stakes} stakes")
            yield from _motions(found, mine, n_stakes)


def _is(case: Case, velocity: float, hours: float, n_stakes: int) -> bool:
    return (case.velocity, case.hours, case.n_stakes) == (velocity, hours, n_stakes) and _is_plain(case)


def _is_plain(case: Case) -> bool:
    """Return whether the case is one of the model that is estimated: one velocity, steady melt, and the known kernel."""
    return case == Case(case.velocity, case.hours, case.n_stakes, case.seed)


def _still(found: Outcomes, still: Sequence[Case]) -> Iterator[Row]:
    """Compare maps of still ice with its motion estimated and without."""
    if not still:
        return
    ratio = rms(found, still, "moving") / rms(found, still, "static")
    yield Row.of("still ice: RMSE over that of the static estimate", ratio, "x", "<=", 1.01)
    before, after = (mean(found, still, kind, "coverage") for kind in ("static", "moving"))
    yield Row("still ice: coverage of 95 %, static estimate", before, "1")
    yield from by_chance("still ice: coverage of 95 %, static estimate", _chance(found, still, "static"))
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
        moved, static = (rms(found, [case for case, _ in pairs], kind) for kind in ("moving", "static"))
        rested = rms(found, [still for _, still in pairs], "static")
        yield Row.of(f"{name}: RMSE over that on still ice", moved / rested, "x", "<=", 1.15)
        yield Row(f"{name}: the static estimate's RMSE over that on still ice", static / rested, "x")
    yield Row(f"{name}: coverage of 95 %", mean(found, mine, "moving", "coverage"), "1")
    yield Row(
        f"{name}: coverage of 95 % of the static estimate", mean(found, mine, "static", "coverage"), "1"
    )


def _coverage(found: Outcomes, mine: Sequence[Case], name: str) -> Iterator[Row]:
    """Yield the mean coverage of maps beside that of calibrated maps of these sites."""
    yield Row(f"{name}: surveys", float(len(mine)), "1")
    coverage = mean(found, mine, "moving", "coverage")
    yield from _beside_chance(f"{name}: coverage of 95 %", coverage, _chance(found, mine, "moving"))
    ratio = rms(found, mine, "moving") / float(
        np.sqrt(np.mean([found[case]["moving"]["claimed_m"] ** 2 for case in mine]))
    )
    yield Row(f"{name}: RMSE over the claimed one", ratio, "x")
    yield Row(
        f"{name}: coverage of 95 % of the static estimate", mean(found, mine, "static", "coverage"), "1"
    )


def _chance(found: Outcomes, mine: Sequence[Case], kind: str) -> tuple[float, float]:
    return interval_of_mean([found[case][kind]["chance"] for case in mine])


def by_chance(name: str, interval: tuple[float, float]) -> Iterator[Row]:
    """Yield the quantiles of a share that a calibrated estimate has by chance."""
    for share, value in zip((5, 95), interval, strict=True):
        yield Row(f"{name}, {share} % quantile of a calibrated estimate", value, "1")


def _beside_chance(name: str, value: float, interval: tuple[float, float]) -> Iterator[Row]:
    """Yield a share, with a bar where calibrated estimates nearly always keep to it, and their quantiles."""
    low, high = _BAR
    if interval[0] < low - _ROUNDED or interval[1] > high + _ROUNDED:
        yield Row(name, value, "1")
    else:
        yield Row(name, value, "1", f"{low:g} to {high:g}", low <= value <= high)
    yield from by_chance(name, interval)


def share_rows(name: str, scores: Sequence[float]) -> Iterator[Row]:
    """Yield the share of scores within 95 % beside that of as many calibrated ones.

    Parameters
    ----------
    name : str
        What was estimated.
    scores : sequence of float
        Errors in standard deviations, independent of one another.
    """
    within = float(np.mean(np.abs(scores) <= 1.959964))
    yield from _beside_chance(
        f"{name} within 95 %, {len(scores)} numbers", within, interval_of_share(len(scores))
    )


def _motions(found: Outcomes, mine: Sequence[Case], n_stakes: int) -> Iterator[Row]:
    """Yield shares and standard deviations of velocity and lowering."""
    name = f"{n_stakes} stakes"
    for what in ("velocity", "lowering"):
        yield from share_rows(f"{name}: {what}", _scores(found, mine, f"{what}_scores").tolist())
        sigma = float(np.mean([found[case]["moving"][f"{what}_sigma"] for case in mine]))
        shown = f"{name}: standard deviation of the {what}"
        yield Row.of(shown, sigma, "m/day", "<=", 0.1) if n_stakes == 4 else Row(shown, sigma, "m/day")


def rms(found: Outcomes, mine: Sequence[Case], kind: str) -> float:
    """Return the root mean square error of the maps of some surveys, "moving" or "static" [m]."""
    return float(np.sqrt(np.mean([found[case][kind]["rmse_m"] ** 2 for case in mine])))


def mean(found: Outcomes, mine: Sequence[Case], kind: str, name: str) -> float:
    """Return the mean of a figure of the maps of some surveys, "moving" or "static"."""
    return float(np.mean([found[case][kind][name] for case in mine]))


def _scores(found: Outcomes, mine: Sequence[Case], name: str) -> np.ndarray:
    return np.array([score for case in mine for score in found[case]["moving"][name]])
