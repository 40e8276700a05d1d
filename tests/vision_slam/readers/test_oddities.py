"""Oddities of recorded folders: byte order marks, line ends, units of time, mixed images, readings of another time."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from survey.core.errors import FirnlineError
from survey.data.camera import Camera
from survey.data.sensors.records import Barometer, Compass, Inertial, SensorRecords, Wheels
from vision_slam.recordings import read_sequence

N = 4
_CALIBRATION = "P0: 240 0 15.5 0 0 240 11.5 0 0 0 1 0"
_SENSOR = (
    "resolution: [32, 24]\nintrinsics: [240, 240, 15.5, 11.5]\ndistortion_coefficients: [0, 0, 0, 0]\n"
    "T_BS: {data: [0,0,1,0, -1,0,0,0, 0,-1,0,0, 0,0,0,1]}\n"
)
_POSES = [f"1 0 0 0 0 1 0 0 0 0 1 {0.2 * k}" for k in range(N)]


def _camera() -> Camera:
    matrix = np.array([[240.0, 0.0, 15.5], [0.0, 240.0, 11.5], [0.0, 0.0, 1.0]])
    return Camera("pinhole", 32, 24, matrix, np.zeros(5), np.eye(4))


def _images(folder: Path, depths: tuple[type, ...] = (np.uint8,) * N) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for k, depth in enumerate(depths):
        cv2.imwrite(str(folder / f"{k:06d}.png"), np.full((24, 32), 40 + 200 * (depth is np.uint16), depth))


class _Writer:
    """Writes lines with a line end and an encoding."""

    def __init__(self, place: Path, encoding: str, end: str) -> None:
        self.place, self.encoding, self.end = place, encoding, end

    def __call__(self, name: str, lines: list[str]) -> None:
        (self.place / name).parent.mkdir(parents=True, exist_ok=True)
        (self.place / name).write_bytes(self.end.join(lines).encode(self.encoding))


def _kitti(write: _Writer) -> None:
    _images(write.place / "image_0")
    write("calib.txt", [_CALIBRATION])
    write("times.txt", [f"{0.25 * k}" for k in range(N)])
    write("poses.txt", _POSES)


def _raw(write: _Writer) -> None:
    _images(write.place / "image_00" / "data")
    write("calib_cam_to_cam.txt", ["S_rect_00: 32 24", "P_rect_00: 240 0 15.5 0 0 240 11.5 0 0 0 1 0"])
    write("image_00/timestamps.txt", [f"2011-09-26 13:02:25.{25 * k:02d}" for k in range(N)])


def _tum(write: _Writer) -> None:
    _images(write.place / "rgb")
    _camera().write(write.place / "camera.toml")
    write("rgb.txt", ["# images", *(f"{1.3e9 + 0.25 * k:.6f} rgb\\{k:06d}.png" for k in range(N))])
    rows = [f"{1.3e9 + 0.25 * k:.6f} {0.2 * k} 0 0 0 0 0 1" for k in range(N)]
    write("groundtruth.txt", ["# poses", *rows[::-1]])


def _euroc(write: _Writer) -> None:
    _images(write.place / "mav0" / "cam0" / "data")
    rows = [f"{1400000000000000000 + 250000000 * k},{k:06d}.png" for k in range(N)]
    write("mav0/cam0/data.csv", ["#timestamp [ns],filename", *rows])
    write("mav0/cam0/sensor.yaml", [_SENSOR])


def _plain(write: _Writer) -> None:
    _images(write.place)
    _camera().write(write.place / "camera.toml")
    write("times.txt", [f"{0.25 * k}" for k in range(N)])


_LAYOUTS = (_kitti, _raw, _tum, _euroc, _plain)


@pytest.mark.parametrize("layout", _LAYOUTS)
@pytest.mark.parametrize(("encoding", "end"), [("utf-8", "\r\n"), ("utf-8-sig", "\n")])
def test_line_ends_of_windows_and_byte_order_marks_change_nothing(
    tmp_path: Path, layout: Callable[[_Writer], None], encoding: str, end: str
) -> None:
    layout(_Writer(tmp_path, encoding, end))
    sequence = read_sequence(tmp_path)
    assert np.diff(sequence.frames.time_s) == pytest.approx(np.full(N - 1, 0.25), abs=1e-6)
    if sequence.reference_time_s is not None:
        assert (np.diff(sequence.reference_time_s) > 0.0).all()


@pytest.mark.parametrize("layout", _LAYOUTS)
def test_text_that_is_no_utf_8_is_refused_with_its_file(
    tmp_path: Path, layout: Callable[[_Writer], None]
) -> None:
    layout(_Writer(tmp_path, "utf-16", "\n"))
    with pytest.raises(FirnlineError, match="is no UTF-8 text"):
        read_sequence(tmp_path)


@pytest.mark.parametrize(
    ("first", "per_second", "unit"),
    [
        (1.7e18, 1e9, "nanoseconds"),
        (5e12, 1e9, "nanoseconds"),
        (1.7e15, 1e6, "microseconds"),
        (1.7e12, 1e3, "milliseconds"),
    ],
)
def test_times_in_smaller_units_become_seconds_with_a_note(
    tmp_path: Path, first: float, per_second: float, unit: str
) -> None:
    write = _Writer(tmp_path, "utf-8", "\n")
    _kitti(write)
    write("times.txt", [str(int(first + 0.25 * per_second * k)) for k in range(N)])
    sequence = read_sequence(tmp_path)
    assert np.diff(sequence.frames.time_s) == pytest.approx(np.full(N - 1, 0.25), abs=1e-3)
    assert sequence.reference_time_s == pytest.approx(sequence.frames.time_s)
    assert any(unit in note for note in sequence.notes)


@pytest.mark.parametrize(
    "depths", [(np.uint8, np.uint16, np.uint16, np.uint16), (np.uint16, np.uint8, np.uint16, np.uint16)]
)
def test_images_of_mixed_depth_are_refused(tmp_path: Path, depths: tuple[type, ...]) -> None:
    _plain(_Writer(tmp_path, "utf-8", "\n"))
    _images(tmp_path, depths)
    with pytest.raises(FirnlineError, match=r"000001.png has uint\d+ pixels, the first image others"):
        read_sequence(tmp_path)


@pytest.mark.parametrize("kind", [Wheels, Inertial, Compass, Barometer])
def test_columns_of_readings_that_are_not_used_are_named(
    tmp_path: Path, kind: type[SensorRecords], caplog: pytest.LogCaptureFixture
) -> None:
    file = tmp_path / "a.csv"
    times = np.arange(3.0)
    shapes = {Inertial: ((3, 3), (3, 3)), Wheels: ((3,), (3,))}.get(kind, ((3,),))
    kind(times, *map(np.ones, shapes)).write(file)
    kind.read(file)
    assert caplog.text == ""
    head, *rows = file.read_text().splitlines()
    file.write_text("\n".join([f"{head},temperature_c,slip", *(f"{row},1,2" for row in rows), ""]))
    kind.read(file)
    assert f"{file}: not used: slip, temperature_c" in caplog.text


@pytest.mark.parametrize("table", ["wheels.csv", "inertial.csv"])
def test_readings_of_another_time_are_refused(tmp_path: Path, table: str) -> None:
    _plain(_Writer(tmp_path, "utf-8", "\n"))
    columns = {
        "wheels.csv": "left_m,right_m",
        "inertial.csv": "gyro_x_rad_s,gyro_y_rad_s,gyro_z_rad_s,force_x_m_s2,force_y_m_s2,force_z_m_s2",
    }[table]
    zeros = ",0" * (columns.count(",") + 1)
    rows = "".join(f"{1e6 + k}{zeros}\n" for k in range(3))
    (tmp_path / table).write_text(f"time_s,{columns}\n{rows}", encoding="utf-8")
    with pytest.raises(FirnlineError, match="put both on one clock"):
        read_sequence(tmp_path)


def test_poses_without_a_rotation_are_refused_with_their_line(tmp_path: Path) -> None:
    write = _Writer(tmp_path, "utf-8", "\n")
    _kitti(write)
    write("poses.txt", [*_POSES[:2], "2 0 0 0 0 2 0 0 0 0 2 0", _POSES[3]])
    with pytest.raises(FirnlineError, match="line 3: the pose holds no rotation"):
        read_sequence(tmp_path)


@pytest.mark.parametrize(
    ("first", "step"), [(1.4e9, 0.25), (1.4e12, 250.0), (1.4e15, 250000.0), (0.0, 0.25), (0.0, 250.0)]
)
def test_times_of_euroc_in_other_units_than_nanoseconds_are_refused(
    tmp_path: Path, first: float, step: float
) -> None:
    write = _Writer(tmp_path, "utf-8", "\n")
    _euroc(write)
    write("mav0/cam0/data.csv", [f"{first + step * k},{k:06d}.png" for k in range(N)])
    with pytest.raises(FirnlineError, match=r"data\.csv holds times that are no nanoseconds: the first is"):
        read_sequence(tmp_path)


def test_inertial_readings_of_euroc_have_nanoseconds_too(tmp_path: Path) -> None:
    write = _Writer(tmp_path, "utf-8", "\n")
    _euroc(write)
    write("mav0/imu0/data.csv", [f"{1.4e9 + 0.005 * k:.3f},0,0,0,0,0,9.81" for k in range(N)])
    with pytest.raises(FirnlineError, match=r"imu0.data\.csv holds times that are no nanoseconds"):
        read_sequence(tmp_path)


def _listed(write: _Writer) -> None:
    _images(write.place)
    _camera().write(write.place / "camera.toml")
    write("frames.csv", ["time_s,file", *(f"{0.25 * k},{k:06d}.png" for k in range(N)), ""])


@pytest.mark.parametrize("layout", [*_LAYOUTS, _listed])
def test_a_frame_rate_beside_times_of_a_layout_is_refused(
    tmp_path: Path, layout: Callable[[_Writer], None]
) -> None:
    layout(_Writer(tmp_path, "utf-8", "\n"))
    assert len(read_sequence(tmp_path).frames) == N
    with pytest.raises(FirnlineError, match="have times of their own; leave --frame-rate out"):
        read_sequence(tmp_path, frame_rate_hz=10.0)
