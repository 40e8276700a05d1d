"""An ASCII grid is read as it stands, or refused: nothing in it counts as 0."""

from pathlib import Path

import numpy as np
import pytest

from survey import Dem, InputError

HEADER = "ncols 3\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 10\nNODATA_value -9999\n"


def grid(folder: Path, rows: str, header: str = HEADER) -> Path:
    (folder / "a.asc").write_text(header + rows)
    return folder / "a.asc"


def heights(path: Path) -> np.ndarray:
    return Dem.read(path, crs="EPSG:32608").elevation


def test_numbers_in_any_spelling_are_read(tmp_path: Path) -> None:
    expected = [[1.0, 2.5, np.nan], [-4.0, 500.0, 6.0]]
    path = grid(tmp_path, "1 +2.5 -9999\n-4 5e2\t6.\n")
    np.testing.assert_array_equal(heights(path), expected)


def test_rows_may_be_wrapped_and_the_last_line_break_may_lack(tmp_path: Path) -> None:
    np.testing.assert_array_equal(heights(grid(tmp_path, "1 2\n3 4\n5\n6")), [[1, 2, 3], [4, 5, 6]])


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ("1 2 abc\n4 5 6\n", "'abc' is no number"),
        ("1 2 3\n4 5\n", "5 numbers where"),
        ("1 2 3\n4 5 6 7\n", "7 numbers where"),
        ("1 2\n3 4 5 6\n", "row 1: 2 numbers"),
        ("1,5 2 3\n4 5 6\n", "'1,5' is no number"),
        ("1 2 3\n4 5 6x\n", "'6x' is no number"),
        ("1 2 1.#QNAN\n4 5 6\n", "no number"),
        ("1 2 -\n4 5 6\n", "no number"),
        ("", "0 numbers where"),
    ],
)
def test_what_is_no_number_or_lacks_is_named(rows: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=words):
        heights(grid(tmp_path, rows))


@pytest.mark.parametrize(
    ("header", "words"),
    [
        (HEADER.replace("ncols 3", "ncols x"), "'x' is no number"),
        (HEADER.replace("ncols 3\n", ""), "ncols nan"),
        (HEADER + "cellsize 20\n", "'cellsize 20'"),
        (HEADER + "colour 20\n", "'colour 20'"),
        (HEADER.replace("ncols 3", "ncols 3.5"), "whole number"),
    ],
)
def test_a_wrong_header_is_named(header: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=words):
        heights(grid(tmp_path, "1 2 3\n4 5 6\n", header))


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (HEADER + "1 2 nan\n4 5 6\n", "line 7: it holds nan or inf"),
        (HEADER.replace("xllcorner", "xllcenter") + "1 2 3\n4 5 6\n", "xllcenter, yllcorner; xllcorner and"),
        (HEADER.replace("yllcorner 0\n", "") + "1 2 3\n4 5 6\n", "xllcorner and yllcorner"),
    ],
)
def test_what_gdal_would_read_as_zero_is_refused(tmp_path: Path, text: str, reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        heights(grid(tmp_path, "", text))
