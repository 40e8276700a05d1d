"""Every reader of recordings gets a file with one element more than it understands, and uses, names or refuses it."""

import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from live.autopilot_logs import LOG_ENDINGS
from survey.core.errors import InputError
from vision_slam.readers import calibrations, gps_files
from vision_slam.readers.bags import read_bag
from vision_slam.readers.gps_files import read_gps
from vision_slam.recordings import read_sequence

YAML = {
    "camera_matrix": "image_width: 64\nimage_height: 48\ncamera_matrix: {data: [50, 0, 32, 0, 50, 24, 0, 0, 1]}\n",
    "k": "width: 64\nheight: 48\nk: [50, 0, 32, 0, 50, 24, 0, 0, 1]\n",
    "cam0": "cam0: {intrinsics: [50, 50, 32, 24], resolution: [64, 48]}\n",
    "intrinsics": "intrinsics: [50, 50, 32, 24]\nresolution: [64, 48]\n",
    "camera1.fx": "".join(
        f"Camera1.{k}: {v}\n" for k, v in zip(("fx", "fy", "cx", "cy"), (50, 50, 32, 24), strict=True)
    ),
    "camera.fx": "".join(
        f"Camera.{k}: {v}\n" for k, v in zip(("fx", "fy", "cx", "cy"), (50, 50, 32, 24), strict=True)
    ),
}
SIZE = "Camera.width: 64\nCamera.height: 48\n"
GPX = """<gpx version="1.1" creator="x" xmlns="http://www.topografix.com/GPX/1/1">{more}<trk><trkseg>
<trkpt lat="58.4" lon="-134.6"><ele>5</ele><time>2024-06-12T10:00:00Z</time></trkpt>
<trkpt lat="58.5" lon="-134.6"><ele>5</ele><time>2024-06-12T10:00:01Z</time></trkpt></trkseg></trk></gpx>"""
TABLE = "time_s,longitude_deg,latitude_deg,height_m{more}\n0,8,46,5{cell}\n1,8.1,46,5{cell}\n"
POS = "%  GPST  latitude(deg) longitude(deg)  height(m) Q ns sdn sde sdu\n{more}" + "".join(
    f"2024/06/12 10:00:0{k}.000 58.4{k} -134.6 12.0 1 9 0.01 0.01 0.02\n" for k in range(2)
)
ANDROID = (
    "# Fix,Provider,LatitudeDegrees,LongitudeDegrees,AltitudeMeters,SpeedMps,AccuracyMeters,BearingDegrees,UnixTimeMillis\n{more}"
    + "".join(f"Fix,GPS,58.4{k},-134.6,12.0,0,3.0,0,{1718186400000 + 1000 * k}\n" for k in range(2))
)


def sentence(body: str) -> str:
    return f"${body}*{np.bitwise_xor.reduce(np.frombuffer(body.encode(), np.uint8)):02X}\n"


NMEA = "".join(
    sentence(f"GPGGA,10000{k}.00,582{k}.0000,N,13433.0000,W,4,08,0.9,100.0,M,0,M,,") for k in range(2)
)
# By the suffix of a receiver's file: its content without and with one element more, and what is said of that; what other
# messages of a receiver hold (satellites in view, raw measurements) is no position, and leaves the reading as it is.
RECEIVERS = {
    ".gpx": (
        GPX.format(more=""),
        GPX.format(more='<wpt lat="1" lon="2"/>'),
        "1 points of .* outside of its tracks",
    ),
    ".csv": (
        TABLE.format(more="", cell=""),
        TABLE.format(more=",mode", cell=",7"),
        "columns that are not used: mode",
    ),
    ".pos": (POS.format(more=""), POS.format(more="% an unknown line\n"), None),
    ".nmea": (NMEA, sentence("GPGSV,1,1,01,01,40,083,46") + NMEA, None),
    ".txt": (ANDROID.format(more=""), ANDROID.format(more="Raw,1,2,3\n"), None),
}
OWN_TESTS = {
    ".ubx": "tests/vision_slam/readers/test_receivers.py",
    "GrafNav": "tests/vision_slam/test_fix_logs.py",
}


def test_the_tables_hold_every_reader():
    assert RECEIVERS.keys() | OWN_TESTS.keys() == gps_files._READERS.keys()
    assert YAML.keys() == calibrations._FORMATS.keys()
    assert {".bin", ".tlog", ".ulg"} == set(LOG_ENDINGS)  # whose tests stand in tests/live
    assert all(Path(file).is_file() for file in OWN_TESTS.values())


@pytest.mark.parametrize("suffix", RECEIVERS)
def test_a_file_of_a_receiver_with_one_element_more(tmp_path, suffix):
    plain, more, said = RECEIVERS[suffix]
    (tmp_path / f"a{suffix}").write_text(plain)
    (tmp_path / f"b{suffix}").write_text(more)
    first, second = read_gps(tmp_path / f"a{suffix}"), read_gps(tmp_path / f"b{suffix}")
    np.testing.assert_array_equal(first.place, second.place)
    if said is not None:
        assert "not used" not in " ".join(first.notes)
        assert any(re.search(said, note) for note in second.notes), second.notes


@pytest.mark.parametrize("key", YAML)
def test_a_calibration_with_one_camera_more(tmp_path, key):
    size = SIZE if key.startswith("camera") and key != "camera_matrix" else ""
    (tmp_path / "a.yaml").write_text(YAML[key] + size + "cam1: {intrinsics: [9, 9, 9, 9]}\n")
    camera, notes = calibrations.read_calibration(tmp_path / "a.yaml")
    assert camera.matrix[0, 0] == 50.0
    assert any("the first camera is taken, not cam1" in note for note in notes)


def images(folder: Path, n: int = 2) -> Path:
    folder.mkdir(parents=True)
    for k in range(n):
        cv2.imwrite(str(folder / f"{k}.png"), np.full((4, 6), 9 * k, np.uint8))
    return folder


def kitti(place: Path) -> Path:
    images(place / "image_0")
    (place / "calib.txt").write_text("P0: 5 0 3 0 0 5 2 0 0 0 1 0")
    return place / "image_1"


def kitti_raw(place: Path) -> Path:
    images(place / "image_00" / "data")
    lines = "2011-09-26 13:02:25.5\n2011-09-26 13:02:25.6\n"
    (place / "image_00" / "timestamps.txt").write_text(lines)
    (place / "calib_cam_to_cam.txt").write_text("S_rect_00: 6 4\nP_rect_00: 5 0 3 0 0 5 2 0 0 0 1 0\n")
    return place / "image_01"


def tum(place: Path) -> Path:
    images(place / "rgb")
    (place / "rgb.txt").write_text("1.0 rgb/0.png\n1.5 rgb/1.png\n")
    calibration(place)
    return place / "depth"


def euroc(place: Path) -> Path:
    images(place / "mav0" / "cam0" / "data")
    (place / "mav0" / "cam0" / "data.csv").write_text("#t,name\n1000000000,0.png\n1050000000,1.png\n")
    (place / "mav0" / "cam0" / "sensor.yaml").write_text(
        "intrinsics: [5.0, 5.0, 3.0, 2.0]\nresolution: [6, 4]\ndistortion_coefficients: [0, 0, 0, 0]\n"
        "T_BS:\n  data: [0, 0, 1, 0, -1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 0, 1]\n"
    )
    return place / "mav0" / "cam1"


def calibration(place: Path) -> None:
    from survey import Camera

    matrix = np.array([[5.0, 0, 3], [0, 5.0, 2], [0, 0, 1]])
    Camera("pinhole", 6, 4, matrix, np.zeros(5), np.eye(4)).write(place / "camera.toml")


@pytest.mark.parametrize("layout", [kitti, kitti_raw, tum, euroc])
def test_a_layout_with_one_folder_more_names_it(tmp_path, layout):
    other = layout(tmp_path / "drive")
    assert not any("not read" in note for note in read_sequence(tmp_path / "drive").notes)
    images(other)
    assert f"not read: {other.name}" in read_sequence(tmp_path / "drive").notes


@pytest.mark.parametrize("kind", ["first", "second"])
def test_a_bag_with_one_topic_more_names_it(tmp_path, kind):
    pytest.importorskip("rosbags")
    from tests.vision_slam.readers.test_bags import NOISE, first_bag, second_bag

    place = tmp_path / ("a.bag" if kind == "first" else "a")
    with first_bag(place) if kind == "first" else second_bag(place) as bag:
        bag.calibration("/cam/camera_info")
        for k in range(2):
            bag.image("/cam/image_raw", float(k), NOISE[k], "mono8")
        bag.add("/chatter", 0.0, bag.make("std_msgs/msg/String", data="hello"))
    assert "not read: /chatter (std_msgs/msg/String)" in read_bag(place).notes


def test_a_photo_whose_place_is_in_another_datum_names_it(tmp_path):
    from tests.vision_slam.readers.test_photo_folder import photo, position

    for k in range(4):
        datum = {18: "TOKYO" if k == 3 else "WGS-84"}
        photo(tmp_path / f"{k}.jpg", second=k, gps=position(58.4 + 1e-4 * k, -134.6) | datum)
    sequence = read_sequence(tmp_path)
    assert len(sequence.gps.time_s) == 3
    assert any("the first 3.jpg, state a position in the datum 'TOKYO'" in note for note in sequence.notes)


@pytest.mark.parametrize("suffix", [".tum", ".txt"])
def test_poses_with_one_number_more_are_refused(tmp_path, suffix):
    from survey.io.trajectory_files import read_kitti, read_tum

    row = "0 1 2 3 0 0 0 1 9\n" if suffix == ".tum" else "1 0 0 0 0 1 0 0 0 0 1 0 9\n"
    (tmp_path / f"a{suffix}").write_text(row)
    with pytest.raises(InputError, match=r"numbers; .* were expected"):
        (read_tum if suffix == ".tum" else read_kitti)(tmp_path / f"a{suffix}")
