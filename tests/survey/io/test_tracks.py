"""Orientations of length 0 are refused where a trajectory is read; GPX times are dates of UTC."""

import numpy as np
import pytest
from pyproj import CRS

from survey import InputError
from survey.io.trajectory_files import read_gpx, read_track, read_tum, write_track

UTM = CRS("EPSG:32608")
XYZ = np.array([[5e5, 6.47e6, 7.0], [5e5 + 1.0, 6.47e6, 8.0]])
GPX = "http://www.topografix.com/GPX/1/1"


def test_a_quaternion_of_length_zero_is_refused(tmp_path):
    path = tmp_path / "path.tum"
    path.write_text("0.0 1.0 2.0 3.0 0.0 0.0 0.0 1.0\n1.0 2.0 2.0 3.0 0.0 0.0 0.0 0.0\n")
    with pytest.raises(InputError, match="pose 2"):
        read_tum(path)


@pytest.mark.parametrize(
    ("first_s", "date"), [(1718187302.5, "2024-06-12T10:15:02.5"), (0.5, "2000-01-01T00:00:00.5")]
)
def test_unix_times_are_written_as_their_dates_and_others_since_2000(tmp_path, first_s, date):
    path = tmp_path / "track.gpx"
    write_track(path, np.array([first_s, first_s + 1.25]), XYZ, UTM)
    assert f"<time>{date}" in path.read_text()
    time_s, xyz = read_track(path, UTM)
    assert time_s.tolist() == [first_s, first_s + 1.25]
    np.testing.assert_allclose(xyz, XYZ, atol=1e-3)


def test_offsets_of_gpx_times_from_utc_count(tmp_path):
    texts = ("2024-06-12T12:15:02.250+02:00", "2024-06-12T10:15:03Z", "2024-06-12T10:15:04")
    points = "".join(f'<trkpt lat="58" lon="-135"><ele>9</ele><time>{text}</time></trkpt>' for text in texts)
    path = tmp_path / "a.gpx"
    path.write_text(
        f'<gpx version="1.1" creator="x" xmlns="{GPX}"><trk><trkseg>{points}</trkseg></trk></gpx>'
    )
    assert read_gpx(path, CRS("EPSG:4326"))[0].tolist() == [1718187302.25, 1718187303.0, 1718187304.0]
    path.write_text(path.read_text().replace(f"<time>{texts[1]}</time>", ""))
    with pytest.raises(InputError, match="lacks times"):
        read_track(path, UTM)
