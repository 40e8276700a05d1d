"""A table shows its decimal mark and its separator of thousands; numbers of which it does not are refused."""

from pathlib import Path

import numpy as np
import pytest

from survey import InputError
from survey.io.point_files import read_named_points, read_point_table

HEADER = "Point;Easting;Northing;Elevation\n"


def table(folder: Path, text: str, encoding: str = "utf-8") -> Path:
    (folder / "points.csv").write_bytes(text.encode(encoding))
    return folder / "points.csv"


@pytest.mark.parametrize(
    "text",
    [
        HEADER + "A;2'600'123.25;1'200'456.5;1'234.5\nB;2'600'001.0;1'200'002.0;812.0\n",
        HEADER + "A;2’600’123.25;1’200’456.5;1’234.5\nB;2’600’001.0;1’200’002.0;812.0\n",
        HEADER + "A;2,600,123.25;1,200,456.5;1,234.5\nB;2,600,001;1,200,002;812\n",
        HEADER + "A;2.600.123,25;1.200.456,5;1.234,5\nB;2.600.001;1.200.002;812\n",
        HEADER + "A;2 600 123,25;1 200 456,5;1 234,5\nB;2 600 001;1 200 002;812\n",
        HEADER + "A;2\u202f600\u202f123,25;1\u202f200\u202f456,5;1\u202f234,5\nB;2600001;1200002;812\n",
        "Point,Easting,Northing,Elevation\n"
        'A,"2,600,123.25","1,200,456.5","1,234.5"\nB,"2,600,001","1,200,002",812\n',
        "Easting,Northing,Elevation\n2600123.25,1200456.5,1'234.5\n2600001,1200002,812\n",
        'Easting,Northing,Elevation\n2600123.25,1200456.5,"1,234.5"\n2600001,1200002,812\n',
    ],
)
def test_thousands_with_separators_are_read(text: str, tmp_path: Path) -> None:
    columns = read_point_table(table(tmp_path, text)).columns
    np.testing.assert_array_equal(columns["x_m"], [2_600_123.25, 2_600_001.0])
    np.testing.assert_array_equal(columns["y_m"], [1_200_456.5, 1_200_002.0])
    np.testing.assert_array_equal(columns["z_m"], [1234.5, 812.0])


def test_a_single_group_counts_as_the_table_writes_its_numbers(tmp_path: Path) -> None:
    thousands = HEADER + "A;2,600,123;1,200,456;1,234\n"
    assert read_point_table(table(tmp_path, thousands)).columns["z_m"] == [1234.0]
    decimals = HEADER + "A;600123,5;200456,5;1,234\n"
    assert read_point_table(table(tmp_path, decimals)).columns["z_m"] == [1.234]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (HEADER + "A;600123,5;200456,5;1.234\n", r"'1\.234' .* no number \(the table has decimal commas\)"),
        (HEADER + "A;2,600,123.5;1.200.456,5;812\n", "no number"),
        (HEADER + "A;2,600,123.5;200,456.5;812,5\n", r"'812,5' .* no number"),
        (
            'Point,Easting,Northing,Elevation\nA,600123.5,200456.5,"1,234"\n',
            "without a separator of thousands",
        ),
        (HEADER + "A;600123.5;200456.5;12'34.5\n", "no number"),
    ],
)
def test_a_number_with_a_mark_that_could_be_another_is_refused(text: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=f"line 2: .*{words}"):
        read_point_table(table(tmp_path, text))


@pytest.mark.parametrize(
    "text",
    [
        "Name,Latitude,Longitude,Ellipsoidal height\nA,46°30'12.5\"N,7°15'0\"W,812.5\n",
        'Name,Latitude,Longitude,Ellipsoidal height\nA,"46°30\'12.5""N","7°15\'0""W",812.5\n',
        "Name;Latitude;Longitude;Ellipsoidal height\nA;N 46 30 12,5;W 7 15 0,0;812,5\n",
        "Name\tLatitude\tLongitude\tEllipsoidal height\nA\t46 30 12.5\t-7 15 0\t812.5\n",
    ],
)
def test_degrees_with_minutes_and_seconds_are_read(text: str, tmp_path: Path) -> None:
    north = 46.0 + 30.0 / 60.0 + 12.5 / 3600.0
    found = read_point_table(table(tmp_path, text)).columns
    named = read_named_points(table(tmp_path, text), "the points").table.columns
    for columns in (found, named):
        np.testing.assert_allclose(columns["x_m"], [-7.25], rtol=1e-12)
        np.testing.assert_allclose(columns["y_m"], [north], rtol=1e-12)
        np.testing.assert_array_equal(columns["z_m"], [812.5])


def test_an_angle_that_could_be_another_one_is_refused_with_the_remedy(tmp_path: Path) -> None:
    text = "Name,Latitude,Longitude,Ellipsoidal height\nA,46°75'12.5\"N,7°15'0\"E,812.5\n"
    with pytest.raises(InputError, match=r"line 2: '46°75.* is no angle; write decimal degrees, or such as"):
        read_point_table(table(tmp_path, text))


def test_no_angle_is_read_from_a_column_of_metres(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="in the column Easting is no number"):
        read_point_table(table(tmp_path, HEADER + "A;46 30 12.5;200456.5;812.5\n"))
