"""Fixes that are not finite or repeat the one before are left out; disorder is refused with its place."""

import pytest

from survey.core.errors import InputError
from vision_slam.readers.gps_files import read_gps

HEADER = "time_s,latitude_deg,longitude_deg,height_m\n"
GPX = "http://www.topografix.com/GPX/1/1"


def table(tmp_path, *rows):
    (tmp_path / "fixes.csv").write_text(HEADER + "".join(f"{row}\n" for row in rows))
    return tmp_path / "fixes.csv"


def test_fixes_that_are_not_finite_are_left_out_with_a_note(tmp_path):
    log = read_gps(table(tmp_path, "0,46,8,5", "1,46,8,nan", "2,nan,nan,5", "3,46,8,5"))
    assert log.time_s.tolist() == [0.0, 3.0]
    assert log.notes == ("2 fixes whose place or error is no finite number are left out",)
    line = "2024/06/12 10:15:0{}.000  46.0 8.0 900.1 1 12 {} {} 0.02 0 0 0 0 3.0\n"
    (tmp_path / "a.pos").write_text(
        line.format(1, 0.2, 0.2) + line.format(2, "nan", "nan") + line.format(3, 0.2, 0.2)
    )
    assert len(read_gps(tmp_path / "a.pos").sigma_m) == 2


def test_points_of_gpx_that_repeat_are_left_out_with_a_note(tmp_path):
    points = "".join(
        f'<trkpt lat="46" lon="8"><ele>9</ele><time>2024-06-12T10:15:0{k}Z</time></trkpt>' * 2
        for k in range(3)
    )
    path = tmp_path / "a.gpx"
    path.write_text(
        f'<gpx version="1.1" creator="x" xmlns="{GPX}"><trk><trkseg>{points}</trkseg></trk></gpx>'
    )
    log = read_gps(path)
    assert len(log.time_s) == 3
    assert log.notes == ("3 fixes that repeat time and place of the one before are left out",)


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (("0,46,8,5", "2,46,8,5", "1,46,8,5"), r"fixes\.csv: .* fix 3 at 1\.000 s follows one at 2\.000 s; sort"),
        (("0,46,8,5", "1,46,8,5", "1,47,8,5"), r"fixes\.csv: .* fix 3 at 1\.000 s follows one at 1\.000 s"),
        (("0,46,8,nan", "1,46,8,nan"), r"fixes\.csv holds no fix with a finite place"),
        (("0,46,8,5", "nan,46,8,5"), r"fixes\.csv: the time of fix 2 is no finite number"),
    ],
)  # fmt: skip
def test_fixes_that_cannot_be_used_are_refused_with_file_and_place(tmp_path, rows, words):
    with pytest.raises(InputError, match=words):
        read_gps(table(tmp_path, *rows))
