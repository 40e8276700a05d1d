"""Figures of the honesty benchmark, and the kinds of priors that it compares."""

from typing import Any

import numpy as np
import pytest

from benchmarks.honesty.figures import rows
from benchmarks.honesty.priors import BAD, KINDS, prior
from benchmarks.honesty.surveys import BEFORE, NAME_BEFORE, NO_PRIOR
from benchmarks.honesty.terrains import KINDS as TERRAINS
from benchmarks.honesty.terrains import terrain


def outcome(terrain: str, seed: int, kind: str, rmse_m: float, *, is_oracle: bool = False) -> dict[str, Any]:
    claim = {
        "absolute": {"upper_m": 1.3 * rmse_m},
        "relative": {"upper_m": 0.7 * rmse_m},
        "offset_sigma_m": 0.5 * rmse_m,
    }
    return {
        "terrain": terrain,
        "seed": seed,
        "prior": kind,
        "is_oracle": is_oracle,
        "rmse_m": rmse_m,
        "claimed_m": rmse_m,
        "offset_m": 0.6 * rmse_m,
        "coverage": 0.95,
        "tenths": [1] * 10,
        "landmarks": 600,
        "kernel_cpu_s": 1.0,
        "found": {"rmse_claim": claim, "left_out_check": {"contradicts": False}},
    }


def surveys() -> list[dict[str, Any]]:
    """Surveys of two seeds: maps err by 1 m on the first, where there are oracles, and by 9 m on the other."""
    found = []
    for kind_of_terrain in TERRAINS:
        for seed, rmse_m in ((1, 1.0), (2, 9.0)):
            found += [outcome(kind_of_terrain, seed, kind, rmse_m) for kind in (NO_PRIOR, *KINDS)]
        found += [outcome(kind_of_terrain, 1, kind, 0.8, is_oracle=True) for kind in KINDS]
    return [*found, *(outcome(name, 2, NAME_BEFORE, 30.0) for name in BEFORE)]


def earlier() -> list[dict[str, Any]]:
    """Maps of the second survey by earlier code, which err by 30 m."""
    return [outcome(name, 2, "truthful", 30.0) for name in BEFORE]


def test_maps_are_compared_with_oracles_of_the_same_surveys() -> None:
    ratios = [row.value for row in rows(surveys(), earlier()) if row.name.endswith("over that of an oracle")]
    assert len(ratios) == len(KINDS)
    assert ratios == pytest.approx([1.25] * len(KINDS))


def test_maps_are_compared_with_earlier_code_on_its_worst_survey() -> None:
    worst = [row for row in rows(surveys(), earlier()) if row.name.endswith("on its worst survey")]
    assert len(worst) == 4
    assert [row.value for row in worst] == pytest.approx([0.3] * len(worst))
    assert all(row.holds for row in worst)


def test_errors_on_srtm_windows_are_compared_without_offsets_too() -> None:
    shape = [row for row in rows(surveys(), earlier()) if row.name.endswith("without the offset of each map")]
    assert [row.value for row in shape] == pytest.approx([0.3, 0.3])


def test_without_a_checkout_earlier_code_has_no_rows() -> None:
    assert not [row for row in rows(surveys(), []) if "e7dc4dd" in row.name]


def test_errors_are_compared_with_their_limits_with_and_without_the_offset() -> None:
    above = [
        row for row in rows(surveys(), earlier()) if row.name.endswith("share of maps above its 95 % limit")
    ]
    assert [row.value for row in above] == [0.0, 1.0]
    assert [row.holds for row in above] == [True, False]


def test_offsets_of_maps_are_compared_with_their_standard_deviation() -> None:
    found = [
        row.value
        for row in rows(surveys(), earlier())
        if "offset of maps over its standard deviation" in row.name
    ]
    assert found == pytest.approx([1.2] * (len(KINDS) + 1))


def test_every_kind_of_prior_is_compared_with_the_oracle_of_its_own_cells() -> None:
    ground = terrain("squared exponential", 201)
    for name, kind in KINDS.items():
        own, other = (prior(one, ground, "squared exponential", 201) for one in (name, kind.reference))
        np.testing.assert_array_equal(own.elevation, other.elevation)


def test_truthful_priors_are_not_among_the_bad_ones() -> None:
    assert set(KINDS) - set(BAD) == {"truthful", "truthful, stated so"}
