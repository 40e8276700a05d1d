"""Error statistics, calibration and map classes against hand work and other tools' figures."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import rasterio

from survey.core.errors import ConfigError, InputError
from survey.scoring import Calibration, ErrorStatistics, map_classes
from survey.scoring.standards.map_classes import judge


def test_statistics_by_hand() -> None:
    """Errors −1, 0, 1, 4: squares add to 18; deviations from the median 0.5 are 1.5, 0.5, 0.5, 3.5."""
    s = ErrorStatistics.of([-1.0, 0.0, 1.0, 4.0])
    assert s.n == 4
    assert s.bias_m == 1.0
    assert s.rmse_m == pytest.approx((18 / 4) ** 0.5, rel=1e-15)
    assert s.std_m == pytest.approx((14 / 4) ** 0.5, rel=1e-15)
    assert s.median_m == 0.5
    assert s.nmad_m == pytest.approx(1.4826 * 1.0, rel=1e-15)
    assert s.worst_m == 4.0
    # Ranks of |e| 0, 1, 1, 4: the 95th percentile lies at 0.95 · 3 = 2.85, between 1 and 4.
    assert s.p95_m == pytest.approx(1.0 + 0.85 * 3.0, rel=1e-14)
    # Central moments: m3 = (−8 − 1 + 0 + 27) / 4, m4 = (16 + 1 + 0 + 81) / 4.
    assert s.skewness == pytest.approx(4.5 / 3.5**1.5, rel=1e-12)
    assert s.kurtosis == pytest.approx(24.5 / 3.5**2 - 3.0, rel=1e-12)


def test_rmse_is_bias_and_spread_together() -> None:
    s = ErrorStatistics.of(np.random.default_rng(1).gamma(2.0, size=999))
    assert s.rmse_m**2 == pytest.approx(s.bias_m**2 + s.std_m**2, rel=1e-12)


def test_nmad_is_blind_to_outliers() -> None:
    errors = np.random.default_rng(2).normal(size=10_000)
    spoilt = errors.copy()
    spoilt[:50] = 1e6
    # The NMAD of n normal errors scatters by 1.17 / sqrt(n) = 0.012; half a per cent of outliers adds 0.8 %.
    assert ErrorStatistics.of(errors).nmad_m == pytest.approx(1.0, abs=4 * 0.012)
    assert ErrorStatistics.of(spoilt).nmad_m == pytest.approx(ErrorStatistics.of(errors).nmad_m, abs=0.02)


def test_equal_errors_have_no_shape() -> None:
    s = ErrorStatistics.of([0.2, 0.2])
    assert (s.std_m, s.nmad_m) == (0.0, 0.0)
    assert np.isnan([s.skewness, s.kurtosis]).all()


def test_nan_is_never_counted_silently() -> None:
    with pytest.raises(InputError, match="1 of 2 errors"):
        ErrorStatistics.of([0.0, np.nan])
    with pytest.raises(InputError, match="0 of 0 errors"):
        ErrorStatistics.of([])


def test_another_tools_figures_come_out(real_data: Path) -> None:
    """demcompare computed these from the same raster, in single precision and to five decimals."""
    folder = real_data / "stats_demcompare_srtm" / "gironde_global"
    with (folder / "stats_results.csv").open() as file:
        theirs = next(csv.DictReader(file))
    with rasterio.open(folder / "dem_for_stats.tif") as source:
        errors = source.read(1, masked=True).astype(np.float64).compressed()
    s = ErrorStatistics.of(errors[np.isfinite(errors)])
    assert s.n == int(theirs["nbpts"])
    for ours, name in (
        (s.bias_m, "mean"),
        (s.median_m, "median"),
        (s.rmse_m, "rmse"),
        (s.std_m, "std"),
        (s.nmad_m, "nmad"),
        (s.worst_m, "max"),
    ):
        # Sums of 10 000 single-precision numbers: 1e-5 relative.
        assert ours == pytest.approx(float(theirs[name]), rel=1e-5, abs=1e-5)


def test_the_standards_worked_example_comes_out(real_data: Path) -> None:
    example = json.loads((real_data / "stats_asprs_nssda_examples" / "examples.json").read_text())
    case = example["asprs_2014_annexD_5pt"]
    for axis, name in enumerate(("residual_x", "residual_y", "residual_z")):
        s = ErrorStatistics.of(case[name])
        # Printed to the millimetre.
        assert s.bias_m == pytest.approx(case["published"]["mean"][axis], abs=5.1e-4)
        assert s.rmse_m == pytest.approx(case["published"]["rmse"][axis], abs=5.1e-4)
        # Their standard deviation divides by n − 1.
        assert s.std_m * (5 / 4) ** 0.5 == pytest.approx(case["published"]["std"][axis], abs=5.1e-4)


def test_calibration_counts_errors_within_the_intervals() -> None:
    """±0.6745 σ is the 50 % interval and ±1.96 σ the 95 % one."""
    c = Calibration.of([0.0, 0.67, -0.68, 1.95, -1.97], np.ones(5), levels=(0.5, 0.95))
    assert c.levels == (0.5, 0.95)
    assert c.shares == (0.4, 0.8)
    assert c.coverage_95 == 0.8
    assert c.n == 5


@pytest.mark.parametrize(("claim", "honest"), [(1.0, True), (0.5, False), (2.0, False)])
def test_an_honest_claim_lies_on_the_diagonal(claim: float, honest: bool) -> None:
    rng = np.random.default_rng(4)
    sigma = rng.uniform(0.1, 2.0, 20_000)
    c = Calibration.of(sigma * rng.normal(size=20_000), claim * sigma)
    # A share of 20 000 has a standard error of 0.0035 at most.
    on_the_diagonal = bool(np.abs(np.array(c.shares) - c.levels).max() < 4 * 0.0035)
    assert on_the_diagonal is honest
    # z_rms scatters by 1 / sqrt(2 n) = 0.005.
    assert c.z_rms == pytest.approx(1.0 / claim, rel=4 * 0.005)


def test_certainty_is_right_only_without_error() -> None:
    assert Calibration.of([0.0, 0.0], [0.0, 0.0]).coverage_95 == 1.0
    wrong = Calibration.of([0.0, 0.1], [0.0, 0.0])
    assert wrong.coverage_95 == 0.5
    assert wrong.z_rms == np.inf


def test_deviations_that_are_not_stated_do_not_count() -> None:
    assert Calibration.of([0.0, 9.0], [1.0, np.nan]).n == 1
    silent = Calibration.of([0.0], [np.nan])
    assert silent.n == 0
    assert np.isnan([*silent.shares, silent.coverage_95, silent.z_rms]).all()
    with pytest.raises(InputError, match="negative"):
        Calibration.of([0.0], [-1.0])


@pytest.mark.paper
def test_the_papers_tables_are_a_sixth_of_the_interval() -> None:
    rows = map_classes("asprs-1990-as-in-paper")
    assert len(rows) == 9
    assert all(row.limit_m == pytest.approx(row.interval_m / 6.0, rel=1e-12) for row in rows)
    assert (rows[0].map_class, rows[0].limit_m) == ("Class 3", 0.4572)


@pytest.mark.paper
def test_the_papers_limits_are_the_spot_heights_of_1990_at_intervals_divided_by_the_class() -> None:
    real = {
        (row.map_class, round(row.interval_m, 4)): row.limit_m
        for row in map_classes("asprs-1990-spot-heights")
    }
    for row in map_classes():
        interval_m = round(row.interval_m / int(row.map_class[-1]), 4)
        assert row.limit_m == pytest.approx(real[row.map_class, interval_m], rel=1e-12)


def test_contours_are_twice_as_loose_as_spot_heights() -> None:
    for spot, contour in zip(
        map_classes("asprs-1990-spot-heights"), map_classes("asprs-1990-contours"), strict=True
    ):
        assert contour.limit_m == pytest.approx(2.0 * spot.limit_m, rel=1e-12)


def test_a_verdict_says_what_it_compares() -> None:
    verdict = judge(0.4572)[0]
    assert verdict.met
    assert "whole surface" in verdict.note
    assert "spot heights" in verdict.note
    assert not judge(0.4573)[0].met
    assert all(v.met for v in judge(0.05))


def test_refusals() -> None:
    with pytest.raises(ConfigError, match="asprs-1990-as-in-paper"):
        map_classes("nmas")
    with pytest.raises(InputError, match="RMSE"):
        judge(float("nan"))
