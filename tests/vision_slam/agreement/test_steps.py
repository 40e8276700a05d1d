"""Steps that bring odometry and fixes into agreement."""

from dataclasses import replace

import numpy as np
import pytest

from survey.data.recording import OdometryRecording
from survey.data.sensors.aiding import GpsFixes
from survey.data.sensors.odometry import Odometry
from survey.data.sensors.sightings import Sightings
from vision_slam.agreement.drive import Drive
from vision_slam.agreement.steps import note_delay, widen_errors
from vision_slam.config import LocalizationConfig
from vision_slam.fusion.smoother import smooth
from vision_slam.inertial.dead_reckoning import dead_reckoning
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


def test_images_of_others_that_are_worse_than_none_are_replaced_by_lines_between_the_fixes(
    wandering: Drive,
) -> None:
    found = widen_errors(wandering)
    assert "lines between the fixes" in found.notes[-1]
    path = dead_reckoning(found.recording.odometry, found.recording.start)
    assert np.abs(path[::5] - wandering.recording.gps.position).max() < 1e-6


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
