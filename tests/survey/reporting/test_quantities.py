"""Numbers with their units as text."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from survey.reporting.quantities import MINUS, named_values, number, percent, setting


@pytest.mark.parametrize(
    ("value", "unit", "decimals", "text"),
    [
        (1234.5, "m", 1, "1\u202f234.5\u00a0m"),
        (-0.25, "m", 2, f"{MINUS}0.25\u00a0m"),
        (3.0, "", 0, "3"),
        (None, "m", 3, "–"),
        (math.nan, "m", 3, "–"),
        (math.inf, "m", 3, "∞"),
    ],
)
def test_a_number_has_thin_spaces_a_minus_sign_and_its_unit(value, unit, decimals, text):
    assert number(value, unit, decimals) == text


@pytest.mark.property
@given(value=st.floats(-1e9, 1e9), decimals=st.integers(0, 6))
def test_a_number_is_the_value_rounded(value, decimals):
    text = number(value, decimals=decimals).replace("\u202f", "").replace(MINUS, "-")
    # Neighbouring numbers of double precision may lie farther apart than the margin.
    margin = 0.5 * 10.0**-decimals * (1 + 1e-6) + math.ulp(value)
    assert float(text) == pytest.approx(value, rel=0.0, abs=margin)


def test_a_share_is_a_percentage_and_an_unknown_one_a_dash():
    assert (percent(0.5), percent(None), percent(math.nan)) == ("50.0%", "–", "–")


@pytest.mark.parametrize(
    ("key", "value", "name", "text"),
    [
        ("ate_rmse_m", 0.5, "ATE RMSE", "0.500\u00a0m"),
        ("length_m", 1234.0, "Length", "1\u202f234\u00a0m"),
        ("n_fixes", 12.0, "Fixes", "12"),
        ("yaw_deg", 1.5, "Yaw", "1.500\u00a0°"),
        ("drift_per_cent", 0.4, "Drift", "0.400\u00a0%"),
        ("ratio", 2.0, "Ratio", "2.000"),
    ],
)
def test_names_with_units_become_rows(key, value, name, text):
    (row,) = named_values({key: value})
    assert (row.name, row.value) == (name, text)


def test_settings_are_written_with_six_digits():
    assert setting([0.123456789, "auto", 3]) == "0.123457, auto, 3"
