"""Accuracy and change reports from the command line, as folder, HTML and PDF."""

import json
from html.parser import HTMLParser
from pathlib import Path

import pytest
from typer.testing import CliRunner

from firnline.cli.main import app
from tests.docs.scratch import make_scratch

CHECKPOINTS = ("score", "map.tif", "--checkpoints", "gnss.csv", "--class", "0.10", "--datum", "EGM96 height")


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("reports")
    make_scratch(folder)
    return folder


@pytest.fixture(autouse=True)
def _there(files: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(files)


def output_of(*args: str, code: int = 0) -> str:
    done = CliRunner().invoke(app, list(args))
    assert done.exit_code == code, done.output
    return done.stdout if code == 0 else done.stderr


class Links(HTMLParser):
    """Targets of links and images of a page, and its heading levels."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.targets: list[str] = []
        self.without_alt = 0
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        self.targets += [str(values[key]) for key in ("href", "src") if key in values]
        self.without_alt += tag == "img" and not values.get("alt")


def test_a_report_of_checkpoints_is_a_folder_with_page_pdf_figures_and_tables() -> None:
    said = output_of(*CHECKPOINTS, "--report", "folder", "--language", "de", "--by", "slope")
    assert "report written to folder/index.html" in said
    page = Path("folder/index.html").read_text(encoding="utf-8")
    for words in (
        "tested to meet ASPRS Positional Accuracy Standards for Digital Geospatial Data, Edition 2, Version 2 (2024)",
        'lang="de"', "der englische Wortlaut der Norm", "36 checkpoints", "doi:10.1016/j.isprsjprs.2009.02.003",
        "It is no condition of a statement", "Signature / Unterschrift", "Errors by class: slope", "Horizontal accuracy was not tested",
    ):  # fmt: skip
        assert words in page
    links = Links(page)
    assert links.without_alt == 0
    beside = [target for target in links.targets if not target.startswith("data:")]
    assert "tables/residuals.csv" in beside
    assert all(Path("folder", target).is_file() for target in beside)
    rows = Path("folder/tables/residuals.csv").read_text(encoding="utf-8").splitlines()
    assert (len(rows), rows[0].startswith("Checkpoint,Ground,Easting [m]")) == (37, True)
    assert Path("folder/report.pdf").read_bytes().startswith(b"%PDF")


def test_a_single_page_holds_everything_and_equal_input_gives_equal_bytes() -> None:
    output_of(*CHECKPOINTS, "--standard", "nssda-1998", "--report", "one.html")
    page = Path("one.html").read_text(encoding="utf-8")
    assert "Tested 0.091 meters vertical accuracy at 95% confidence level." in page
    assert all(target.startswith("data:") for target in Links(page).targets)
    assert "one.html exists" in output_of(*CHECKPOINTS, "--report", "one.html", code=3)
    output_of(*CHECKPOINTS, "--standard", "nssda-1998", "--report", "one.html", "--force")
    assert Path("one.html").read_text(encoding="utf-8") == page


def test_a_pdf_of_checkpoints_has_its_pages() -> None:
    output_of(*CHECKPOINTS, "--report", "accuracy.pdf", "--json")
    assert Path("accuracy.pdf").read_bytes().count(b"/Type /Page\n") in (0, 3)


def test_a_report_against_a_reference_makes_no_statement_of_a_standard() -> None:
    said = output_of(
        "score", "map.tif", "--truth", "lidar.tif", "--by", "slope", "--by", "cover.gpkg", "--report", "truth.html"
    )  # fmt: skip
    assert "cover" in said
    page = Path("truth.html").read_text(encoding="utf-8")
    assert "tested to meet" not in page
    assert "no statement of a standard is made" in page
    assert "Errors within 1.96 σ" in page


def test_classes_are_printed_and_given_as_json() -> None:
    said = output_of("score", "map.tif", "--truth", "lidar.tif", "--by", "slope")
    assert "0 to 5°" in said
    found = json.loads(output_of("score", "map.tif", "--truth", "lidar.tif", "--by", "cover.gpkg", "--json"))
    ice, rock = found["classes"]["cover"]
    assert (ice["name"], rock["name"]) == ("ice", "rock")
    assert ice["n"] + rock["n"] == found["elevation"]["n"]
    assert ice["coverage_95"] == pytest.approx(0.95, abs=0.02)


def test_a_change_report_states_volume_mass_assumptions_and_sources() -> None:
    args = ("change", "2026.tif", "2024.tif", "--outline", "glacier.gpkg", "-o", "change", "--force")
    assert "report written to change.html" in output_of(*args, "--report", "change.html")
    page = Path("change.html").read_text(encoding="utf-8")
    for words in (
        "North glacier: volume change",
        "850 ± 60 kg/m³",
        "Huss, M. (2013)",
        "Tested by",
        "Rolstad",
    ):
        assert words in page
    output_of(*args, "--report", "change-report.pdf")
    assert Path("change-report.pdf").read_bytes().startswith(b"%PDF")


@pytest.mark.parametrize(
    ("args", "code", "words"),
    [
        (("--report", "a.docx"), 4, "a folder or a file that ends in .html or .pdf"),
        (("--report", "r.pdf", "--language", "xx"), 4, "one of en, de"),
        (("--by", "missing.gpkg"), 3, "missing.gpkg"),
        (("--report", "map.tif"), 4, "ends in .html or .pdf"),
    ],
)
def test_reports_that_cannot_be_made_are_refused_before_any_work(
    args: tuple[str, ...], code: int, words: str
) -> None:
    assert words in output_of(*CHECKPOINTS, *args, code=code)


def test_of_the_classes_of_1990_the_tightest_that_is_met_is_stated() -> None:
    args = ("score", "map.tif", "--checkpoints", "gnss.csv", "--interval", "0.5", "--report", "old.html")
    output_of(*args, "--standard", "asprs-1990-contours")
    page = Path("old.html").read_text(encoding="utf-8")
    assert "conform to the ASPRS standard for Class 1, interval 0.5 m" in page
    assert "conform to the ASPRS standard for Class 2" not in page


def test_a_mission_takes_no_options_of_maps() -> None:
    Path("m.toml").write_text("schema_version = 1\n")
    assert "whose page firnline report writes" in output_of("score", "m.toml", "--report", "x.pdf", code=3)
