"""Points in vector files: heights of the geometry or of an attribute, and usual names of attributes."""

from pathlib import Path

import numpy as np
import pyproj
import pytest
import shapely

from survey.core.errors import InputError
from survey.io.point_files import read_named_points, read_point_table
from survey.io.vector import write_features

CRS = pyproj.CRS(32608)
PLACES = np.array([[500_000.0, 6_700_000.0, 10.0], [500_100.0, 6_700_000.0, 11.0]])
FLAT = PLACES * [1.0, 1.0, 0.0]


def marks(path: Path, places: np.ndarray = PLACES, **columns: list[object]) -> Path:
    attributes = {name: np.array(column) for name, column in columns.items()}
    write_features(path, shapely.points(places), attributes, CRS, layer="marks")
    return path


@pytest.mark.parametrize("ending", ["gpkg", "geojson", "json", "shp"])
def test_a_usual_name_of_the_standard_deviation_is_found(tmp_path: Path, ending: str) -> None:
    file = marks(tmp_path / f"marks.{ending}", sigma_z=[0.02, 0.03], depth_m=[1.0, 2.0])
    table = read_point_table(file)
    assert table.columns["z_m"].tolist() == [10.0, 11.0]
    assert table.columns["sigma_z_m"].tolist() == [0.02, 0.03]
    assert table.columns["depth_m"].tolist() == [1.0, 2.0]


@pytest.mark.parametrize("ending", ["gpkg", "geojson", "shp"])
def test_heights_are_those_of_an_attribute_where_the_geometry_has_none(
    tmp_path: Path, ending: str, caplog: pytest.LogCaptureFixture
) -> None:
    file = marks(tmp_path / f"marks.{ending}", PLACES[:, :2], Elevation=[710.5, 712.0], code=["a", "b"])
    table = read_point_table(file)
    assert table.columns["z_m"].tolist() == [710.5, 712.0]
    assert "Elevation" not in table.columns
    assert "columns read as z_m = Elevation" in caplog.text


def test_own_names_of_attributes_are_read(tmp_path: Path) -> None:
    table = read_point_table(marks(tmp_path / "a.gpkg", PLACES[:, :2], z_m=[7.0, 8.0], sigma_z_m=[0.1, 0.2]))
    assert table.columns["z_m"].tolist() == [7.0, 8.0]
    assert table.columns["sigma_z_m"].tolist() == [0.1, 0.2]


def test_heights_and_standard_deviations_are_chosen(tmp_path: Path) -> None:
    file = marks(tmp_path / "marks.shp", FLAT, H_ell=[748.0, 749.0], H_ortho=[700.0, 701.0], acc=[0.1, 0.2])
    table = read_named_points(file, "the checkpoint file", {"z_m": "H_ell", "sigma_z_m": "acc"}).table
    assert table.columns["z_m"].tolist() == [748.0, 749.0]
    assert table.columns["sigma_z_m"].tolist() == [0.1, 0.2]


def test_names_of_points_are_read_from_a_shapefile(tmp_path: Path) -> None:
    file = marks(tmp_path / "marks.shp", name=["A", "B"])
    assert read_named_points(file, "the checkpoint file").names == ("A", "B")


@pytest.mark.parametrize(
    ("places", "columns", "given", "words"),
    [
        (PLACES[:, :2], {"code": [1, 2]}, {}, "points without a height; .* --columns z=NAME"),
        (PLACES[:, :2], {"elev": [1.0, 2.0], "height": [3.0, 4.0]}, {}, "either could be meant"),
        (PLACES[:, :2], {"elev": ["1,5", "2,0"]}, {}, "text in the attribute elev"),
        (FLAT, {"elev": [1.0, 2.0]}, {}, "heights of 0 in its geometry and others in the attribute elev"),
        (PLACES, {"elev": [1.0, 2.0]}, {"z_m": "h"}, "has no column 'h'"),
        (PLACES, {"elev": [1.0, 2.0]}, {"x_m": "elev"}, "has its places in its geometry"),
    ],
)
def test_what_is_not_clear_is_refused(
    tmp_path: Path,
    places: np.ndarray,
    columns: dict[str, list[object]],
    given: dict[str, str],
    words: str,
) -> None:
    file = marks(tmp_path / "marks.gpkg", places, **columns)
    with pytest.raises(InputError, match=words):
        read_point_table(file, given)


def test_lines_are_refused(tmp_path: Path) -> None:
    write_features(tmp_path / "way.gpkg", [shapely.LineString(PLACES)], {}, CRS, layer="way")
    with pytest.raises(InputError, match="holds LineString; single points were expected"):
        read_point_table(tmp_path / "way.gpkg")
