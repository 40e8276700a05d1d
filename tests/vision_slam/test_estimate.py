from dataclasses import replace

import numpy as np

from survey.data.ice_motion import IceMotion
from survey.data.recording import Recording
from survey.data.sensors.odometry import LoopClosures, Odometry, Sightings
from survey.data.sensors.records import GpsFixes
from survey.data.sensors.stakes import StakeSightings, StakeSurveys
from survey.reconstruction.motion.epoch import in_fixed_frame
from survey.reconstruction.motion.priors import uniform_motion
from vision_slam import LocalizationConfig, localize
from vision_slam.attitude import rotations
from vision_slam.drive_estimate import Localization

DAY_S = 86400.0
CONFIG = LocalizationConfig(gps_bias_sigma_m=0.02, gps_white_sigma_m=0.01, gps_vertical_factor=1.0)
RATE = np.array([2.0, -1.0, -0.1])


def drive_on_ice(rate: np.ndarray, n: int = 200, step_s: float = 240.0) -> tuple[Recording, np.ndarray]:
    """A drive around a circle twice on ice that moves by a rate [m/day]; and its path on the ice of time 0."""
    time_s, angle = step_s * np.arange(n), 4.0 * np.pi * np.arange(n) / n
    path = np.column_stack([60.0 * np.sin(angle), 60.0 * (1.0 - np.cos(angle)), 2.0 * np.sin(angle)])
    attitude = np.column_stack([np.zeros(n), np.zeros(n), angle])
    odometry = Odometry(
        time_s, np.einsum("nji,nj->ni", rotations(attitude[:-1]), np.diff(path, axis=0)), attitude
    )
    fixes = GpsFixes(time_s, path + rate * (time_s / DAY_S)[:, None])
    pose = np.arange(0, n, 5)
    ahead = np.tile([8.0, 0.0, -0.5], (len(pose), 1))
    seen = Sightings(pose, ahead, np.tile(0.01 * np.eye(3), (len(pose), 1, 1)), np.full(len(pose), 8.0))
    return Recording("EPSG:32608", path[0], fixes, odometry=odometry, sightings=seen), path


def prior(sigma: float, epoch_s: float = 0.0) -> IceMotion:
    return uniform_motion((0.0, 0.0), 0.0, velocity_sigma=sigma, lowering_sigma=sigma, epoch_s=epoch_s)


def rates(found: Localization) -> tuple[np.ndarray, np.ndarray]:
    """Rates of the motion (3,) [m/day], the last one upwards, and their standard deviations."""
    assert found.ice_motion is not None
    middle = np.zeros((1, 2))
    return found.ice_motion.rates(middle)[0], found.ice_motion.rates_sigma(middle)[0]


def test_path_and_landmarks_are_those_of_the_epoch_and_the_motion_is_found():
    recording, path = drive_on_ice(RATE)
    found = localize(recording, CONFIG, motion=prior(2.0))
    rate, sigma = rates(found)
    # Odometry errs by 0.2 m over the drive, in half a day; without places seen twice it shows the motion no better.
    assert (np.abs(rate - RATE) < sigma).all()
    assert (sigma[:2] < 0.6).all()
    np.testing.assert_allclose(found.trajectory.position, path, atol=0.08)
    # Where each pose was at its own time is known by the fixes, whatever the velocity.
    assert found.ice_motion is not None
    fixed = in_fixed_frame(found.trajectory, found.ice_motion)
    np.testing.assert_allclose(fixed.position, recording.gps.position, atol=0.02)


def test_the_epoch_decides_where_the_path_lies():
    recording, path = drive_on_ice(RATE)
    later = localize(recording, CONFIG, motion=prior(2.0, epoch_s=0.5 * DAY_S))
    np.testing.assert_allclose(later.trajectory.position, path + 0.5 * RATE, atol=0.05)


def test_a_static_estimate_of_the_same_recording_is_off_by_decimetres():
    recording, path = drive_on_ice(RATE)
    still = localize(recording, CONFIG)
    assert np.abs(still.trajectory.position - path).max() > 0.3


def test_an_exact_motion_of_zero_changes_no_bit():
    recording, _ = drive_on_ice(np.zeros(3))
    moved, still = localize(recording, CONFIG, motion=prior(0.0)), localize(recording, CONFIG)
    np.testing.assert_array_equal(moved.points.xyz, still.points.xyz)
    np.testing.assert_array_equal(moved.trajectory.covariance, still.trajectory.covariance)


def test_still_ice_has_a_velocity_of_zero_within_its_error():
    recording, _ = drive_on_ice(np.zeros(3))
    rate, sigma = rates(localize(recording, CONFIG, motion=prior(2.0)))
    assert (np.abs(rate) < 2.0 * sigma).all()


def test_loop_closures_hold_on_moving_ice():
    recording, _ = drive_on_ice(RATE)
    time_s = recording.gps.time_s
    pairs = np.arange(0, 95, 5)
    closures = LoopClosures(
        time_s[pairs + 100], time_s[pairs], np.zeros((19, 3)), np.tile(1e-4 * np.eye(3), (19, 1, 1))
    )
    # The way goes around twice, 100 poses apart.
    found = localize(replace(recording, loop_closures=closures), CONFIG, motion=prior(2.0))
    apart = found.trajectory.position[pairs + 100] - found.trajectory.position[pairs]
    assert np.abs(apart).max() < 0.03
    rate, sigma = rates(found)
    assert (np.abs(rate - RATE) < 2.0 * sigma).all()
    assert (sigma < 0.2).all()


def test_repeated_surveys_of_a_stake_give_the_velocity_where_fixes_do_not():
    recording, path = drive_on_ice(RATE)
    surveys_s = np.array([-0.5, 0.0, 0.5]) * DAY_S
    foot = path[50]
    surveys = StakeSurveys(
        surveys_s, np.zeros(3), foot + RATE * (surveys_s / DAY_S)[:, None], np.full(3, 0.02)
    )
    offset = np.zeros((1, 3))
    seen = StakeSightings(recording.gps.time_s[50:51], np.zeros(1), offset, 1e-4 * np.eye(3)[None])
    staked = replace(recording, stake_surveys=surveys, stake_sightings=seen, stakes=None)
    coarse = LocalizationConfig(gps_bias_sigma_m=3.0, gps_white_sigma_m=1.0)
    rate, sigma = rates(localize(staked, coarse, motion=prior(2.0)))
    assert (sigma < 0.04).all()
    assert (np.abs(rate - RATE) < 3.0 * sigma).all()
