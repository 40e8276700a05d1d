"""``firnline reproduce all``: every study in turn, continued after a kill."""

import json

import pytest
from typer.testing import CliRunner

from firnline.cli.main import app
from papers import studies

CHEAP = ("glacier-tables", "carving-fig3")


@pytest.fixture
def two_studies(monkeypatch, tmp_path):
    monkeypatch.setattr(studies, "STUDIES", {name: studies.STUDIES[name] for name in CHEAP})
    return tmp_path


def reproduced(out, *options):
    result = CliRunner().invoke(app, ["reproduce", "all", "-q", "-o", str(out), *options])
    return result.exit_code, result.stdout, result.stderr


def test_complete_studies_are_not_made_again(two_studies):
    out = two_studies
    code, printed, _ = reproduced(out, "--quick")
    assert code == 0
    assert "2 of 2 studies to make" in printed
    made = json.loads((out / "glacier-tables" / "made.json").read_text())
    assert made["quick"]
    assert set(made["files_sha256"]) == {"map_classes.csv"}
    assert "0 of 2" in reproduced(out, "--quick")[1]
    assert "2 of 2" in reproduced(out, "--quick", "--force")[1]
    assert sorted(path.name for path in out.iterdir()) == sorted(CHEAP)


def test_a_study_that_was_stopped_continues_in_its_draft(two_studies):
    out = two_studies
    (out / "carving-fig3.unfinished-quick").mkdir()
    (out / "carving-fig3.unfinished-quick" / "kernel.csv").write_text("half")
    code, printed, _ = reproduced(out, "--quick")
    assert code == 0
    assert "2/2 carving-fig3" in printed
    assert (out / "carving-fig3" / "kernel.csv").read_text() != "half"
    assert not (out / "carving-fig3.unfinished-quick").exists()


def test_quick_and_changed_studies_are_replaced_with_force_only(two_studies):
    out = two_studies
    reproduced(out, "--quick")
    code, printed, err = reproduced(out)
    assert (code, "2 of 2" in printed, err.count("exists; choose another name or add --force")) == (
        3,
        True,
        2,
    )
    assert "0 of 2" in reproduced(out, "--quick")[1]
    (out / "glacier-tables" / "map_classes.csv").write_text("changed by hand")
    assert "1 of 2" in reproduced(out, "--quick")[1]
    assert (out / "glacier-tables" / "map_classes.csv").read_text() == "changed by hand"
    assert reproduced(out, "--quick", "--force")[0] == 0


def test_files_of_others_stay_in_a_study(two_studies):
    (two_studies / "glacier-tables").mkdir()
    (two_studies / "glacier-tables" / "thesis.doc").write_text("mine")
    code, _, err = reproduced(two_studies, "--quick", "--force")
    assert code == 3
    assert "thesis.doc" in err
    assert (two_studies / "glacier-tables" / "thesis.doc").read_text() == "mine"


def test_a_study_that_is_refused_does_not_stop_the_others(two_studies):
    (two_studies / "glacier-tables").write_text("a file")
    code, _, err = reproduced(two_studies, "--quick")
    assert code == 3
    assert "refused" in err
    assert (two_studies / "carving-fig3" / "made.json").exists()
