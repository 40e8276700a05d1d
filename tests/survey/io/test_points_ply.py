"""PLY files of points."""

from pathlib import Path

import numpy as np
import pytest
from pyproj import CRS

from survey.core.errors import InputError
from survey.io.point_files import read_ply, write_ply
from survey.io.point_table import PointTable

UTM = CRS.from_epsg(32608)


@pytest.fixture
def written(tmp_path: Path, rng: np.random.Generator) -> tuple[Path, PointTable]:
    columns = {name: rng.standard_normal(20) for name in ("x_m", "y_m", "z_m", "sigma_z_m")}
    table = PointTable(columns, UTM, "EGM96")
    write_ply(tmp_path / "a.ply", table)
    return tmp_path / "a.ply", table


def test_points_come_back_with_crs_and_datum(written: tuple[Path, PointTable]) -> None:
    file, table = written
    found = read_ply(file)
    assert found.columns.keys() == table.columns.keys()
    for name, column in table.columns.items():
        np.testing.assert_array_equal(found.columns[name], column)
    assert CRS.from_user_input(found.crs) == UTM
    assert found.vertical_datum == "EGM96"


def test_one_changed_byte_is_found(written: tuple[Path, PointTable]) -> None:
    file, _ = written
    content = bytearray(file.read_bytes())
    content[-3] ^= 1
    file.write_bytes(content)
    with pytest.raises(InputError, match=r"checksum|altered|changed"):
        read_ply(file)


def test_vertices_without_a_height_are_refused(tmp_path: Path) -> None:
    head = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nend_header\n1 2\n"
    (tmp_path / "a.ply").write_text(head)
    with pytest.raises(InputError, match="vertices without z"):
        read_ply(tmp_path / "a.ply")


@pytest.mark.parametrize(
    "head", ["ply\nformat ascii 1.0\nelement vertex 999999999\nend_header\n", "plain text\n"]
)
def test_a_damaged_or_boasting_header_is_refused(tmp_path: Path, head: str) -> None:
    (tmp_path / "a.ply").write_text(head)
    with pytest.raises(InputError, match=r"a\.ply"):
        read_ply(tmp_path / "a.ply")
