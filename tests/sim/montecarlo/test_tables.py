"""Tables of trials: names are escaped for spreadsheets, and values read back as they were."""

from dataclasses import fields
from pathlib import Path

import pyarrow.parquet as pq

from sim.montecarlo.config import Trial, TrialBlock
from sim.montecarlo.results import write_block, write_rows, write_tables

DEFAULTS = {str: "north", int: 2, float: -0.5}


def trial(terrain: str) -> Trial:
    values = {field.name: DEFAULTS[field.type] for field in fields(Trial)}  # type: ignore[index]
    return Trial(**{**values, "terrain": terrain})  # type: ignore[arg-type]


def test_only_the_csv_table_escapes_names(tmp_path: Path) -> None:
    block = TrialBlock(0, 0, 1)
    (tmp_path / "blocks").mkdir()
    write_block(tmp_path, block, [trial("=1+2")])
    write_tables(tmp_path, tmp_path, [block])
    row = (tmp_path / "trials.csv").read_text().splitlines()[1]
    assert row.startswith('"\'=1+2",2,"north"')
    assert ",-0.5," in row
    assert pq.read_table(tmp_path / "trials.parquet")["terrain"].to_pylist() == ["=1+2"]


def test_summaries_escape_names(tmp_path: Path) -> None:
    write_rows(tmp_path / "a.csv", [{"terrain": "@SUM(A1)", "rmse_m": -0.5, "wanted": None}])
    assert (tmp_path / "a.csv").read_text() == "terrain,rmse_m,wanted\n'@SUM(A1),-0.5,\n"
