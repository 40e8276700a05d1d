"""Classes of a map by its own claim."""

from dataclasses import replace

import numpy as np
import pytest

from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.reconstruction.checks import RmseClaim
from survey.reconstruction.terrain_map import CLAIM, Reconstruction
from survey.scoring import certificate
from survey.scoring.standards.map_classes import own_claim

GRID = Grid((0.0, 0.0, 90.0, 90.0), 10.0, "EPSG:32608")


def claimed(shared_m: float, own_m: float) -> Reconstruction:
    """Return a map whose nodes share one error and have independent ones."""
    covariance = np.full((100, 100), shared_m**2) + own_m**2 * np.eye(100)
    std = np.full(GRID.shape, np.hypot(shared_m, own_m))
    claim = RmseClaim.of(covariance, std.ravel())
    flat, deviation = Dem.on(GRID, np.zeros(GRID.shape)), Dem.on(GRID, std)
    return Reconstruction(
        flat, deviation, np.full(GRID.shape, 3), "gp", {}, diagnostics={CLAIM: claim.facts()}
    )


def test_a_class_is_met_only_when_95_percent_of_errors_are_within_its_limit():
    # A common offset of 0.25 m is below 0.49 m in 95 % of cases, and the limit of class 3 is 0.457 m.
    found = certificate(claimed(0.25, 0.02))
    assert found.claim.absolute.expected_m < found.absolute[0].limit_m < found.claim.absolute.upper_m
    assert not found.absolute[0].met
    assert found.relative[0].met


def test_absolute_and_relative_errors_are_stated_with_class_and_deviation():
    absolute, relative, level = certificate(claimed(0.3, 0.05)).sentences
    assert "60.2 cm class by ASPRS Edition 2" in absolute
    assert "its level errs by 0.300 m (1 σ), 97% of the squared error" in level
    assert (
        "0.076 m with one checkpoint, 0.058 m with one stake or RTK, 0.051 m with a known benchmark" in level
    )
    assert "not tested" in absolute
    assert "RMSE 0.050 ±" in relative
    assert "cm class by ASPRS Edition 2" in relative


def test_relative_error_is_that_without_the_offset():
    claim = certificate(claimed(0.3, 0.05)).claim
    assert claim.relative.expected_m == pytest.approx(0.05, rel=0.01)
    assert claim.offset_sigma_m == pytest.approx(0.3, rel=0.01)


def test_a_map_records_what_known_heights_change_of_its_level():
    facts = claimed(0.3, 0.05).diagnostics[CLAIM]
    assert facts["level_share"] == pytest.approx(0.973, abs=0.005)
    # The stake is surveyed to 0.03 m; beside a checkpoint the map errs by 0.05 m, too.
    assert facts["tied_m"]["stake"] == pytest.approx(np.hypot(0.05, 0.03), rel=0.02)
    assert facts["tied_m"]["checkpoint"] == pytest.approx(np.hypot(0.05, 0.058), rel=0.03)


def test_no_class_is_stated_where_ground_lies_beyond_the_points_left_out():
    result = claimed(0.02, 0.02)
    facts = result.diagnostics[CLAIM]
    assert certificate(result).absolute[0].met
    far = replace(result, diagnostics={CLAIM: facts | {"untested_share": 0.3}})
    found = certificate(far)
    assert not any(verdict.met for verdict in (*found.absolute, *found.relative))
    assert found.absolute[0].is_withheld
    assert (
        "no class is stated: 30 % of the ground lies farther from the points than any test"
        in found.sentences[0]
    )


def test_a_claim_of_an_older_file_has_no_untested_ground():
    facts = claimed(0.02, 0.02).diagnostics[CLAIM]
    older = {name: value for name, value in facts.items() if name != "untested_share"}
    assert RmseClaim.from_facts(older).untested_share == 0.0


def test_a_map_without_joint_covariance_states_no_class():
    flat = Dem.on(GRID, np.zeros(GRID.shape))
    assert own_claim(Reconstruction(flat, flat, np.full(GRID.shape, 3), "tin", {})) == []
