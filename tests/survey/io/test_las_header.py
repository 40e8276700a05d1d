"""Headers of LAS files against the size of the file."""

import struct
from pathlib import Path

import laspy
import numpy as np
import pytest

from survey.core.errors import InputError
from survey.io.las import check_las_points, check_las_records
from survey.io.point_table import check_claim


@pytest.fixture
def las(tmp_path: Path) -> Path:
    points = laspy.create(point_format=6, file_version="1.4")
    points.header.scales = [0.001, 0.001, 0.001]
    points.x, points.y, points.z = np.arange(50.0), np.arange(50.0), np.zeros(50)
    points.write(str(tmp_path / "a.las"))
    return tmp_path / "a.las"


def test_a_complete_file_passes(las: Path) -> None:
    check_las_records(las)
    with laspy.open(las) as reader:
        check_las_points(las, reader.header)


def test_a_header_that_is_cut_off_is_refused(las: Path) -> None:
    las.write_bytes(las.read_bytes()[:90])
    with pytest.raises(InputError, match="its header is cut off"):
        check_las_records(las)


def test_more_records_than_the_file_has_room_for_are_refused(las: Path) -> None:
    content = bytearray(las.read_bytes())
    struct.pack_into("<I", content, 100, 2**31)
    las.write_bytes(content)
    with pytest.raises(InputError, match="claims more records"):
        check_las_records(las)


def test_more_points_than_the_file_can_hold_are_refused(las: Path) -> None:
    with laspy.open(las) as reader:
        header = reader.header
    las.write_bytes(las.read_bytes()[:500])
    with pytest.raises(InputError, match=r"claims 50 points of 30 bytes but has 500 bytes"):
        check_las_points(las, header)


def test_packed_points_may_claim_more(las: Path) -> None:
    with pytest.raises(InputError, match="it was cut off"):
        check_claim(las, 10**6, 30)
    check_claim(las, 10_000, 30, ratio=400)
