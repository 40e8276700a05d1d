"""``firnline reproduce all``: every study in turn, gone on with after a kill, whatever was refused on the way."""

import json

import pytest
from typer.testing import CliRunner

from sim import studies
from sim.cli.main import app

CHEAP = ("glacier-tables", "carving-fig3")


@pytest.fixture
def two_studies(monkeypatch, tmp_path):
    monkeypatch.setattr(studies, "STUDIES", {name: studies.STUDIES[name] for name in CHEAP})
    return tmp_path


def reproduced(out, *options):
    result = CliRunner().invoke(app, ["reproduce", "all", "-q", "-o", str(out), *options])
    return result.exit_code, result.stdout, result.stderr


def test_what_stands_whole_is_not_made_again(two_studies):
    out = two_studies
    code, told, _ = reproduced(out, "--quick")
    assert code == 0
    assert "2 of 2 studies to make" in told
    made = json.loads((out / "glacier-tables" / "made.json").read_text())
    assert made["quick"]
    assert set(made["files_sha256"]) == {"map_classes.csv"}
    # Killed while it made the second, which has left something behind.
    (out / "carving-fig3" / "made.json").unlink()
    (out / "carving-fig3" / "kernel.csv").write_text("half")
    code, told, _ = reproduced(out, "--quick")
    assert code == 0
    assert "1 of 2 studies to make" in told
    assert "1/1 carving-fig3" in told
    assert (out / "carving-fig3" / "kernel.csv").read_text() != "half"
    assert "0 of 2" in reproduced(out, "--quick")[1]
    assert "2 of 2" in reproduced(out, "--quick", "--fresh")[1]


def test_quick_studies_and_changed_ones_do_not_stand(two_studies):
    out = two_studies
    reproduced(out, "--quick")
    assert "2 of 2" in reproduced(out)[1]
    assert "0 of 2" in reproduced(out, "--quick")[1]
    (out / "glacier-tables" / "map_classes.csv").write_text("changed by hand")
    assert "1 of 2" in reproduced(out)[1]


def test_a_study_that_is_refused_keeps_no_other_from_being_made(two_studies):
    # A folder stands where the table is to be written.
    (two_studies / "glacier-tables" / "map_classes.csv").mkdir(parents=True)
    code, _, err = reproduced(two_studies, "--quick")
    assert code == 3
    assert "refused" in err
    assert (two_studies / "carving-fig3" / "made.json").exists()
