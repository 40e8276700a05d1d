"""Large tables of plain numbers are read by Arrow, as the careful reader reads them."""

import numpy as np
import pytest

from survey import InputError, SurfacePoints
from survey.io import tables
from survey.io.tables import plain_columns, read_table

N = 200


@pytest.fixture(autouse=True)
def any_size(monkeypatch):
    monkeypatch.setattr(tables, "_LEAST_BYTES", 1)


def table_of(separator, rng, line_break="\n"):
    values = np.column_stack([rng.uniform(0.0, 1e6, (N, 3)), rng.uniform(0.01, 1.0, N)])
    values[0] = [0.1, 5e-324, -1.7976931348623157e308, 1e22]
    rows = [separator.join(map(repr, row)) for row in values.tolist()]
    return line_break.join([separator.join(("x", "y", "z", "w")), *rows, ""]), values


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("line_break", ["\n", "\r\n"])
@pytest.mark.parametrize("start", [b"", b"\xef\xbb\xbf"])
def test_plain_columns_are_exact(tmp_path, rng, separator, line_break, start):
    text, values = table_of(separator, rng, line_break)
    (tmp_path / "a.csv").write_bytes(start + text.encode())
    found = plain_columns(tmp_path / "a.csv")
    assert list(found) == ["x", "y", "z", "w"]
    np.testing.assert_array_equal(np.column_stack(list(found.values())), values)


@pytest.mark.parametrize(
    "body",
    [
        "1,2,3\n4,5\n", "1,2,3\n4,,6\n", "1,2,3\n4,5,6", "1,2,x\n", "1,2,1.234.567\n", '1,2,"3"\n', "1,2,1_000\n",
        "1,2,nan\n", "1,2,-\n", "1, 2,3\n", "1,2,3,\n", "1,2,3\r4,5,6\n", "",
    ],
)  # fmt: skip
def test_tables_that_are_not_plain_are_left_to_the_careful_reader(tmp_path, body):
    (tmp_path / "a.csv").write_text("x,y,z\n" + body, newline="")
    assert plain_columns(tmp_path / "a.csv") is None


@pytest.mark.parametrize(
    "header", ["1,2,3", "x,x,z", "x,y,", '"x",y,z', "# x,y,z", "sep=,", "x y z", "x;y,z"]
)
def test_headers_that_are_not_plain_are_left_to_the_careful_reader(tmp_path, header):
    (tmp_path / "a.csv").write_text(header + "\n4,5,6\n")
    assert plain_columns(tmp_path / "a.csv") is None


@pytest.mark.parametrize(
    "names", ["x,y,z,sigma", "Easting,Northing,Elevation,Sigma", "x_m,y_m,z_m,sigma_z_m"]
)
def test_both_readers_give_the_same_points(tmp_path, rng, monkeypatch, names):
    values = np.column_stack([rng.uniform(0.0, 1e3, (N, 3)), rng.uniform(0.01, 1.0, N)])
    values[7] = values[3]  # is left out as a repeat
    rows = "\n".join(",".join(map(repr, row)) for row in values.tolist())
    (tmp_path / "a.csv").write_text(f"{names}\n{rows}\n")
    short = SurfacePoints.read(tmp_path / "a.csv", crs="EPSG:32608")
    monkeypatch.setattr(tables, "_LEAST_BYTES", 10**9)
    careful = SurfacePoints.read(tmp_path / "a.csv", crs="EPSG:32608")
    assert len(short.xyz) == N - 1
    np.testing.assert_array_equal(short.xyz, careful.xyz)
    np.testing.assert_array_equal(short.sigma_z, careful.sigma_z)


def test_a_missing_column_of_a_plain_table_is_named(tmp_path, rng):
    (tmp_path / "a.csv").write_text(table_of(",", rng)[0])
    with pytest.raises(InputError, match="lacks the column 'time_s'"):
        read_table(tmp_path / "a.csv", ["time_s"], what="the table")


def test_points_of_equal_scrambled_bits_are_compared(tmp_path):
    rows = [[0.0, 1.0, 2.0], [-0.0, 1.0, 2.0], [0.0, 1.0, 3.0], [0.0, 1.0, 2.0]]
    text = "x,y,z\n" + "\n".join(",".join(map(repr, row)) for row in rows) + "\n"
    (tmp_path / "a.csv").write_text(text)
    found = SurfacePoints.read(tmp_path / "a.csv", crs="EPSG:32608", sigma_m=0.1)
    np.testing.assert_array_equal(found.xyz, [[0.0, 1.0, 2.0], [0.0, 1.0, 3.0]])
