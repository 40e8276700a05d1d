"""Columns of GNSS exports are found by their usual names or by a mapping, and stated."""

import logging
from pathlib import Path

import numpy as np
import pytest

from survey import ConfigError, InputError
from survey.io.column_names import parse_columns
from survey.io.point_files import read_named_points
from survey.scoring import Checkpoints

UTM = "EPSG:32608"
EXPORT = "Point,Easting,Northing,Elevation,SDH,SDV,Code\nA1,500100.25,6700200.5,812.125,0.011,0.018,ICE\nA2,500200,6700300,815,0.012,0.02,ROCK\n"


def write(folder: Path, text: str, name: str = "gnss.csv", encoding: str = "utf-8") -> Path:
    (folder / name).write_text(text, encoding=encoding)
    return folder / name


def test_a_gnss_export_is_read_and_its_columns_are_stated(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING):
        points = Checkpoints.read(write(tmp_path, EXPORT), crs=UTM)
    np.testing.assert_array_equal(points.xyz[0], [500_100.25, 6_700_200.5, 812.125])
    assert points.names == ("A1", "A2")
    assert points.sigma_z_m.tolist() == [0.018, 0.02]
    assert (
        "columns read as x_m = Easting, y_m = Northing, z_m = Elevation, name = Point, sigma_z_m = SDV; not used: SDH, Code."
        in caplog.text
    )


@pytest.mark.parametrize(
    ("header", "row"),
    [
        ("Point;Easting;Northing;Elevation;SDV", "A;500100,25;6700200,5;812,125;0,018"),
        ("Point;Easting;Northing;Elevation;SDV;", "A;500100.25;6700200.5;812.125;0.018;"),
        ("Point\tEasting\tNorthing\tElevation\tSDV", "A\t500100,25\t6700200,5\t812,125\t0,018"),
        ("Punkt;Rechtswert;Hochwert;Höhe;SDV [mm]", "A;500100,25;6700200,5;812,125;18"),
        (
            "Point ID,Easting (m),Northing (m),Elevation (m),Vert Prec",
            "A,500100.25,6700200.5,812.125,0.018",
        ),
    ],
)
@pytest.mark.parametrize("encoding", ["utf-8-sig", "cp1252"])
def test_separators_decimal_commas_units_and_encodings_are_found(
    tmp_path: Path, header: str, row: str, encoding: str
) -> None:
    path = write(tmp_path, f"{header}\n{row}\n", "gnss.txt", encoding)
    points = Checkpoints.read(path, crs=UTM)
    np.testing.assert_array_equal(points.xyz, [[500_100.25, 6_700_200.5, 812.125]])
    assert (points.names, points.sigma_z_m) == (("A",), pytest.approx(0.018))


def test_a_mapping_chooses_columns_that_have_other_names(tmp_path: Path) -> None:
    path = write(tmp_path, "id,a,b,ortho,ellip,s\n7,500100,6700200,812,840,0.02\n")
    mapping = parse_columns(["x=a,y=b,z=ortho", "sigma_z=s"])
    points = Checkpoints.read(path, crs=UTM, columns=mapping)
    assert points.xyz.tolist() == [[500_100.0, 6_700_200.0, 812.0]]
    assert points.names == ("7",)


def test_a_mapping_settles_two_columns_of_heights(tmp_path: Path) -> None:
    path = write(tmp_path, "Easting,Northing,Elevation,Ellipsoidal height\n1,2,3,4\n")
    with pytest.raises(InputError, match=r"either could be the height.*--columns z="):
        read_named_points(path, "the checkpoints")
    found = read_named_points(path, "the checkpoints", {"z_m": "Ellipsoidal height"})
    assert found.table.columns["z_m"].tolist() == [4.0]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("Point,Easting,Northing,Elevation,SDH\nA,1,2,3,0.01\n", "states no uncertainty of the checkpoints' heights.*sigma_z=NAME"),
        ("Easting,Northing,Elevation,SDV,VRMS\n1,2,3,0.1,0.1\n", "SDV and VRMS, and either could be meant"),
        ("Easting (ft),Northing (ft),Elevation (ft)\n1,2,3\n", "its places in feet, and its CRS counts in metres; name the foot with --units"),
        ("1,500100,6700200,812\n2,500200,6700300,815\n", "no header line"),
        ("Easting;Northing;Elevation;SDV\n1,5;2.5;3;0,1\n", "line 2: '2.5' in the column Northing .*decimal commas"),
        ("Easting,Northing,Elevation,SDV\n1,2,x,0.1\n", "line 2: 'x' in the column Elevation is no number"),
        ("Easting,Northing,Elevation,SDV\n1,2,3\n", "line 2: 3 values where the header names 4"),
        ("Easting,Northing,Elevation,SDV\n1,2,3,0.1", "ends in the middle of a line"),
        ("Easting,Northing,Elevation,Easting\n1,2,3,0.1\n", "names the column 'Easting' 2 times"),
        ("", "is empty"),
    ],
)  # fmt: skip
def test_tables_that_are_ambiguous_or_damaged_are_refused_in_one_sentence(
    tmp_path: Path, text: str, words: str
) -> None:
    with pytest.raises(InputError, match=words):
        Checkpoints.read(write(tmp_path, text), crs=UTM)


@pytest.mark.parametrize("text", ["x:Easting", "w=Easting", "x=", "x=a,x=b", "x=a,y=a"])
def test_a_mapping_that_makes_no_sense_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match="column mapping"):
        parse_columns([text])


def test_a_mapping_to_a_column_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no column 'Ost' \(found Point, Easting"):
        Checkpoints.read(write(tmp_path, EXPORT), crs=UTM, columns={"x_m": "Ost"})


def test_a_horizontal_deviation_is_not_taken_for_that_of_the_height(tmp_path: Path) -> None:
    path = write(tmp_path, "Point,Easting,Northing,Elevation,SDH\nA,1,2,3,0.01\n")
    assert Checkpoints.read(path, crs=UTM, sigma_m=0.05).sigma_z_m.tolist() == [0.05]
    assert Checkpoints.read(path, crs=UTM, columns={"sigma_z_m": "SDH"}).sigma_z_m.tolist() == [0.01]
