"""A large plain table is read at once, and every table gives the numbers or the refusal that a look at each cell gives."""

import logging
from pathlib import Path

import numpy as np
import pytest

from survey import InputError, SurfacePoints
from survey.io import plain_columns
from survey.io.point_files import read_named_points, read_point_table
from survey.io.tables import read_table

OWN = "x_m,y_m,z_m\n1.5,2.25,811.125\n-3e2,+.5,812.\n7,8.0,1E3\n"
EXPORT = "Point;Easting;Northing;Elevation;SDV\n007;501.5;601;811.5;0.02\n008;502;602.25;812;0.03\n"
TEXTS = "Point,Easting,Northing,Elevation,Code\nA1,501.5,601,811,GRD\nA2,502, 602.5 ,812,ICE 2\n"
COMMAS = EXPORT.replace(".", ",")
BLANKS = "  1.5   2.5 811.5 \n2.5  3.5   812.5\n10.25 4 813\n"
DEGREES = "lon;lat;height;Mark\n8,5;46,5;2000;a\n8,25;46,25;2001;b\n"
PLAIN = [OWN, EXPORT, TEXTS, COMMAS, DEGREES, EXPORT.replace(";", "\t"), "# made by hand\n" + EXPORT]
CAREFUL = [
    OWN.replace("2.25", "1_0"), OWN.replace("2.25", ""), OWN.replace("2.25", "abc"), OWN.replace("2.25", '"2.25"'),
    OWN.replace("2.25", "2.25,9"), OWN.replace("-3e2,", ""), OWN.rstrip("\n"), OWN + "\n\n", OWN.replace("\n", "\n\n"),
    OWN + "4,5", OWN.replace("2.25", "1.234.567"), OWN.replace("2.25", "nan(2)"), OWN.replace("2.25", "nan"),
    OWN.replace("2.25", "1e400"), OWN.replace("2.25", "-"), OWN.replace("2.25", "0x10"), OWN + ",,\n",
    OWN.replace("\n", "\r"), OWN.replace("\n", "\r\n"), "\ufeff" + OWN, OWN + "1,2\x0b,3\n", OWN + "1,2,\u0663\n",
    EXPORT.replace("601;", "1,234;"), EXPORT.replace("601;", "1'234.5;"), EXPORT.replace("601;", "1 234.5;"),
    EXPORT.replace("601;", "1,234,567;"), EXPORT.replace("601;", "1.234.567;"), EXPORT.replace("601;", "x;"),
    EXPORT.replace("0.02\n", "0.02;\n"), EXPORT.replace("007", "1,5"), EXPORT.replace("007", "1.234.567"),
    COMMAS.replace("601;", "1.234,5;"), COMMAS.replace("601;", "1.234;"), COMMAS.replace("601;", "1,2,3;"),
    TEXTS.replace("ICE 2", '"1,234.5"'), TEXTS.replace("ICE 2", "1.234.567"), TEXTS.replace("ICE 2", "Gebüsch"),
    TEXTS.replace("GRD", ""), TEXTS.replace("601", ""), TEXTS.replace("\nA2", ",\nA2"), TEXTS + "A3,1,2\n",
    DEGREES.replace("46,5", "46°30'"), DEGREES.replace("Mark", "NS").replace(";a", ";S").replace(";b", ";N"),
    "2\n" + EXPORT, EXPORT.replace("Point", '"Point"'), 'x y z\n"1" 5 6 7\n"2" 8 9 10\n', "lon;lat;height\n8;46 30 5,5;9\n",
]  # fmt: skip


def outcome(read, file: Path, caplog: pytest.LogCaptureFixture) -> object:
    """Return all that a reader gives, says and refuses."""
    caplog.clear()
    try:
        found = read(file)
    except InputError as error:
        return str(error)
    names = found.names if hasattr(found, "names") else ()
    table = getattr(found, "table", found)
    columns = {name: column.tobytes() for name, column in getattr(table, "columns", table).items()}
    return names, columns, list(columns), caplog.messages


READERS = {
    "points": read_point_table,
    "columns": lambda file: read_point_table(file, {"x_m": "2", "y_m": "3", "z_m": "4"}),
    "names": lambda file: read_named_points(file, "the marks"),
    "own": lambda file: read_table(file, (), what="the table"),
}


@pytest.mark.parametrize("ending", [".csv", ".xyz"])
@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("text", [*PLAIN, *CAREFUL, BLANKS, "Point E N H\n" + BLANKS.replace("\n", " A\n")])
def test_both_ways_give_the_same(text, reader, ending, tmp_path, monkeypatch, caplog) -> None:
    caplog.set_level(logging.INFO)
    file = tmp_path / f"a{ending}"
    for encoding in ("utf-8", "cp1252", "utf-16"):
        file.write_bytes(text.encode(encoding, errors="replace"))
        monkeypatch.setattr(plain_columns, "LEAST_BYTES", 10**9)
        careful = outcome(READERS[reader], file, caplog)
        monkeypatch.setattr(plain_columns, "LEAST_BYTES", 0)
        assert outcome(READERS[reader], file, caplog) == careful


@pytest.mark.parametrize(("text", "ending"), [*((text, ".csv") for text in PLAIN), (BLANKS, ".xyz")])
def test_plain_tables_are_read_at_once(text, ending, tmp_path, monkeypatch) -> None:
    def refuse(*_: object) -> None:
        raise AssertionError("looked at every cell")

    monkeypatch.setattr(plain_columns, "LEAST_BYTES", 0)
    file = tmp_path / f"a{ending}"
    file.write_text(text)
    expected = read_point_table(file).columns
    file.write_text(text + 40_000 * (text.splitlines()[-1] + "\n"))
    monkeypatch.setattr("survey.io.tables._parts", refuse)
    monkeypatch.setattr("survey.io.text_tables._HEAD_BYTES", len(text) + 8)
    monkeypatch.setattr(
        "survey.io.text_tables._check_rows", lambda rows, *_: refuse() if len(rows) > 9 else None
    )
    for name, column in read_point_table(file).columns.items():
        assert column.flags.writeable
        assert len(column) == 40_000 + len(expected[name])
        np.testing.assert_array_equal(column[: len(expected[name])], expected[name])


def test_numbers_of_random_bits_come_back_exactly(tmp_path, monkeypatch, rng) -> None:
    monkeypatch.setattr(plain_columns, "LEAST_BYTES", 0)
    bits = rng.integers(0, 2**64, (500, 3), dtype=np.uint64).view(np.float64)
    values = np.where(np.isfinite(bits), bits, 1.0)
    (tmp_path / "a.csv").write_text(
        "a,b,c\n" + "".join(",".join(map(repr, row)) + "\n" for row in values.tolist())
    )
    found = read_table(tmp_path / "a.csv", (), what="the table")
    np.testing.assert_array_equal(np.column_stack(list(found.values())), values)


def test_blocks_of_a_table_are_joined(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(plain_columns, "LEAST_BYTES", 0)
    monkeypatch.setattr("survey.io.tables._BYTES_AT_ONCE", 5)
    (tmp_path / "a.csv").write_text(OWN)
    assert read_table(tmp_path / "a.csv", (), what="the table")["z_m"].tolist() == [811.125, 812.0, 1000.0]


@pytest.mark.parametrize("name", ["sigma", "Sigma [m]", "sigma_m", "σ"])
def test_a_column_of_sigma_without_a_direction_is_that_of_heights(name, tmp_path) -> None:
    (tmp_path / "a.csv").write_text(f"x,y,z,{name}\n1,2,3,0.25\n4,5,6,0.5\n")
    assert read_point_table(tmp_path / "a.csv").columns["sigma_z_m"].tolist() == [0.25, 0.5]
    (tmp_path / "a.csv").write_text(f"x,y,z,{name},sdv\n1,2,3,0.25,1\n4,5,6,0.5,2\n")
    assert read_point_table(tmp_path / "a.csv").columns["sigma_z_m"].tolist() == [1.0, 2.0]


def test_points_of_equal_scrambled_bits_are_compared(tmp_path) -> None:
    rows = [[0.0, 1.0, 2.0], [-0.0, 1.0, 2.0], [0.0, 1.0, 3.0], [0.0, 1.0, 2.0]]
    text = "x,y,z\n" + "".join(",".join(map(repr, row)) + "\n" for row in rows)
    (tmp_path / "a.csv").write_text(text)
    found = SurfacePoints.read(tmp_path / "a.csv", crs="EPSG:32608", sigma_m=0.1)
    np.testing.assert_array_equal(found.xyz, [[0.0, 1.0, 2.0], [0.0, 1.0, 3.0]])
