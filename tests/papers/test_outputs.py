"""Tables of studies escape names, and write numbers as they are."""

from pathlib import Path

from papers.outputs import write_csv


def test_names_that_look_like_formulas_are_texts(tmp_path: Path) -> None:
    write_csv(tmp_path / "a.csv", ("name", "value"), [("=1+2", -0.5), ("a\x1bb", 3), ("north", float("nan"))])
    assert (tmp_path / "a.csv").read_text() == "name,value\n'=1+2,-0.5\na\\x1bb,3\nnorth,nan\n"
