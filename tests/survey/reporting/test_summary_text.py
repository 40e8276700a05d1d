"""Sentences say what the numbers say."""

import math
from dataclasses import replace

import pytest

from survey.reporting.page import calibration_sentence, conditions, score_rows, verdict_sentence
from survey.reporting.quantities import (
    named_values,
    number,
    percent,
    setting,
)
from survey.scoring import Calibration
from survey.scoring.standards.map_classes import judge


@pytest.mark.parametrize(
    ("coverage", "ratio", "opening"),
    [
        (0.95, 1.0, "The claimed uncertainty is well calibrated:"),
        (0.93, 1.2, "The claimed uncertainty is well calibrated:"),
        (0.50, 3.6, "The claimed uncertainty is too small"),
        (0.999, 0.5, "The claimed uncertainty is too large"),
        (0.95, 2.0, "The claimed uncertainty is well calibrated except for a few far larger errors"),
        (0.985, 1.4, "The claimed uncertainty is well calibrated except for a few far larger errors"),
    ],
)
def test_the_sentence_fits_the_calibration(coverage, ratio, opening):
    sentence = calibration_sentence(Calibration((0.95,), (coverage,), coverage, ratio))
    assert sentence.startswith(opening)
    assert f"{100 * coverage:.1f}%" in sentence


def test_a_map_without_deviations_makes_no_claim():
    nothing = Calibration.of([0.1], [math.nan])
    assert "no claim to judge" in calibration_sentence(nothing)


def test_a_missed_class_is_said_plainly():
    sentence = verdict_sentence(judge(0.9)).replace("\u00a0", " ")
    assert "does not meet Class 3" in sentence
    assert "its RMSE is 0.900 m, the limit 0.457 m." in sentence
    assert "tightest" not in sentence


def test_the_tightest_class_met_is_the_last_of_them():
    sentence = verdict_sentence(judge(0.01)).replace("\u00a0", " ")
    assert sentence.endswith("it meets is 0.051 m (Class 1, interval 0.305 m).")


def test_silent_nodes_are_stated_with_the_verdict(scored):
    assert len(conditions(scored)) == 2
    half = replace(scored, n_silent=scored.elevation.n)
    assert conditions(half)[1].startswith("The map gives a height on 50.0% of the area")


def test_every_score_is_explained(scored):
    rows = [row for group in score_rows(scored).values() for row in group]
    assert all(row.value and row.meaning for row in rows)
    assert {"RMSE", "NMAD", "Science-centric coverage (SCC)", "Distributedness β"} <= {
        row.name for row in rows
    }


def test_numbers_that_do_not_exist_are_dashes():
    assert number(None, "m") == percent(None) == number(math.nan) == percent(math.nan) == "–"
    assert number(math.inf) == "∞"


def test_negative_and_large_numbers_are_typeset():
    assert number(-12345.678, "m", 1) == "\u221212\u202f345.7\u00a0m"


def test_units_come_from_the_names():
    rows = named_values(
        {"heading_error_deg": 1.5, "share_tracked": 0.5, "end_per_cent": 0.4, "n_frames": 12000}
    )
    assert [row[:2] for row in rows] == [
        ("Heading error", "1.500\u00a0°"),
        ("Share tracked", "0.500"),
        ("End", "0.400\u00a0%"),
        ("Frames", "12\u202f000"),
    ]


def test_settings_are_short():
    assert setting([1.23456789, 2.0]) == "1.23457, 2"
    assert setting("matern-5/2") == "matern-5/2"
