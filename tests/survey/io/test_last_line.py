"""A table whose last line has no line break is read where nothing of it can be missing."""

from pathlib import Path

import numpy as np
import pytest

from survey import InputError
from survey.io.point_files import read_point_table

PLAIN = "x_m,y_m,z_m,sigma_z_m\n" + "".join(f"{k}.5,2{k}.25,81{k}.125,0.0{k}5\n" for k in range(1, 7))
EXPORT = "Point;Easting;Northing;Elevation\r\n" + "".join(
    f"P{k};50{k},25;60{k},5;81{k},125\r\n" for k in range(1, 7)
)
CODES = "Easting,Northing,Elevation,Solution status\n" + "".join(
    f"50{k}.25,60{k}.5,81{k}.125,{'FIX' if k % 2 else 'FLOAT'}\n" for k in range(1, 7)
)
QUOTED = '"Easting","Northing","Elevation"\n' + "".join(
    f'"50{k}.25","60{k}.5","81{k}.{5**k}"\n' for k in range(1, 3)
)
ENDINGS = "Easting,Northing,Elevation,Status\n" + "".join(
    f"50{k}.25,60{k}.5,81{k}.125,{'FIX' if k % 2 else 'FIXED'}\n" for k in range(1, 8)
)
UNEVEN = "x_m,y_m,z_m\n" + "".join(f"{k}.5,2{k}.25,81{k}.{k}\n" for k in range(1, 6)) + "7,2,813.25\n"
WHOLE = "x_m,y_m,z_m\n" + "".join(f"{k}.5,2{k}.25,81{k}\n" for k in range(1, 6))
SHORT = "x_m,y_m,z_m\n1.0,2.0,811.25\n2.0,1.0,812.25\n3.0,3.0,813.25\n"
BLANKS = "x y z\n" + "".join(f"{k}.5 2{k}.25 81{k}.125\n" for k in range(1, 7))


def read(folder: Path, content: bytes) -> dict[str, np.ndarray]:
    (folder / "a.csv").write_bytes(content)
    return read_point_table(folder / "a.csv").columns


@pytest.mark.parametrize("text", [PLAIN, EXPORT, CODES, QUOTED, BLANKS])
def test_a_whole_table_is_read_without_its_last_line_break(text: str, tmp_path: Path) -> None:
    whole = read(tmp_path, text.encode())
    found = read(tmp_path, text.rstrip("\r\n").encode())
    assert list(found) == list(whole)
    for name, column in whole.items():
        np.testing.assert_array_equal(found[name], column)


@pytest.mark.parametrize("text", [ENDINGS, UNEVEN, WHOLE, SHORT])
def test_a_table_whose_last_value_could_be_longer_is_refused(text: str, tmp_path: Path) -> None:
    read(tmp_path, text.encode())
    with pytest.raises(InputError, match=r"ends in the middle of a line; .* end it with a line break"):
        read(tmp_path, text.rstrip("\r\n").encode())


@pytest.mark.parametrize("text", [PLAIN, EXPORT, CODES, QUOTED, ENDINGS, UNEVEN, WHOLE, SHORT, BLANKS])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_no_part_of_a_table_is_read_as_another_value(text: str, encoding: str, tmp_path: Path) -> None:
    if encoding == "utf-16" and text.startswith("x_m"):
        pytest.skip("firnline's own tables are UTF-8")
    content = text.encode(encoding)
    whole = read(tmp_path, content)
    n_read = 0
    for end in range(len(content)):
        try:
            part = read(tmp_path, content[:end])
        except InputError:
            continue
        n_read += 1
        for name, column in part.items():
            np.testing.assert_array_equal(column, whole[name][: len(column)])
    assert n_read
