"""Ties between drives: places that two rovers saw from above, on drawn ground whose poses are known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.camera import Camera
from survey.data.frames import Frames
from survey.data.sensors.odometry import DriveTies, Odometry, Sightings
from survey.data.trajectory import Trajectory
from vision_slam.odometry.odometer import VisualOdometry
from vision_slam.places.loop_closures import SeenDrive, detect_drive_ties

STEP_M, N_POSES = 0.25, 28
NO_LANDMARKS = Sightings(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0))
DRIFT = np.array([0.6, -0.4, 0.3])


def straight(
    camera: Camera, plane_world: object, start: tuple[float, float], heading_deg: float
) -> SeenDrive:
    """A straight drive of 7 m with exact images, and its real path."""
    heading = np.radians(heading_deg)
    ahead = np.array([np.cos(heading), np.sin(heading), 0.0])
    places = np.array([*start, 0.0]) + STEP_M * np.arange(N_POSES)[:, None] * ahead
    turn = Rotation.from_euler("z", heading)
    poses = np.tile(np.eye(4), (N_POSES, 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = turn.as_matrix(), places
    times = STEP_M * np.arange(N_POSES)
    attitude = np.tile([0.0, 0.0, heading], (N_POSES, 1))
    odometry = Odometry(times, np.tile([STEP_M, 0.0, 0.0], (N_POSES - 1, 1)), attitude)
    images = [plane_world.image(pose) for pose in poses]  # type: ignore[attr-defined]
    visual = VisualOdometry(odometry, NO_LANDMARKS, (), np.zeros(N_POSES, dtype=bool))
    return SeenDrive(Frames(times, images), camera, visual, path_of(times, places, turn))


def path_of(times: FloatArray, places: FloatArray, turn: Rotation) -> Trajectory:
    quaternions = np.tile(turn.as_quat(), (len(times), 1))
    covariance = np.tile(0.3**2 * np.eye(3), (len(times), 1, 1))
    return Trajectory(times, places, quaternions, covariance, "EPSG:32608")  # type: ignore[arg-type]


def moved(drive: SeenDrive, by: FloatArray) -> SeenDrive:
    """Return a drive whose estimated path is off."""
    path = drive.trajectory
    return drive._replace(trajectory=replace(path, position=path.position + by))


@pytest.fixture(scope="module")
def drives(camera: Camera, plane_world: object) -> list[SeenDrive]:
    return [straight(camera, plane_world, (0.0, 0.0), 0.0), straight(camera, plane_world, (4.0, -3.5), 90.0)]


def test_two_drives_are_tied_where_they_cross(drives: list[SeenDrive]) -> None:
    real = [drive.trajectory for drive in drives]
    found = detect_drive_ties([drives[0], moved(drives[1], DRIFT)])
    assert found is not None
    assert set(found.first) == {0.0}
    assert set(found.second) == {1.0}
    one, other = (
        np.searchsorted(real[0].time_s, found.time_s),
        np.searchsorted(real[1].time_s, found.second_s),
    )
    # A cell of the view is 2.5 cm wide, and features of two views differ by about as much.
    assert np.abs(found.offset - (real[1].position[other] - real[0].position[one])).max() < 0.06
    np.testing.assert_allclose(found.covariance, found.covariance.transpose(0, 2, 1))


def test_drives_that_stay_apart_have_no_ties(drives: list[SeenDrive]) -> None:
    assert detect_drive_ties([drives[0], moved(drives[1], np.array([0.0, 40.0, 0.0]))]) is None


def test_lengths_without_a_scale_are_refused(drives: list[SeenDrive]) -> None:
    unscaled = replace(drives[0].visual, lever_arm_m=np.array([0.0, 0.0, 0.7]))
    with pytest.raises(InputError, match="lengths in metres"):
        detect_drive_ties([drives[0]._replace(visual=unscaled), drives[1]])


def test_ties_are_written_and_read_back(tmp_path) -> None:  # type: ignore[no-untyped-def]
    ties = DriveTies([1.0], [0], [1], [2.0], [[0.1, 0.2, 0.3]], [np.eye(3)])  # type: ignore[arg-type]
    ties.write(tmp_path / "ties.csv")
    assert DriveTies.read(tmp_path / "ties.csv") == ties
    with pytest.raises(InputError, match="do not name two drives"):
        DriveTies([1.0], [1], [1], [2.0], [[0.1, 0.2, 0.3]], [np.eye(3)])  # type: ignore[arg-type]
