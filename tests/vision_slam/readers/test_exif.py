"""EXIF as cameras of several makers write it: other marks in dates, unknown offsets, positions without a date."""

from pathlib import Path

import pytest
from PIL import ExifTags, Image

from vision_slam.readers.photos import read_photo

UNIX = 1718187302.0  # 2024-06-12 10:15:02 UTC
GPS = {1: "N", 2: (60.0, 26.0, 0.0), 3: "W", 4: (135.0, 0.0, 0.0), 6: 812.0}


def photo(folder: Path, date: str, offset: str | None = None, gps: dict[int, object] | None = None):
    """Write an image with a date of exposure and a position, and read it."""
    image = Image.new("L", (8, 6))
    exif = Image.Exif()
    inner = exif.get_ifd(ExifTags.IFD.Exif)
    inner[36867] = date
    if offset is not None:
        inner[36881] = offset
    if gps is not None:
        exif.get_ifd(ExifTags.IFD.GPSInfo).update(gps)
    image.save(folder / "a.jpg", exif=exif)
    return read_photo(folder / "a.jpg")


@pytest.mark.parametrize(
    "date", ["2024:06:12 10:15:02", "2024-06-12 10:15:02", "2024/06/12 10:15:02", "2024-06-12T10:15:02"]
)
def test_dates_with_other_marks_are_the_same_time(tmp_path: Path, date: str) -> None:
    assert photo(tmp_path, date).time_s == UNIX


@pytest.mark.parametrize(
    ("offset", "ahead_s"), [("+02:00", 7200.0), ("-0700", -25200.0), ("Z", 0.0), ("   :  ", None), ("", None)]
)
def test_offsets_count_where_they_are_known(tmp_path: Path, offset: str, ahead_s: float | None) -> None:
    found = photo(tmp_path, "2024:06:12 10:15:02", offset)
    assert found.has_offset == (ahead_s is not None)
    assert found.time_s == UNIX - (ahead_s or 0.0)


@pytest.mark.parametrize("stamp", ["", "    :  :  ", "0000:00:00"])
def test_a_position_without_a_date_is_a_position_without_a_time(tmp_path: Path, stamp: str) -> None:
    found = photo(tmp_path, "2024:06:12 10:15:02", gps=GPS | {7: (10.0, 15.0, 1.0), 29: stamp})
    assert found.gps_time_s is None
    assert found.place == pytest.approx((-135.0, 60.0 + 26.0 / 60.0, 812.0))


def test_the_time_of_a_position_is_of_utc(tmp_path: Path) -> None:
    found = photo(tmp_path, "2024:06:12 12:15:02", gps=GPS | {7: (10.0, 15.0, 1.0), 29: "2024-06-12"})
    assert found.gps_time_s == UNIX - 1.0
