"""Names from files reach neither the terminal nor a spreadsheet as commands."""

import pytest

from survey.core.text import csv_cell, printable


@pytest.mark.parametrize(
    "name", ["\x1b[31mred", "a\nb", "a\rb", "\x9b2J", "a\u202eb", "\u2028", "\x00", "\x7f"]
)
def test_control_characters_are_escaped(name: str) -> None:
    shown = printable(name)
    assert shown.isprintable()
    assert shown != name


@pytest.mark.parametrize("name", ["north", "Größe 3 m²", "ледник", "氷河", "a b", "-"])
def test_ordinary_names_stay(name: str) -> None:
    assert printable(name) == name


@pytest.mark.parametrize("name", ["=1+2", "+1", "-1", "@SUM(A1)", "\t=1", "\r=1", "  =1"])
def test_formulas_are_texts_in_tables(name: str) -> None:
    assert csv_cell(name).startswith("'")


def test_names_with_signs_inside_stay_as_they_are_in_tables() -> None:
    assert csv_cell("lake-2 (a=b)") == "lake-2 (a=b)"
