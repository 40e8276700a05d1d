"""Named points are read with their names, and names that are missing or doubled are refused."""

from pathlib import Path

import numpy as np
import pytest
import shapely
from pyproj import CRS

from survey import InputError
from survey.io.point_files import read_named_points
from survey.io.vector import write_features

TABLE = "x_m,y_m,z_m,name\n1,2,3,{}\n4,5,6,{}\n"


def marks(folder: Path, *names: str) -> Path:
    (folder / "marks.csv").write_text(TABLE.format(*names), encoding="utf-8-sig")
    return folder / "marks.csv"


def test_names_of_a_table_are_read(tmp_path: Path) -> None:
    found = read_named_points(marks(tmp_path, "A", "Größe"), "the marks")
    assert found.names == ("A", "Größe")
    assert found.table.columns["z_m"].tolist() == [3.0, 6.0]


def test_names_of_features_are_read(tmp_path: Path) -> None:
    shapes = shapely.points([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
    names = {"name": np.array(["A", "B"], dtype=object)}
    write_features(tmp_path / "marks.gpkg", shapes, names, CRS("EPSG:32608"), layer="marks")
    assert read_named_points(tmp_path / "marks.gpkg", "the marks").names == ("A", "B")


@pytest.mark.parametrize("names", [("A", "A"), ("A", "")])
def test_names_that_are_doubled_or_missing_are_refused(names: tuple[str, str], tmp_path: Path) -> None:
    with pytest.raises(InputError, match="a name of its own"):
        read_named_points(marks(tmp_path, *names), "the marks")


def test_control_characters_in_names_do_not_reach_the_message(tmp_path: Path) -> None:
    with pytest.raises(InputError) as refusal:
        read_named_points(marks(tmp_path, "\x1b[2J", "\x1b[2J"), "the marks")
    assert "\x1b" not in str(refusal.value)


def test_a_checkpoint_without_a_height_is_refused(tmp_path: Path) -> None:
    (tmp_path / "c.csv").write_text("name,x_m,y_m,z_m\na,1,2,3\nb,4,5,-9999\n")
    with pytest.raises(InputError, match="holds -9999 in z_m"):
        read_named_points(tmp_path / "c.csv", "the checkpoints")
