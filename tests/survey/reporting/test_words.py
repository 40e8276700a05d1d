"""Sentences say what the numbers say."""

import math

import pytest

from survey.reporting.words import calibration_sentence, named_values, number, percent, setting
from survey.scoring import Calibration


@pytest.mark.parametrize(
    ("coverage", "ratio", "opening"),
    [
        (0.95, 1.0, "The claimed uncertainty is honest:"),
        (0.93, 1.2, "The claimed uncertainty is honest:"),
        (0.50, 3.6, "The claimed uncertainty is too small"),
        (0.999, 0.5, "The claimed uncertainty is too large"),
        (0.95, 2.0, "The claimed uncertainty is honest for most of the map, but a few errors"),
        (0.985, 1.4, "The claimed uncertainty is honest for most of the map, but a few errors"),
    ],
)
def test_the_sentence_fits_the_calibration(coverage, ratio, opening):
    sentence = calibration_sentence(Calibration((0.95,), (coverage,), coverage, ratio))
    assert sentence.startswith(opening)
    assert f"{100 * coverage:.1f}%" in sentence


def test_numbers_that_do_not_exist_are_dashes():
    assert number(None, "m") == percent(None) == number(math.nan) == percent(math.nan) == "–"


def test_negative_and_large_numbers_are_typeset():
    assert number(-12345.678, "m", 1) == "\u221212\u202f345.7 m"


def test_units_come_from_the_names():
    rows = named_values({"heading_error_deg": 1.5, "share_tracked": 0.5, "n_frames": 12000})
    assert [row[:2] for row in rows] == [
        ("Heading error", "1.500 °"),
        ("Share tracked", "0.500"),
        ("Frames", "12\u202f000"),
    ]


def test_settings_are_short():
    assert setting([1.23456789, 2.0]) == "1.23457, 2"
    assert setting("matern52") == "matern52"
