"""Pages from templates, and tables as CSV."""

import base64
import csv
import io
from pathlib import Path

import jinja2
import pytest
from hypothesis import given
from hypothesis import strategies as st

import survey.reporting
from survey.reporting.rendering import csv_source, render

TEMPLATES = sorted(
    path.name for path in (Path(survey.reporting.__file__).parent / "templates").glob("*.html.j2")
)


def cells(source: str) -> list[list[str]]:
    text = base64.b64decode(source.removeprefix("data:text/csv;base64,")).decode()
    return list(csv.reader(io.StringIO(text)))


@pytest.mark.parametrize("cell", ["=1+1", "@SUM(A1)", "+cmd", "-cmd"])
def test_a_formula_becomes_text(cell):
    assert cells(csv_source([[cell]]))[0][0][0] not in "=@+-"


def test_numbers_are_written_for_machines():
    assert cells(csv_source([["1\u202f234.5\u00a0m", "\u22120.25"]])) == [["1234.5 m", "-0.25"]]


@pytest.mark.property
@given(st.lists(st.text(alphabet="abc ,;\"'\n=3.", min_size=1, max_size=8), min_size=1, max_size=4))
def test_every_table_is_read_back_with_its_columns(row):
    (found,) = cells(csv_source([row]))
    assert len(found) == len(row)


def test_there_are_templates_and_a_missing_name_is_an_error():
    assert TEMPLATES
    with pytest.raises(jinja2.UndefinedError):
        render(TEMPLATES[0])
