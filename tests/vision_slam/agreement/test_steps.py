"""Steps that bring odometry and fixes into agreement."""

from dataclasses import replace

import numpy as np
import pytest

from survey.data.recording import OdometryRecording
from survey.data.sensors.odometry import Odometry, Sightings
from survey.data.sensors.records import GpsFixes
from vision_slam.agreement.evidence import reconcile
from vision_slam.agreement.steps import (
    Drive,
    align_drive,
    drop_far_fixes,
    drop_fixes_in_gaps,
    note_delay,
    scale_to_fixes,
    widen_errors,
)
from vision_slam.config import LocalizationConfig
from vision_slam.fusion.smoother import smooth
from vision_slam.motion import dead_reckoning
from vision_slam.odometry.odometer import VisualOdometry


@pytest.fixture(scope="module")
def wandering() -> Drive:
    """60 s at 5 m/s with precise fixes, and images whose steps vary by as much as they are long and turn."""
    times = np.arange(0.0, 60.05, 0.2)
    n, rng = len(times), np.random.default_rng(5)
    path = np.column_stack([5.0 * times, np.zeros((n, 2))])
    steps = np.column_stack([rng.uniform(0.0, 4.0, n - 1), np.zeros((n - 1, 2))])
    turned = np.column_stack([np.zeros((n, 2)), np.cumsum(rng.normal(0.0, 0.2, n))])
    fixes = GpsFixes(times[::5], path[::5] + rng.normal(0.0, 0.3, (len(times[::5]), 3)))
    sightings = Sightings([3], [[6.0, 0.0, 0.0]], [0.01 * np.eye(3)], [8.0])
    odometry = Odometry(times, steps, turned)
    recording = OdometryRecording(
        "EPSG:32608", path[0], fixes, odometry=odometry, sightings=sightings, start_is_surveyed=False
    )
    visual = VisualOdometry(odometry, sightings, (), np.zeros(n, dtype=np.bool_))
    config = LocalizationConfig(start="unknown", gps_bias_sigma_m=0.1, gps_white_sigma_m=0.3)
    return Drive(recording, config, visual)


@pytest.mark.long
def test_images_of_others_that_are_worse_than_none_are_replaced_by_lines_between_the_fixes(
    wandering: Drive,
) -> None:
    found = widen_errors(wandering)
    assert "lines between the fixes" in found.notes[-1]
    assert "landmarks are not to be mapped" in found.notes[-1]
    assert found.follows_fixes
    assert not wandering.follows_fixes
    path = dead_reckoning(found.recording.odometry, found.recording.start)
    assert np.abs(path[::5] - wandering.recording.gps.position).max() < 1e-6


@pytest.mark.long
def test_a_delay_found_with_images_worse_than_the_fixes_is_undone(wandering: Drive) -> None:
    gps = wandering.recording.gps
    moved = replace(wandering.recording, gps=replace(gps, time_s=gps.time_s + 1.1))
    found = widen_errors(replace(wandering, recording=moved, undelayed=wandering).noted("1.1 s early"))
    np.testing.assert_array_equal(found.recording.gps.time_s, gps.time_s)
    assert len(found.notes) == 1
    path = dead_reckoning(found.recording.odometry, found.recording.start)
    assert np.abs(path[::5] - gps.position).max() < 1e-6


@pytest.mark.exhaustive
def test_images_that_only_a_much_wider_error_fits_are_replaced_too() -> None:
    """51 images of a turn of 98 degrees at 10 m/s, of which the odometry makes a straight line that slows down."""
    east = np.array([0.0, 8.38, 17.07, 26.32, 34.42, 40.58])
    north = np.array([0.0, 4.16, 3.24, -0.51, -8.87, -18.51])
    up = np.array([0.0, 2.14, 0.69, 3.07, 0.66, 1.32])
    fixes = GpsFixes(np.arange(6.0), np.column_stack([east, north, up]))
    steps = np.column_stack([0.4 + 2.2 * np.exp(-np.arange(50) / 12.0), np.zeros((50, 2))])
    attitude = np.tile([0.0, 0.0, np.radians(64.0)], (51, 1))
    odometry = Odometry(0.1 * np.arange(51), steps, attitude)
    sightings = Sightings([3], [[6.0, 0.0, 0.0]], [0.01 * np.eye(3)], [8.0])
    recording = OdometryRecording(
        "EPSG:32608", np.zeros(3), fixes, odometry=odometry, sightings=sightings, start_is_surveyed=False
    )
    visual = VisualOdometry(odometry, sightings, (), np.zeros(51, dtype=np.bool_))
    config = LocalizationConfig(
        start="unknown", clock_sigma_s=0.5, gps_correlation_time_s=500.0
    ).with_image_errors(0.052)
    drive = align_drive(scale_to_fixes(Drive(recording, config, visual)))
    # Each first level of a wider error gains nothing.
    assert reconcile(drive.recording, drive.path, drive.config, drive.online).gain > 100.0
    assert "lines between the fixes" in widen_errors(drive).notes[-1]


@pytest.mark.long
def test_a_surveyed_recording_keeps_its_odometry(wandering: Drive) -> None:
    surveyed = replace(wandering, recording=replace(wandering.recording, start_is_surveyed=True))
    found = widen_errors(surveyed)
    assert found.recording.odometry is wandering.recording.odometry
    assert "disagree beyond their assumed errors" in found.notes[-1]


def test_the_clock_that_precise_fixes_are_assumed_to_have_is_noted(wandering: Drive) -> None:
    path = smooth(wandering.recording, wandering.path, wandering.config)
    assert "clock of the images" in note_delay(wandering, path).notes[-1]
    stated = wandering.config.model_copy(update={"clock_sigma_s": 0.0})
    assert note_delay(replace(wandering, config=stated), path).notes == ()


def test_fixes_in_a_gap_that_nothing_bridges_are_left_out_and_do_not_change_the_scale() -> None:
    """Two straight runs at right angles, 10 s apart, of images without wheels that go straight on in between."""
    times = np.r_[np.arange(0.0, 20.0, 0.5), np.arange(30.0, 60.0, 0.5)]
    gap = int(np.flatnonzero(np.diff(times) > 1.0)[0])
    real = np.column_stack([np.minimum(times, 25.0), np.maximum(times - 25.0, 0.0), np.zeros(len(times))])
    steps = np.column_stack([0.4 * np.diff(times), np.zeros((len(times) - 1, 2))])
    sigma = np.where(np.arange(len(steps)) == gap, 2.0, 0.0)
    odometry = Odometry(times, steps, np.zeros((len(times), 3)), step_sigma_m=sigma)
    fixes_s = np.arange(0.0, 60.0)
    fixes = GpsFixes(
        fixes_s, np.column_stack([np.minimum(fixes_s, 25.0), np.maximum(fixes_s - 25.0, 0.0), 0.0 * fixes_s])
    )
    sightings = Sightings([3], [[6.0, 0.0, 0.0]], [0.01 * np.eye(3)], [8.0])
    recording = OdometryRecording("EPSG:32608", real[0], fixes, odometry=odometry, sightings=sightings)
    visual = VisualOdometry(odometry, sightings, (), np.zeros(len(times), dtype=np.bool_))
    without = drop_fixes_in_gaps(Drive(recording, LocalizationConfig(), visual))
    assert not ((without.recording.gps.time_s > times[gap]) & (without.recording.gps.time_s < 30.0)).any()
    assert "1 gaps between images (the longest of 10.5 s)" in without.notes[-1]
    scaled = scale_to_fixes(without)
    assert np.linalg.norm(scaled.recording.odometry.step, axis=1)[:gap] == pytest.approx(
        np.full(gap, 0.5), abs=1e-3
    )


@pytest.mark.parametrize("k", [0, 30])
def test_fixes_that_no_drive_reaches_are_left_out(wandering: Drive, k: int) -> None:
    gps = wandering.recording.gps
    place = gps.position.copy()
    place[k, :2] += [-7e5, -6.4e6]
    recording = replace(wandering.recording, gps=replace(gps, position=place), start=place[0])
    found = drop_far_fixes(replace(wandering, recording=recording))
    assert found.notes == ("1 fixes lie more than 100 km from the others and were left out",)
    np.testing.assert_array_equal(found.recording.gps.time_s, np.delete(gps.time_s, k))
    assert np.abs(found.recording.start - gps.position[0]).max() < 10.0
    assert drop_far_fixes(wandering) is wandering
