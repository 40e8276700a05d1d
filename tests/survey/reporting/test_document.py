"""Documents: folder, page and PDF of statements, tables and figures."""

import csv
import io
import re

import pytest
from matplotlib.figure import Figure

from survey.core.errors import ConfigError
from survey.reporting.document import (
    Chapter,
    Document,
    DrawnFigure,
    Statement,
    Table,
    check_target,
    document_pages,
    html_page,
    write_document,
)
from tests.printing import assert_printable

TABLE = Table(
    "residuals", "Residuals", ("Point", "Residual [m]"), (("=P1", "\u22120.250"), ("P2", "0.100")), 1
)


def drawn(width_in=9.0):
    figure = Figure(figsize=(width_in, 2.0))
    figure.subplots().plot([0.0, 1.0], [0.0, 1.0])
    return DrawnFigure("line", figure, "A line", "A line that rises.")


@pytest.fixture
def document():
    chapter = Chapter(
        "Result <1>",
        statements=(Statement("Tested 0.1 meters vertical accuracy.", note="NSSDA"),),
        paragraphs=("A & B.",),
        tables=(TABLE,),
        figures=(drawn(),),
    )
    return Document("Accuracy report", "map.tif", "2026-11-23", (chapter,), ("Surveyor",))


def test_a_folder_holds_page_pdf_figures_and_tables(document, tmp_path):
    opened = write_document(tmp_path / "report", document)
    assert opened == tmp_path / "report" / "index.html"
    names = {str(p.relative_to(tmp_path / "report")) for p in (tmp_path / "report").rglob("*") if p.is_file()}
    assert names == {"index.html", "report.pdf", "figures/line.png", "tables/residuals.csv"}


@pytest.mark.parametrize("kind", ["pdf", "svg"])
def test_figures_are_written_in_the_chosen_format(document, tmp_path, kind):
    page = write_document(tmp_path / "report", document, kind).read_text(encoding="utf-8")
    assert (tmp_path / "report" / "figures" / f"line.{kind}").exists()
    assert f'href="figures/line.{kind}"' in page


def test_pages_can_be_printed(document):
    for page in document_pages(document):
        assert_printable(page, share=1.0)


@pytest.mark.parametrize("name", ["a.html", "a.pdf"])
def test_equal_documents_give_equal_bytes(document, tmp_path, name):
    (tmp_path / "again").mkdir()
    first, second = (write_document(folder / name, document) for folder in (tmp_path, tmp_path / "again"))
    assert first.read_bytes() == second.read_bytes()


def test_text_is_escaped_and_a_page_alone_loads_nothing(document):
    page = html_page(document)
    assert "Result &lt;1&gt;" in page
    assert "A &amp; B." in page
    sources = re.findall(r'<(?:img|script|source)[^>]* src(?:set)?="([^"]*)"', page)
    assert sources
    assert all(source.startswith("data:") for source in sources)


def test_formulas_in_text_columns_are_escaped_and_numbers_have_a_plain_minus():
    rows = list(csv.reader(io.StringIO(TABLE.csv)))
    assert rows[0] == list(TABLE.headings)
    assert rows[1][0] != "=P1"
    assert [row[1] for row in rows[1:]] == ["-0.250", "0.100"]


@pytest.mark.parametrize(("width_in", "is_wide"), [(9.0, True), (4.4, False)])
def test_wide_figures_take_the_page(width_in, is_wide):
    assert drawn(width_in).is_wide is is_wide


@pytest.mark.parametrize("name", ["report.docx", "report.html.zip"])
def test_another_ending_is_refused(name):
    with pytest.raises(ConfigError, match=f"cannot be written to {re.escape(name)}"):
        check_target(name)
