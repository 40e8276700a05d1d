"""Positions of RTKLIB."""

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from survey.core.errors import InputError
from vision_slam.readers.gps_files import read_positions

LINE = "{time} 60.5 -134.25 712.5 {quality} 9 0.003 0.004 0.01 0 0 0 0 0"


def written(folder: Path, *lines: str) -> Path:
    file = folder / "rover.pos"
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return file


def test_gps_time_is_converted_to_utc(tmp_path: Path) -> None:
    file = written(tmp_path, "%  GPST  latitude(deg)", LINE.format(time="2024/05/01 12:00:18.500", quality=1))
    time_s, place, *_ = read_positions(file)
    assert time_s[0] == pytest.approx(datetime(2024, 5, 1, 12, 0, 0, 500_000, UTC).timestamp())
    np.testing.assert_array_equal(place, [[-134.25, 60.5, 712.5]])


def test_utc_stays(tmp_path: Path) -> None:
    file = written(tmp_path, "%  UTC  latitude(deg)", LINE.format(time="2024/05/01 12:00:00.0", quality=1))
    assert read_positions(file)[0][0] == datetime(2024, 5, 1, 12, tzinfo=UTC).timestamp()


def test_weeks_and_dates_agree(tmp_path: Path) -> None:
    by_date = read_positions(written(tmp_path, LINE.format(time="2024/05/01 12:00:00.0", quality=1)))[0]
    # Wednesday noon of week 2312.
    by_week = read_positions(written(tmp_path, LINE.format(time=f"2312 {3 * 86400 + 43200}", quality=1)))[0]
    np.testing.assert_allclose(by_week, by_date)


@pytest.mark.parametrize(("quality", "least_m"), [(1, 0.01), (2, 0.05), (5, 1.0), (9, 1.0)])
def test_a_solution_is_no_surer_than_its_quality(tmp_path: Path, quality: int, least_m: float) -> None:
    file = written(tmp_path, LINE.format(time="2024/05/01 12:00:00.0", quality=quality))
    assert read_positions(file)[2][0] == least_m


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("2024/05/01 12:00:00.0 60.5", "line 1: 3 values; time, latitude"),
        ("2024/05/01 noon 60.5 -134.2 712.5 1 9 0.1 0.1 0.1", "line 1 is no position in degrees"),
        (
            "2024/05/01 12:00:00.0 6700000.0 500000.0 712.5 1 9 0.1 0.1 0.1",
            "are no degrees; write latitude and longitude",
        ),
    ],
)
def test_what_is_no_position_is_refused_with_its_line(tmp_path: Path, line: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        read_positions(written(tmp_path, line))


def test_a_file_without_positions_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no positions"):
        read_positions(written(tmp_path, "% header"))


def test_degrees_minutes_and_seconds_are_read_as_the_header_names_them(tmp_path: Path) -> None:
    head = "%  UTC  latitude(d'\") longitude(d'\") height(m) Q ns sdn(m) sde(m) sdu(m)"
    line = "2024/05/01 12:00:00.0 60 26 17.16 -0 59 53.52 812.3 1 12 0.01 0.01 0.02 0 0 0 0 99"
    _, place, *_ = read_positions(written(tmp_path, head, line))
    np.testing.assert_allclose(place, [[-(59 / 60 + 53.52 / 3600), 60 + 26 / 60 + 17.16 / 3600, 812.3]])


def test_semicolons_separate_as_blanks_do(tmp_path: Path) -> None:
    line = LINE.format(time="2024/05/01 12:00:00.0", quality=1)
    blanks = read_positions(written(tmp_path, line))
    semicolons = read_positions(written(tmp_path, line.replace(" ", ";")))
    np.testing.assert_array_equal(blanks[1], semicolons[1])


@pytest.mark.parametrize(
    ("head", "words"),
    [
        ("%  GPST  x-ecef(m)  y-ecef(m)  z-ecef(m)", "positions from the Earth's centre"),
        ("%  GPST  e-baseline(m)  n-baseline(m)  u-baseline(m)", "positions from a base"),
        ("%  JST  latitude(deg)  longitude(deg)", "times of Japan"),
    ],
)
def test_positions_that_are_no_degrees_are_refused_by_their_header(
    tmp_path: Path, head: str, words: str
) -> None:
    line = "2024/05/01 12:00:00.0 12.1 -3.2 0.4 1 12 0.01 0.01 0.02 0 0 0"
    with pytest.raises(InputError, match=words):
        read_positions(written(tmp_path, head, line))
