"""Figures of the benchmark of missions in images."""

from typing import Any

import numpy as np
import pytest

from benchmarks.honest_missions.chance import chance_of_worst, coverage_at
from benchmarks.honest_missions.figures import rows
from benchmarks.honest_missions.maps import NONE, PRIORS, REAL, UNBIASED
from benchmarks.honest_missions.missions import PATTERNS, mission_of
from benchmarks.report import Row
from survey.core.streams import stream


def outcomes(**changed: Any) -> list[dict[str, Any]]:
    """Maps of two sites that err by 0.2 m and hold 95 %, each with these changes."""
    facts = {
        "rmse_m": 0.2,
        "claimed_m": 0.2,
        "offset_sigma_m": 0.1,
        "coverage": 0.95,
        "n_certified": 1,
        "n_false": 0,
        "contradicts": False,
        "n_far": 100,
        "far_coverage": 0.95,
        "landmarks": 5000,
        "kernel_s": 5.0,
    }
    return [
        {"pattern": pattern, "seed": seed, "ending": "arrived", "prior": prior, "n_stakes": n}
        | facts
        | changed
        for pattern in PATTERNS
        for seed in (1, 2)
        for prior in PRIORS
        for n in (0, 4)
    ]


def missed(found: list[dict[str, Any]], rmse_m: float = 0.2, kernel_s: float = 5.0) -> list[Row]:
    before = {"rmse_m": rmse_m, "coverage": 0.9, "kernel_s": kernel_s}
    earlier = {(one["pattern"], one["seed"]): before for one in found}
    return [row for row in rows(found, earlier) if row.holds is False]


def test_honest_maps_meet_every_limit() -> None:
    assert missed(outcomes()) == []


def test_each_limit_is_missed_by_maps_that_hold_too_little() -> None:
    names = [row.name for row in missed(outcomes(coverage=0.8))]
    assert len([name for name in names if "coverage of 95 %, mean" in name]) == 4
    assert len([name for name in names if "worst mission" in name]) == 2
    assert all(name.startswith((UNBIASED, REAL, NONE)) for name in names)


def test_one_false_certificate_of_a_map_with_a_real_prior_misses_the_limit() -> None:
    assert [row.name for row in missed(outcomes(n_false=1))] == [f"{REAL}: classes certified and false"]


def test_errors_are_compared_with_those_of_the_same_missions() -> None:
    (row,) = missed(outcomes(), rmse_m=0.1)
    assert row.name == f"{UNBIASED}: RMSE over that of the code of e7dc4dd"
    assert row.value == pytest.approx(2.0)


def test_patterns_survey_the_same_site() -> None:
    lawnmower, wandering = (mission_of(pattern, 41) for pattern in PATTERNS)
    assert lawnmower.terrain == wandering.terrain
    assert lawnmower.area == wandering.area


def test_maps_without_an_error_of_the_level_hold_95_per_cent() -> None:
    assert coverage_at(3.0, 0.0) == pytest.approx(0.95)
    assert chance_of_worst([0.0] * 10, 0.94) == 1.0


def test_the_chance_of_the_worst_map_is_that_of_drawn_levels() -> None:
    level = stream(1, "levels").standard_normal((2000, 5))
    worst = np.vectorize(coverage_at)(level, 0.5).min(axis=1)
    # Four standard deviations of a share of 2,000 draws.
    assert chance_of_worst([0.5] * 5, 0.85) == pytest.approx(np.mean(worst >= 0.85), abs=0.043)
