"""A table is read as it stands, or the line that is wrong is named."""

from pathlib import Path

import numpy as np
import pytest

from survey import InputError
from survey.core.errors import CapacityError
from survey.io import tables
from survey.io.tables import read_table, write_table

HEADER = "x_m,y_m,z_m\n"


def table(folder: Path, text: str, encoding: str = "utf-8") -> Path:
    (folder / "a.csv").write_bytes(text.encode(encoding))
    return folder / "a.csv"


def test_numbers_come_back_exactly(tmp_path: Path) -> None:
    columns = {"x_m": np.array([0.1, 1e-300, -np.pi]), "n": np.array([1.0, 2.0, 3.0])}
    write_table(tmp_path / "a.csv", columns)
    back = read_table(tmp_path / "a.csv", ("x_m",), what="the table")
    assert list(back) == ["x_m", "n"]
    for name, values in columns.items():
        np.testing.assert_array_equal(back[name], values)


def test_a_byte_order_mark_and_quotes_are_understood(tmp_path: Path) -> None:
    file = table(tmp_path, '"x_m","y_m","z_m"\r\n"1","2","3"\r\n', "utf-8-sig")
    assert read_table(file, ("x_m",), what="the table")["z_m"] == [3.0]


def test_empty_lines_are_skipped_and_counted(tmp_path: Path) -> None:
    file = table(tmp_path, HEADER + "1,2,3\n\n4,5,6\n\n")
    assert read_table(file, ("x_m",), what="the table")["z_m"].tolist() == [3.0, 6.0]
    with pytest.raises(InputError, match="line 4: 'b' in the column z_m"):
        read_table(table(tmp_path, HEADER + "1,2,3\n\n4,5,b\n"), ("x_m",), what="the table")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x_m,y_m,z_m,z_m\n1,2,3,4\n", "names the column 'z_m' 2 times"),
        ("x_m, y_m ,z_m,y_m\n1,2,3,4\n", "names the column 'y_m' 2 times"),
        (HEADER + "1,2,3\n1,2\n", "line 3: 2 values"),
        (HEADER + "1,2,3,4\n", "line 2: 4 values"),
        (HEADER + "1,2,3\n4,5,abc\n", "line 3: 'abc' in the column z_m"),
        (HEADER + "1,2,\n", "line 2: '' in the column z_m"),
        (HEADER + "1,2,1_000\n", "'1_000' in the column z_m"),
        (HEADER + '1,2,"3,5"\n', "'3,5' in the column z_m"),
        ("x_m;y_m;z_m\n1,5;2;3\n", "lacks the column 'x_m'"),
        (HEADER + "1,2,3", "middle of a line"),
        (HEADER, "no rows"),
        (HEADER + '1,2,"3\n', "no text table"),
        ("x_m,\x1b[2J\n1,2\n", r"lacks the column 'y_m' \(found x_m, \\x1b\[2J\)"),
    ],
)
def test_what_is_wrong_is_named(text: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=words):
        read_table(table(tmp_path, text), ("x_m", "y_m", "z_m"), what="the table")


def test_text_that_is_no_utf_8_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no text table"):
        read_table(table(tmp_path, HEADER + "1,2,é\n", "latin-1"), ("x_m",), what="the table")


def test_too_many_rows_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tables, "LARGEST_ROWS", 2)
    with pytest.raises(CapacityError, match="more than 2 rows"):
        read_table(table(tmp_path, HEADER + "1,2,3\n" * 3), ("x_m",), what="the table")
