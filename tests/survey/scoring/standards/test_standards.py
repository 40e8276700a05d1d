"""Standards as data, their arithmetic to the last printed digit, and verdicts that know when to be silent."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.accuracy_examples import examples, paper_tables, stored_examples
from survey.core.errors import ConfigError, InputError
from survey.scoring.standards.assessment import NOT_ASSESSED, Assessment, score_at
from survey.scoring.standards.checkpoint_errors import CheckpointErrors, RmseInterval, Spread, datum_cautions
from survey.scoring.standards.standards import (
    STANDARDS,
    accuracy_r,
    accuracy_z,
    rmse_3d,
    rmse_h,
    rmse_v,
    standard_named,
)

EVEN = Spread((0.25, 0.25, 0.25, 0.25), 0.12, 360_000.0)


def errors_of(values: np.ndarray | list[float], sigma: float = 0.01, **more: object) -> CheckpointErrors:
    e = np.asarray(values, dtype=float)
    names = tuple(f"P{k}" for k in range(len(e)))
    found = CheckpointErrors(e, np.full(len(e), sigma), np.zeros(len(e), dtype=bool), names, EVEN)
    return replace(found, **more)  # type: ignore[arg-type]


def balanced(n: int, size: float) -> np.ndarray:
    """Errors of one size and both signs: RMSE is the size."""
    return size * np.where(np.arange(n) % 2 == 0, 1.0, -1.0)


def first(errors: CheckpointErrors, standard: str, **asked: float) -> Assessment:
    return score_at(errors, (standard,), **asked).assessments[0]


def test_worked_examples_come_out_to_all_printed_digits() -> None:
    missed = [example for example in examples() if not example.holds]
    assert not missed


@pytest.mark.paper
def test_the_papers_tables_come_out() -> None:
    assert [example for example in paper_tables() if not example.holds] == []


def test_stored_examples_and_another_tools_figures_come_out(real_data: Path) -> None:
    assert [example for example in stored_examples(real_data) if not example.holds] == []


def test_29_checkpoints_are_not_assessed_where_30_are_asked() -> None:
    few, enough = (first(errors_of(balanced(n, 0.05)), "asprs-edition-2", class_m=0.10) for n in (29, 30))
    assert few.outcome == NOT_ASSESSED
    assert few.missing == ("30 checkpoints on open ground (there are 29)",)
    assert few.value == pytest.approx(enough.value, rel=1e-12)
    assert "29 checkpoints" in few.sentence
    assert "not assessed to the standard" in few.sentence
    assert (enough.outcome, enough.missing) == ("met", ())


def test_edition_2_counts_the_checkpoints_own_error() -> None:
    """W11: 1 cm of fit and 2 cm of survey are 2.236 cm, which meets 3 cm, but the checkpoints are too coarse for it."""
    finding = first(errors_of(balanced(30, 0.01), sigma=0.02), "asprs-edition-2", class_m=0.03)
    assert finding.value == pytest.approx(0.02236, abs=5e-6)
    assert finding.outcome == NOT_ASSESSED
    assert "2 times better" in finding.missing[0]
    # Of a class twice as coarse as the checkpoints they are just good enough.
    assert first(errors_of(balanced(30, 0.01), sigma=0.02), "asprs-edition-2", class_m=0.04).outcome == "met"


def test_2014_asks_for_three_times_better_checkpoints_and_judges_at_95_percent() -> None:
    good = errors_of(balanced(20, 0.05), sigma=0.03)
    finding = first(good, "asprs-2014", class_m=0.10)
    assert finding.value == pytest.approx(1.96 * 0.05, rel=1e-12)
    assert (finding.limit, finding.outcome) == (pytest.approx(0.196), "met")
    assert (
        first(replace(good, sigma_z_m=np.full(20, 0.034)), "asprs-2014", class_m=0.10).outcome == NOT_ASSESSED
    )
    assert first(errors_of(balanced(20, 0.11)), "asprs-2014", class_m=0.10).outcome == "not met"


def test_vegetated_ground_is_judged_apart() -> None:
    values = np.r_[balanced(30, 0.05), balanced(30, 0.25)]
    mixed = errors_of(values, vegetated=np.arange(60) >= 30)
    open_, green = score_at(mixed, ("asprs-edition-2",), class_m=0.10).assessments
    assert (open_.outcome, green.outcome) == ("met", "reported")
    open_, green = score_at(mixed, ("asprs-2014",), class_m=0.10).assessments
    # 0.25 m is within three times the class, though not within 1.96 times.
    assert (open_.outcome, green.outcome, green.limit) == ("met", "met", pytest.approx(0.30))
    with pytest.raises(InputError, match="vegetated"):
        score_at(errors_of(balanced(30, 0.1), vegetated=np.ones(30, dtype=bool)))


def test_nssda_states_and_never_passes() -> None:
    finding = first(errors_of(balanced(20, 0.0815)), "nssda-1998")
    assert finding.value == pytest.approx(0.160, abs=5e-4)
    assert (finding.outcome, finding.limit) == ("reported", None)
    clumped = errors_of(balanced(20, 0.08), spread=Spread((0.1, 0.3, 0.3, 0.3), 0.05, 1e6))
    finding = first(clumped, "nssda-1998")
    assert (finding.outcome, finding.missing) == ("reported", ())
    quarters, spacing = finding.cautions[-2:]
    assert "guidance: 20% of the checkpoints in every quarter" in quarters
    assert "guidance: 10% of the diagonal" in spacing


def test_nmas_counts_points() -> None:
    """2 of 20 points beyond half the interval are 10 %, which is allowed; 3 are not."""
    for n_off, outcome in ((2, "met"), (3, "not met")):
        values = np.r_[np.full(n_off, 0.6), np.zeros(20 - n_off)]
        finding = first(errors_of(values), "nmas-1947", interval_m=1.0)
        assert (finding.value, finding.outcome) == (pytest.approx(n_off / 20), outcome)
        assert any("horizontal shift" in caution for caution in finding.cautions)


def test_1990_limits_grow_with_the_class() -> None:
    spot = score_at(
        errors_of(balanced(20, 0.06)), ("asprs-1990-spot-heights",), interval_m=0.3048
    ).assessments
    assert [f.outcome for f in spot] == ["not met", "met", "met"]
    assert [f.limit for f in spot] == [pytest.approx(k * 0.0508) for k in (1, 2, 3)]
    assert not any("unverified" in caution for caution in spot[0].cautions)
    contours = score_at(
        errors_of(balanced(20, 0.06)), ("asprs-1990-contours",), interval_m=0.3048
    ).assessments
    assert contours[0].outcome == "met"
    coarse = first(errors_of(balanced(20, 0.01), sigma=0.02), "asprs-1990-contours", interval_m=0.3048)
    assert "a twentieth" in coarse.missing[0]
    few = first(errors_of(balanced(19, 0.01)), "asprs-1990-contours", interval_m=0.3048)
    assert few.missing == ("20 checkpoints on any ground (there are 19) (unverified)",)
    # Without an interval, 1, 2 and 3 ft in three classes.
    assert len(score_at(errors_of(balanced(20, 0.06)), ("asprs-1990-contours",)).assessments) == 9


def test_blunders_and_bias_are_stated_and_included() -> None:
    """W11: 16 cm in a 5 cm class is a blunder, 15 cm is the limit."""
    values = balanced(30, 0.01)
    values[4] = 0.16
    finding = first(errors_of(values), "asprs-edition-2", class_m=0.05)
    assert any("P4" in caution and "investigate" in caution for caution in finding.cautions)
    assert finding.n == 30
    biased = first(errors_of(np.full(30, 0.02)), "asprs-edition-2", class_m=0.05)
    assert any("mean error" in caution for caution in biased.cautions)
    silent = first(errors_of(values, without_datum=("the checkpoints",)), "asprs-edition-2", class_m=0.05)
    assert any("vertical datum" in caution for caution in silent.cautions)


def test_without_a_class_the_value_is_reported() -> None:
    assert first(errors_of(balanced(30, 0.05)), "asprs-edition-2").outcome == "reported"


def test_horizontal_arithmetic() -> None:
    assert accuracy_r(0.59, 1.0) is None
    assert accuracy_r(1.0, 1.0) == pytest.approx(1.7308 * 2**0.5, rel=1e-4)
    assert rmse_h(4.0, 3.0, 1.0) == pytest.approx(27**0.5, rel=1e-12)
    assert rmse_3d(rmse_h(0.03, 0.04, 0.0), rmse_v(0.12, 0.0)) == pytest.approx(0.13, rel=1e-12)
    with pytest.raises(InputError, match="RMSE_z"):
        accuracy_z(float("nan"))


def test_intervals_hold_the_true_rmse() -> None:
    """95 % of intervals of 20 normal errors hold it; 400 trials scatter by 1.1 %."""
    rng = np.random.default_rng(8)
    found = [RmseInterval.of(rng.normal(0.0, 0.3, 20)) for _ in range(400)]
    chi2 = [i for i in found if i.method == "chi-square"]
    # Where the mean differs from 0 by chance, the bootstrap takes over: one in twenty.
    assert len(chi2) > 360
    held = np.mean([i.low_m <= 0.3 <= i.high_m for i in chi2])
    assert abs(held - 0.95) < 0.03
    biased = RmseInterval.of(rng.normal(1.0, 0.1, 50))
    assert biased.method == "bootstrap"
    # The spread of the RMSE of a biased sample is that of its mean: 0.1 / sqrt(50) = 0.014.
    assert 0.9 < biased.low_m < 1.0 < biased.high_m + 0.05
    assert biased.high_m - biased.low_m < 4 * 0.02


def test_every_standard_names_its_edition_and_unknown_ones_are_refused() -> None:
    assert {"asprs-1990-contours", "nmas-1947", "nssda-1998", "asprs-2014", "asprs-edition-2"} <= set(
        STANDARDS
    )
    assert "Version 2 (2024)" in standard_named("asprs-edition-2").edition
    with pytest.raises(ConfigError, match="nmas-1947"):
        standard_named("asprs-2020")
    with pytest.raises(InputError, match="class"):
        score_at(errors_of(balanced(30, 0.1)), class_m=0.0)


def test_a_checkpoint_that_errs_far_more_than_all_others_is_named_and_counted() -> None:
    values = np.linspace(-0.1, 0.1, 30)
    assert not any("blunders" in caution for caution in datum_cautions(errors_of(values)))
    values[7] = -100.0
    found = datum_cautions(errors_of(values))
    assert found[-1].startswith("1 of 30 checkpoints err by more than 10 times as much as most others")
    assert "P7 (-100.00 m)" in found[-1] or "7 (-100.00 m)" in found[-1]


def test_checkpoints_in_feet_are_named_as_such() -> None:
    height = np.linspace(780.0, 820.0, 12)
    xyz = np.column_stack([height, height, height / 0.3048])
    feet = errors_of(height - height / 0.3048, xyz=xyz)
    assert datum_cautions(feet) == [
        "the heights of the checkpoints are 3.28 times those of the map, as feet are; convert them to metres"
    ]
    metres = errors_of(np.zeros(12), xyz=np.column_stack([height, height, height]))
    assert not any("feet" in caution for caution in datum_cautions(metres))
