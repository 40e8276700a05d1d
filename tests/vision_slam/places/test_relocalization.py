"""Paths that are torn, and how they are put together again."""

from pathlib import Path

import numpy as np
import pytest
from pyproj import CRS

from survey.core.arrays import FloatArray
from survey.data.recording import Recording
from survey.data.sensors.odometry import Odometry, Sightings
from survey.data.sensors.records import GpsFixes, Wheels
from vision_slam.attitude import rotations
from vision_slam.config import LocalizationConfig
from vision_slam.fusion.smoother import smooth
from vision_slam.motion import dead_reckoning
from vision_slam.odometry.health import FrameHealth
from vision_slam.odometry.odometer import VisualOdometry
from vision_slam.places.relocalization import relocalize_segments, segment_starts

SITE = CRS("EPSG:32608")
RADIUS_M = 40.0
LIFTED_S, SET_DOWN_S = 40.0, 60.0
NO_LANDMARKS = Sightings(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0))


def _circle(times: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Place (N, 3) and attitude (N, 3) at 1 m/s around a circle."""
    angle = times / RADIUS_M
    place = RADIUS_M * np.column_stack([np.sin(angle), 1.0 - np.cos(angle), np.zeros_like(angle)])
    return place, np.column_stack([np.zeros_like(angle), np.zeros_like(angle), angle])


def _awake(times: FloatArray) -> FloatArray:
    awake: FloatArray = times[(times < LIFTED_S) | (times >= SET_DOWN_S)]
    return awake


def _carried(gps_until_s: float = 120.0) -> tuple[Recording, VisualOdometry, FloatArray]:
    """A drive whose rover is carried for 20 s and 20 m; what its images gave goes on as if nothing had been."""
    times = _awake(np.arange(0.0, 120.0, 0.5))
    place, attitude = _circle(times)
    step = np.einsum("nji,nj->ni", rotations(attitude[:-1]), np.diff(place, axis=0))
    after = times >= SET_DOWN_S
    tear = int(np.flatnonzero(after)[0])
    step[tear - 1] = 0.0
    attitude = attitude - np.where(after, 1.5, 0.0)[:, None] * [0.0, 0.0, 1.0]
    seen = FrameHealth(5.0, 0.0, 20.0, 200, 180, is_visual=True)
    blind = FrameHealth(5.0, 0.0, 20.0, 12, 0)
    health = tuple(blind if k == tear else seen for k in range(len(times)))
    found = VisualOdometry(
        Odometry(times, step, attitude), NO_LANDMARKS, health, np.zeros(len(times), dtype=bool)
    )
    rolled_s = _awake(np.arange(0.0, 120.0, 0.1))
    rolled = np.where(rolled_s < LIFTED_S, rolled_s, rolled_s - SET_DOWN_S + LIFTED_S)
    fixes_s = _awake(np.arange(0.0, gps_until_s))
    gps = GpsFixes(fixes_s, _circle(fixes_s)[0])
    return Recording(SITE, place[0], gps, wheels=Wheels(rolled_s, rolled, rolled)), found, place


def test_a_hole_in_all_sensors_tears_the_path() -> None:
    recording, found, _ = _carried()
    assert segment_starts(recording, found).tolist() == [80]


def test_frames_that_lack_while_wheels_turn_tear_nothing() -> None:
    recording, found, _ = _carried()
    steady = np.arange(0.0, 120.0, 0.1)
    rolling = Recording(SITE, recording.start, recording.gps, wheels=Wheels(steady, steady, steady))
    assert len(segment_starts(rolling, found)) == 0
    assert relocalize_segments(rolling, found) is found


def test_what_came_after_is_laid_on_its_fixes() -> None:
    recording, found, place = _carried()
    whole = relocalize_segments(recording, found)
    assert not whole.is_lost.any()
    # Fixes are exact; steps of half a metre follow a circle of 40 m by chords.
    np.testing.assert_allclose(dead_reckoning(whole.odometry, recording.start), place, atol=0.05)
    assert whole.odometry.step_sigma_m is not None
    assert np.flatnonzero(whole.odometry.step_sigma_m).tolist() == [79]


def test_without_fixes_or_known_ground_it_stays_lost() -> None:
    recording, found, _ = _carried(gps_until_s=40.0)
    whole = relocalize_segments(recording, found)
    assert whole.is_lost.sum() == (found.odometry.time_s >= SET_DOWN_S).sum()
    assert not whole.is_lost[:80].any()


def test_the_smoother_lets_a_torn_path_come_apart_there_and_only_there() -> None:
    recording, found, place = _carried()
    whole = relocalize_segments(recording, found).odometry
    # A segment may be 12 m off, as fixes of that time may be: only the other fixes show it.
    step = whole.step.copy()
    step[79] += [9.0, -8.0, 0.0]
    off = Odometry(whole.time_s, step, whole.attitude_rad, whole.step_sigma_m, whole.turn_sigma_rad)
    torn = Recording(SITE, recording.start, recording.gps, odometry=off)
    config = LocalizationConfig(gps_bias_sigma_m=0.1, gps_white_sigma_m=0.1)
    path = smooth(torn, dead_reckoning(off, recording.start), config)
    # Fixes of 10 cm, some of it lasting; what lies before the tear is held by the start.
    assert np.linalg.norm(path.position - place, axis=1).max() < 0.15
    sigma = np.sqrt(path.covariance[:, 0, 0])
    assert sigma[81] > 2.0 * sigma[20]


def test_errors_of_unmeasured_steps_are_written_to_the_table(tmp_path: Path) -> None:
    recording, found, _ = _carried()
    whole = relocalize_segments(recording, found).odometry
    whole.write(tmp_path / "odometry.csv")
    back = Odometry.read(tmp_path / "odometry.csv")
    assert back.step_sigma_m is not None
    assert back.turn_sigma_rad is not None
    assert whole.turn_sigma_rad is not None
    assert back.step_sigma_m[79] == pytest.approx(300.0)
    np.testing.assert_allclose(
        back.turn_sigma_rad, whole.turn_sigma_rad, atol=1e-6
    )  # six decimals are written


@pytest.mark.parametrize("until_s", [15.0, 0.5])
def test_a_short_segment_or_one_image_before_a_gap_has_the_heading_of_its_fixes(until_s: float) -> None:
    times = np.r_[np.arange(0.0, until_s, 0.5), np.arange(25.0, 60.0, 0.5)]
    place, attitude = _circle(times)
    step = np.einsum("nji,nj->ni", rotations(attitude[:-1]), np.diff(place, axis=0))
    first = int(np.flatnonzero(times >= 25.0)[0])
    seen, blind = FrameHealth(5.0, 0.0, 20.0, 200, 180, is_visual=True), FrameHealth(5.0, 0.0, 20.0)
    health = tuple(blind if k == first else seen for k in range(len(times)))
    turned = attitude - np.where(times >= 25.0, 1.5, 0.6)[:, None] * [0.0, 0.0, 1.0]
    found = VisualOdometry(Odometry(times, step, turned), NO_LANDMARKS, health, np.zeros(len(times), bool))
    fixes_s = np.arange(0.0, 60.0)
    recording = Recording(SITE, place[0], GpsFixes(fixes_s, _circle(fixes_s)[0]))
    placed = relocalize_segments(recording, found)
    np.testing.assert_allclose(dead_reckoning(placed.odometry, place[0]), place, atol=0.2)
