"""Points in text tables: own tables are strict, exports of other programs are read by their usual names."""

import logging
from pathlib import Path

import pytest

from survey import SurfacePoints
from survey.core.errors import InputError
from survey.io.point_files import read_point_table

EXPORTS = {
    "degrees, semicolons, decimal commas": "Name;Breite;Länge;Höhe;SDV\nP1;46,4412;7,9061;912,5;0,02\n",
    "names and codes": "Point,Longitude,Latitude,Elevation,SDV,Code\nP1,7.9061,46.4412,912.5,0.02,ICE\n",
    "numbers alone": "Longitude,Latitude,Elevation,SDV [mm]\n7.9061,46.4412,912.5,20\n",
    "tabs": "Latitude\tLongitude\tHeight (m)\tVRMS (mm)\n46.4412\t7.9061\t912.5\t20\n",
}


def written(folder: Path, text: str) -> Path:
    (folder / "points.csv").write_text(text, encoding="utf-8")
    return folder / "points.csv"


@pytest.mark.parametrize("kind", EXPORTS)
def test_exports_are_points_with_their_standard_deviations(tmp_path: Path, kind: str) -> None:
    table = read_point_table(written(tmp_path, EXPORTS[kind]))
    assert [table.columns[name].tolist() for name in ("x_m", "y_m", "z_m")] == [[7.9061], [46.4412], [912.5]]
    assert table.columns["sigma_z_m"].tolist() == [0.02]
    assert table.crs.to_epsg() == 4326


def test_an_export_becomes_surface_points_and_the_log_names_its_columns(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING):
        points = SurfacePoints.read(written(tmp_path, EXPORTS["names and codes"]))
    assert points.crs.to_epsg() == 32632
    assert "sigma_z_m = SDV; not used: Point, Code" in caplog.text


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x_m,y_m,z_m,sigma_z_m\n1.0,2.0,3.0,bad\n", "'bad' in the column sigma_z_m is no number"),
        ("Easting;Northing;Elevation\n1,0;2,0;3,0\n1,0;2,0;bad\n", "line 3: 'bad' in the column Elevation"),
        ("Easting,Northing,Elevation,SDV\n1.0,2.0,3.0,bad\n", "'bad' in the column SDV is no number"),
        ("Easting,Northing,Elevation\n1.0,2.0,bad\n", "line 2: 'bad' in the column Elevation"),
    ],
)
def test_what_is_no_number_is_refused(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        read_point_table(written(tmp_path, text))


TWO_HEIGHTS = (
    "Name\tEasting\tNorthing\tElevation\tEllipsoidal height\nP1\t500001.5\t6700002.5\t912.5\t961.25\n"
)
CHOSEN = {"z_m": "Ellipsoidal height"}


@pytest.mark.parametrize("ending", ["csv", "txt", "tsv"])
def test_a_mapping_chooses_between_two_heights(tmp_path: Path, ending: str) -> None:
    file = tmp_path / f"rover.{ending}"
    file.write_text(TWO_HEIGHTS, encoding="utf-8")
    table = read_point_table(file, CHOSEN)
    assert [table.columns[name].tolist() for name in ("x_m", "y_m", "z_m")] == [
        [500001.5],
        [6700002.5],
        [961.25],
    ]
    assert table.vertical_datum == "ellipsoidal height"


def test_a_mapping_finds_columns_of_any_name(tmp_path: Path) -> None:
    file = written(tmp_path, "p;q;r;s\n1.0;2.0;3.0;0.5\n")
    named = {"x_m": "p", "y_m": "q", "z_m": "r", "sigma_z_m": "s"}
    points = SurfacePoints.read(file, crs="EPSG:32608", columns=named)
    assert points.xyz.tolist() == [[1.0, 2.0, 3.0]]
    assert points.sigma_z.tolist() == [0.5]


def test_a_mapping_of_missing_columns_or_for_other_formats_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="has no column 'Ellipsoidal height'"):
        read_point_table(written(tmp_path, "x,y,z\n1,2,3\n"), CHOSEN)
    with pytest.raises(InputError, match="is no table, whose columns can be chosen"):
        read_point_table(tmp_path / "cloud.ply", CHOSEN)


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ('"500153,546","6700164,878",804.0', "line 2: '500153,546' in the column x is no number"),
        ("m,m,m\n500153.5,6700164.8,804.0", "line 2: 'm' in the column x is no number"),
    ],
)
def test_coordinates_that_begin_with_a_text_are_refused_by_their_line(
    tmp_path: Path, rows: str, words: str
) -> None:
    with pytest.raises(InputError, match=words):
        read_point_table(written(tmp_path, f"x,y,z\n{rows}\n"))


def test_degrees_to_the_south_or_west_in_a_column_beside_them_are_refused(tmp_path: Path) -> None:
    header = "lat,N/S,lon,E/W,elevation"
    with pytest.raises(InputError, match="states W in the column E/W beside degrees without a sign"):
        read_point_table(written(tmp_path, f"{header}\n60.4,N,134.9,W,804.0\n"))
    table = read_point_table(written(tmp_path, f"{header}\n60.4,N,-134.9,W,804.0\n"))
    assert table.columns["x_m"].tolist() == [-134.9]


@pytest.mark.parametrize(
    "text",
    [
        "500.5 600 12.25\n501.5 600 12.5\n",
        "500.5,600,12.25\n501.5,600,12.5\n",
        "# east north up\nX\tY\tZ\n500.5\t600\t12.25\n501.5\t600\t12.5\n",
    ],
)
def test_xyz_files_need_no_header(tmp_path: Path, text: str) -> None:
    (tmp_path / "points.xyz").write_text(text)
    table = read_point_table(tmp_path / "points.xyz")
    assert [table.columns[name].tolist() for name in ("x_m", "y_m", "z_m")] == [
        [500.5, 501.5],
        [600.0, 600.0],
        [12.25, 12.5],
    ]


def test_xyz_files_of_more_columns_need_a_header(tmp_path: Path) -> None:
    (tmp_path / "points.xyz").write_text("500.5 600 12.25 255\n501.5 600 12.5 255\n")
    with pytest.raises(InputError, match="has no header line"):
        read_point_table(tmp_path / "points.xyz")


def test_heights_of_zero_far_from_all_others_are_refused(tmp_path: Path) -> None:
    rows = "".join(f"{k},{k},{800 + k % 7}\n" for k in range(20))
    with pytest.raises(
        InputError,
        match="heights of 0 in 1 rows, first at point 21, and all others lie between 800 and 806 m",
    ):
        read_point_table(written(tmp_path, f"x,y,z\n{rows}3,4,0\n"))
    shore = "".join(f"{k},{k},{k}\n" for k in range(20))
    assert len(read_point_table(written(tmp_path, f"x,y,z\n{shore}")).columns["z_m"]) == 20


@pytest.mark.parametrize(
    "text",
    [
        "OBJECTID,Shape,POINT_X,POINT_Y,POINT_Z\n1,Point ZM,500001.5,6700002.5,812.5\n",
        "# CoordinateSystem: LOCAL\n#Label,X/Easting,Y/Northing,Z/Altitude\nA,500001.5,6700002.5,812.5\n",
        "//X Y Z\n500001.5 6700002.5 812.5\n",
        "//X Y Z\n1\n500001.5 6700002.5 812.5\n",
        '"x" "y" "z"\n"1" 500001.5 6700002.5 812.5\n',
        "sep=;\r\nPoint;Easting;Northing;Elevation\r\nA;500001,5;6700002,5;812,5\r\n",
        '"","x","y","z"\n"1",500001.5,6700002.5,812.5\n',
    ],
)
def test_tables_of_other_programs_are_read(tmp_path: Path, text: str) -> None:
    found = read_point_table(written(tmp_path, text)).columns
    assert [float(found[name][0]) for name in ("x_m", "y_m", "z_m")] == [500001.5, 6700002.5, 812.5]


@pytest.mark.parametrize(
    "text",
    [
        "//X Y Z\n2\n500001.5 6700002.5 812.5\n",
        '"x" "y" "z"\n500001.5 6700002.5 812.5 7\n',
        '"x" "y" "z"\n"1" 500001.5 6700002.5 812.5\n"3" 500001.5 6700002.5 812.5\n',
    ],
)
def test_rows_that_are_longer_or_fewer_than_stated_are_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(InputError, match=r"line 2: . values where the header names 3"):
        read_point_table(written(tmp_path, text))


def test_colours_may_follow_the_places_of_a_table_without_a_header(tmp_path: Path) -> None:
    (tmp_path / "cloud.xyz").write_text(
        "500001.5 6700002.5 812.5 120 0 255\n500002.5 6700002.5 812.5 1 2 3\n"
    )
    found = read_point_table(tmp_path / "cloud.xyz").columns
    assert [float(found[name][0]) for name in ("x_m", "y_m", "z_m")] == [500001.5, 6700002.5, 812.5]
    (tmp_path / "cloud.xyz").write_text("1 500001.5 6700002.5 812.5\n2 500001.5 6700002.5 812.5\n")
    with pytest.raises(InputError, match=r"no header line .* name the order of its columns with --format"):
        read_point_table(tmp_path / "cloud.xyz")


@pytest.mark.parametrize(
    "name", ["Elevation (US Survey Foot)", "Elev (sft)", "Elevation_USft", "Elevation [ift]"]
)
def test_every_name_of_feet_is_converted(tmp_path: Path, name: str) -> None:
    file = written(tmp_path, f"Point,Northing,Easting,{name}\n1,6700002.5,500001.5,2665.7\n")
    assert read_point_table(file).columns["z_m"] == pytest.approx([2665.7 * 0.3048], abs=0.01)


def test_coordinates_that_a_spreadsheet_shortened_are_refused(tmp_path: Path) -> None:
    rows = "".join(f"P{k},5.00E+05,6.70E+06,{800 + k}\n" for k in range(5))
    with pytest.raises(InputError, match=r"shortened in all rows \(5\.00E\+05\); export it again"):
        read_point_table(written(tmp_path, f"Point,Easting,Northing,Elevation\n{rows}"))
    whole = "x,y,z\n5e+05,6700001.5,812\n500001.5,6.7e+06,812\n500002.5,6700001.5,812\n"
    assert len(read_point_table(written(tmp_path, whole)).columns["x_m"]) == 3


def test_a_header_in_the_windows_encoding_is_read(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(
        "Punkt,Rechtswert,Hochwert,Höhe\n1,500001.5,6700002.5,812.5\n".encode("cp1252")
    )
    assert read_point_table(tmp_path / "a.csv").columns["z_m"] == [812.5]
