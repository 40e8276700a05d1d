"""Scans of a drive are stored minute by minute, and damage is refused."""

from pathlib import Path

import numpy as np
import pytest

from survey.core.errors import InputError
from survey.data.recording import Recording
from survey.data.sensors.lidar import LidarReturns, LidarScans, Scanner
from survey.data.sensors.records import GpsFixes

SCANNER = Scanner(elevation_deg=(-30.0, 0.0), n_columns=4, mount_m=(0.2, 0.0, 1.0), turn_s=0.4)
MINUTES = [
    LidarReturns.of([0, 0, 1], [0, 2, 3], [0, 1, 1], np.array([2.0, 5.0, 7.25])),
    LidarReturns.of([2], [1], [1], np.array([4.0])),
]


def scans() -> LidarScans:
    return LidarScans(SCANNER, [10.0, 11.0, 75.0], MINUTES)


def test_returns_have_their_own_times_and_places_in_the_frame_of_the_vehicle() -> None:
    first, second, third = scans()
    assert first.time_s == pytest.approx([10.0, 10.2])
    assert first.xyz == pytest.approx(np.array([[0.2 + 3.0**0.5, 0.0, 0.0], [-4.8, 0.0, 1.0]]))
    assert second.xyz == pytest.approx(np.array([[0.2, -7.25, 1.0]]), abs=1e-9)
    assert third.time_s == pytest.approx([75.1])


def test_a_recording_holds_scans_and_reads_them_when_they_are_used(tmp_path: Path) -> None:
    fixes = GpsFixes(np.arange(3.0), np.tile([5e5, 6e6, 100.0], (3, 1)))
    Recording("EPSG:32608", [5e5, 6e6, 100.0], fixes, lidar=scans()).write(tmp_path / "drive")
    back = Recording.read(tmp_path / "drive")
    assert back.lidar == scans()
    assert sorted(file.name for file in (tmp_path / "drive" / "lidar").iterdir()) == [
        *("minute-0000.npz", "minute-0001.npz", "scanner.json", "scans.csv")
    ]


def test_damage_is_refused_in_one_sentence(tmp_path: Path) -> None:
    scans().write(tmp_path / "lidar")
    minute = tmp_path / "lidar" / "minute-0001.npz"
    minute.write_bytes(minute.read_bytes()[:-40])
    with pytest.raises(InputError, match="damaged"):
        list(LidarScans.read(tmp_path / "lidar"))
    minute.unlink()
    with pytest.raises(InputError, match="minute-0001"):
        list(LidarScans.read(tmp_path / "lidar"))
    (tmp_path / "lidar" / "scanner.json").write_text('{"n_columns": 4}', encoding="utf-8")
    with pytest.raises(InputError, match="scanner"):
        LidarScans.read(tmp_path / "lidar")


def test_directions_that_the_scanner_does_not_have_are_refused() -> None:
    wrong = LidarScans(SCANNER, [0.0], [LidarReturns.of([0], [4], [0], np.array([2.0]))])
    with pytest.raises(InputError, match="4 columns"):
        list(wrong)
    later = LidarScans(SCANNER, [0.0], [LidarReturns.of([1], [0], [0], np.array([2.0]))])
    with pytest.raises(InputError, match="beyond 0"):
        list(later)


def test_times_have_to_increase_and_every_minute_needs_its_returns() -> None:
    with pytest.raises(InputError, match="order of time"):
        LidarScans(SCANNER, [1.0, 1.0], MINUTES[:1])
    with pytest.raises(InputError, match="2 minutes"):
        LidarScans(SCANNER, [0.0, 60.0], MINUTES[:1])


def test_scans_are_not_written_over_others(tmp_path: Path) -> None:
    scans().write(tmp_path / "lidar")
    with pytest.raises(InputError, match="exists"):
        scans().write(tmp_path / "lidar")
