"""Stored tables and figures: their writer, their states, and the page that is made of them."""

import json
from functools import cache
from pathlib import Path

import pytest

from benchmarks import stored, writer
from benchmarks.report import Row, main
from benchmarks.results_page import filled, pages
from benchmarks.stored import CHANGED, FRESH, IN_PARTS, UNKNOWN, Stored, every_stored
from benchmarks.stored_parts import stored as stored_part
from papers.code_closure import code_of_today
from papers.provenance import CodeState
from papers.studies import ABOUT, STUDIES
from survey.core.documents import read_record

OF = "benchmarks.volume_intervals:measure"
FOUND_BY_ANOTHER_PROCESS = CodeState.by_another_process


@pytest.fixture
def results(monkeypatch, tmp_path):
    """Return a folder of stored tables in the place of the results; the state of the code is found once."""
    monkeypatch.setattr(writer, "_RUNS", [])
    monkeypatch.setattr(CodeState, "by_another_process", code_state)
    monkeypatch.setattr("benchmarks.report.TABLES", tmp_path)
    return tmp_path


@cache
def code_state(function):
    return FOUND_BY_ANOTHER_PROCESS(function)


def measure(_quick):
    yield Row.of("height", 1.0, "m", "<=", 2.0)


def test_a_run_stores_its_provenance_and_a_json_file_holds_it_too(results):
    main("Small", measure, (), ["--json", str(results / "own.json")])
    table = json.loads((results / "small.json").read_text())
    assert set(table) == {"machine", "rows", "provenance"}
    facts = table["provenance"]
    assert facts["source"] == "measured"
    assert facts["of"].endswith("test_stored:measure")
    assert len(facts["code"]) == 16
    assert {"commit", "has_changes", "machine", "python", "cpu_s", "wall_s", "date", "quick"} <= set(facts)
    assert json.loads((results / "own.json").read_text())["rows"] == table["rows"]


def test_a_quick_run_is_named_so_and_stores_no_table(results):
    main("Small", measure, (), ["--quick", "--json", str(results / "own.json")])
    assert json.loads((results / "own.json").read_text())["provenance"]["quick"]
    assert not (results / "small.json").exists()


def test_a_remark_stays_and_says_for_which_run_it_was_written(results):
    old = {"machine": {}, "rows": [], "provenance": {"commit": "abc"}, "remark": ["One run."]}
    (results / "small.json").write_text(json.dumps(old))
    for _ in range(2):
        main("Small", measure, (), [])
        table = json.loads((results / "small.json").read_text())
        assert (table["remark"], table["remark_of"]) == (["One run."], "abc")
    del table["remark_of"]
    (results / "small.json").write_text(json.dumps(table))
    main("Small", measure, (), [])
    assert "remark_of" not in json.loads((results / "small.json").read_text())


def test_a_long_run_says_beforehand_what_it_takes(results, capsys):
    (results / "small.json").write_text(
        json.dumps({"provenance": {"cpu_s": 1000.0, "earlier_cpu_s": 2000.0}})
    )
    main("Small", measure, (), ["--quick"])
    assert "minutes of CPU" not in capsys.readouterr().err
    main("Small", measure, (), [])
    assert "takes about 50 minutes of CPU" in capsys.readouterr().err


def test_a_table_whose_time_is_not_known_is_made_without_a_word(results, capsys):
    (results / "small.json").write_text(json.dumps({"provenance": {"cpu_s": None}}))
    main("Small", measure, (), [])
    assert "minutes of CPU" not in capsys.readouterr().err


def test_parts_of_earlier_runs_are_counted_with_their_code_and_time(results):
    run = writer.Run.begin(measure, results / "small.json")
    (results / "a.json").write_text("1")
    (results / "a.provenance").write_text(json.dumps({"code": "old", "cpu_s": 7.0}))
    (results / "b.json").write_text("2")
    assert [stored_part(results / f"{name}.json", lambda: 3) for name in "abca"] == [1, 2, 3, 1]
    run.write({"rows": []})
    facts = json.loads((results / "small.json").read_text())["provenance"]
    assert facts["parts"] == {"old": 1, "": 1, facts["code"]: 1}
    assert facts["earlier_cpu_s"] == 7.0


@pytest.mark.parametrize(
    ("facts", "state"),
    [
        ({}, UNKNOWN),
        ({"code": None}, UNKNOWN),
        ({"code": "other"}, CHANGED),
        ({"code": "today"}, FRESH),
        ({"code": "today", "parts": {"today": 3}}, FRESH),
        ({"code": "today", "parts": {"today": 3, "": 1}}, IN_PARTS),
    ],
)
def test_a_table_is_fresh_where_all_of_its_code_is_todays(tmp_path, facts, state):
    today = code_of_today().digest(OF)
    file = tmp_path / "t.json"
    file.write_text(json.dumps({"rows": [], "provenance": facts}).replace('"today"', f'"{today}"'))
    assert Stored("t", file, OF, "", "").state == state


def test_the_function_of_everything_that_is_stored_is_there():
    assert [one.name for one in every_stored() if not code_of_today().has(one.of)] == []
    assert set(ABOUT) == set(STUDIES)


def test_everything_that_is_stored_has_a_state():
    states = json.loads(stored.CHECKED.read_text(encoding="utf-8"))["states"]
    missing = [one.name for one in every_stored() if one.name not in states]
    assert missing == [], "`make results` writes the states and the page again"


def test_the_pages_of_results_are_those_that_the_stored_files_ask_for():
    for file, text in pages().items():
        assert file.read_text(encoding="utf-8") == text, "`make results` writes the page again"


def test_the_tables_of_the_papers_end_within_120_lines():
    lines = (stored.RESULTS / "README.md").read_text(encoding="utf-8").splitlines()
    assert lines.index("## Known misses") <= 120


def test_values_of_tables_are_put_into_texts():
    said = filled("{emap-table1/table.csv|Raw|OctoMap 0.10 m|paper|.1f}")
    assert said == "74.6"
    with pytest.raises(SystemExit, match="0 values, not one"):
        filled("{emap-table1/table.csv|Raw|none|paper|.1f}")


@pytest.mark.parametrize(
    "folder", sorted(stored.RESULTS.glob("*/made.json")), ids=lambda file: file.parent.name
)
def test_the_files_of_a_stored_study_are_all_kept(folder):
    assert read_record(folder.parent)


def test_the_listed_folders_are_those_of_studies():
    folders = {path.parent.name for path in Path(stored.RESULTS).glob("*/made.json")}
    assert folders <= set(STUDIES)
