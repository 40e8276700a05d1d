"""Times in other units than seconds: every reader of times converts what is declared, says it, or refuses."""

import numpy as np
import pytest
from pyproj import CRS

from survey import Trajectory
from survey.core.errors import InputError
from survey.data.frames import Frames
from survey.data.sensors.records import Barometer, Inertial, Wheels
from survey.interchange.scans import kitti_time_s
from survey.io.tables import write_table
from survey.io.trajectory_files import read_track, read_tum, write_track, write_tum
from vision_slam.readers.gps_files import read_gps

UNIX_S, UTM = 1.7e9, CRS("EPSG:32608")
UNITS = {"nanoseconds": 1e9, "microseconds": 1e6, "milliseconds": 1e3}
SECONDS = UNIX_S + np.arange(6.0)
PLACES = np.column_stack([500_000.0 + np.arange(6.0), np.full(6, 6.7e6), np.full(6, 700.0)])
POSES = np.column_stack([PLACES, np.tile([0.0, 0.0, 0.0, 1.0], (6, 1))])


def tum(path, times):
    write_tum(path, np.column_stack([times, POSES]))
    read_tum(path)


def track(path, times):
    write_track(path, times, PLACES, UTM)
    read_track(path, UTM)


def trajectory(path, times):
    Trajectory(times, PLACES, POSES[:, 3:], np.zeros((6, 3, 3)), UTM)


def table(kind, *columns):
    def read(path, times):
        write_table(path, {"time_s": times} | {name: np.zeros(6) for name in columns})
        kind.read(path)

    return read


def fixes(path, times):
    write_table(
        path, dict(zip(("time_s", "easting_m", "northing_m", "height_m"), [times, *PLACES.T], strict=True))
    )
    read_gps(path)


def kitti_times(path, times):
    (path.parent / "times.txt").write_text("".join(f"{time!r}\n" for time in times.tolist()))
    kitti_time_s(path.parent / "000000.bin", times)


RATES = [f"{name}_{axis}_{unit}" for name, unit in (("gyro", "rad_s"), ("force", "m_s2")) for axis in "xyz"]
READERS = {
    "a.tum": tum,
    "a.gpkg": track,
    "trajectory": trajectory,
    "fixes.csv": fixes,
    "times.txt": kitti_times,
    "frames": lambda _, times: Frames(times, np.zeros((6, 4, 4), np.uint8)),
    "wheels.csv": table(Wheels, "left_m", "right_m"),
    "barometer.csv": table(Barometer, "height_m"),
    "inertial": lambda _, times: Inertial(times, np.zeros((6, 3)), np.zeros((6, 3))),
}


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("name", READERS)
def test_times_where_seconds_were_declared_are_refused_in_another_unit(tmp_path, name, unit):
    READERS[name](tmp_path / name, SECONDS)
    with pytest.raises(InputError, match=f"no seconds .* look like {unit}; divide them by"):
        READERS[name](tmp_path / f"other{name}", SECONDS * UNITS[unit])


@pytest.mark.parametrize("name", ["a.tum", "a.gpkg", "trajectory", "frames", "wheels.csv", "inertial"])
def test_times_since_the_start_are_refused_by_steps_that_no_drive_has(tmp_path, name):
    for unit in ("nanoseconds", "microseconds"):
        with pytest.raises(InputError, match=f"look like {unit}"):
            READERS[name](tmp_path / name, 0.1 * np.arange(6.0) * UNITS[unit])


def test_inertial_readings_in_milliseconds_since_the_start_are_refused():
    with pytest.raises(InputError, match="look like milliseconds"):
        READERS["inertial"](None, 10.0 * np.arange(6.0))


@pytest.mark.parametrize(
    ("header", "per_second"),
    [("time_ms", 1e3), ("Timestamp [ns]", 1e9), ("t_us", 1e6), ("time (ms)", 1e3), ("UnixTimeMillis", 1e3)],
)
def test_a_column_that_declares_its_unit_is_converted_with_a_note(tmp_path, header, per_second):
    for start_s in (0.0, UNIX_S):
        rows = [f"{(start_s + k) * per_second:.0f},8.0{k},46.5,700" for k in range(4)]
        (tmp_path / "log.csv").write_text("\n".join([f"{header},lon,lat,alt", *rows, ""]))
        log = read_gps(tmp_path / "log.csv")
        np.testing.assert_allclose(log.time_s, start_s + np.arange(4.0))
        assert "times are " in " ".join(log.notes)


def test_a_named_column_is_converted_by_the_unit_in_its_name(tmp_path):
    (tmp_path / "log.csv").write_text("stamp_us,lon,lat,alt\n0,8,46.5,7\n500000,8.1,46.5,7\n")
    assert read_gps(tmp_path / "log.csv", ["time=stamp_us"]).time_s.tolist() == [0.0, 0.5]
