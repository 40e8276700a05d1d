"""Visual odometry of sequences of images, real and drawn."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.camera import Camera
from survey.data.frames import Frames
from survey.data.sensors.records import Inertial, Wheels
from tests.vision_slam.odometry.poses import pose_at
from vision_slam.config import VisualOdometryConfig
from vision_slam.odometry.visual_odometry import visual_odometry
from vision_slam.readers.sequence import ImageSequence, scale_by_reference
from vision_slam.recordings import read_sequence


def test_real_camera_with_the_scale_of_its_first_metres(real_data: Path) -> None:
    folder = real_data / "seq_kitti_mini" / "KITTI_sequence_1"
    if not folder.is_dir():
        pytest.skip(f"the images {folder} are not here; set FIRNLINE_DATA")
    sequence = read_sequence(folder)
    assert sequence.reference is not None
    first = scale_by_reference(sequence, 10.0)
    found = visual_odometry(replace(first, reference=None, reference_time_s=None))
    path = np.vstack(
        [np.zeros(3), np.cumsum(np.einsum("nij,nj->ni", _turns(found), found.odometry.step), axis=0)]
    )
    reference = sequence.reference[:, :3, 3] - sequence.reference[0, :3, 3]
    length = np.linalg.norm(np.diff(reference, axis=0), axis=1).sum()
    assert np.linalg.norm(path[-1] - reference[-1]) < 0.015 * length


@pytest.mark.long
def test_a_real_turn_keeps_its_scale_under_a_lens_that_nothing_states(real_data: Path) -> None:
    folder = real_data / "seq_kitti_turn" / "KITTI_sequence_2"
    if not folder.is_dir():
        pytest.skip(f"the images {folder} are not here; set FIRNLINE_DATA")
    sequence = read_sequence(folder)
    assert sequence.reference is not None
    found = visual_odometry(scale_by_reference(sequence, 10.0))
    path = np.vstack(
        [np.zeros(3), np.cumsum(np.einsum("nij,nj->ni", _turns(found), found.odometry.step), axis=0)]
    )
    reference = sequence.reference[:, :3, 3] - sequence.reference[0, :3, 3]
    length = np.linalg.norm(np.diff(reference, axis=0), axis=1).sum()
    assert found.lens is not None
    assert found.lens.is_accepted
    # With the lens as it was given the path ends 16 % off.
    assert np.linalg.norm(path[-1] - reference[-1]) < 0.03 * length


def test_a_camera_that_turns_by_a_quarter_of_a_pixel_an_image_is_followed(
    plane_world: object, camera: Camera
) -> None:
    turns = np.degrees(0.25 / camera.matrix[0, 0]) * np.arange(90)
    images = tuple(plane_world.image(pose_at(0.0, turn)) for turn in turns)  # type: ignore[attr-defined]
    found = visual_odometry(ImageSequence(camera, Frames(0.05 * np.arange(90.0), images)))
    turned = found.odometry.attitude_rad[-1, 2] - found.odometry.attitude_rad[0, 2]
    assert np.degrees(turned) == pytest.approx(turns[-1], rel=0.05)
    assert np.linalg.norm(found.odometry.step, axis=1).sum() == 0.0


def test_a_camera_without_wheels_that_stands_does_not_move(plane_world: object, camera: Camera) -> None:
    view = plane_world.image(pose_at(0.0)).astype(float)  # type: ignore[attr-defined]
    rng = np.random.default_rng(6)
    images = tuple((view + rng.normal(0.0, 2.0, view.shape)).clip(0, 255).astype(np.uint8) for _ in range(30))
    found = visual_odometry(ImageSequence(camera, Frames(0.1 * np.arange(30.0), images)))
    assert np.linalg.norm(found.odometry.step, axis=1).sum() == 0.0
    assert np.abs(np.diff(found.odometry.attitude_rad, axis=0)).max() < 1e-6


def test_a_drive_that_begins_in_motion_does_not_turn_with_the_bias_of_its_gyro(
    plane_world: object, camera: Camera
) -> None:
    times = 0.25 * np.arange(60.0)
    images = tuple(plane_world.image(pose_at(0.8 * time)) for time in times)  # type: ignore[attr-defined]
    readings = np.arange(-5, 60 * 25) / 100.0
    rates = np.tile(np.radians([0.0, 0.0, 0.4]), (len(readings), 1))
    force = np.tile([0.0, 0.0, 9.81], (len(readings), 1))
    sequence = ImageSequence(
        camera,
        Frames(times, images),
        Wheels(readings, 0.8 * readings, 0.8 * readings),
        Inertial(readings, rates, force),
    )
    found = visual_odometry(sequence, VisualOdometryConfig(lens="given"))
    turned = found.odometry.attitude_rad[:, 2] - found.odometry.attitude_rad[0, 2]
    # The gyro turns by 5.9 degrees.
    assert np.degrees(np.abs(turned).max()) < 0.8


def _turns(found: object) -> FloatArray:
    attitude = found.odometry.attitude_rad[:-1]  # type: ignore[attr-defined]
    matrices: FloatArray = Rotation.from_euler("xyz", attitude).as_matrix()
    return matrices


def test_one_frame_and_images_of_another_size_are_refused(plane_world: object, camera: Camera) -> None:
    image = plane_world.image(pose_at(0.0))  # type: ignore[attr-defined]
    with pytest.raises(InputError, match="one frame"):
        visual_odometry(ImageSequence(camera, Frames(np.array([0.0]), (image,))))
    with pytest.raises(InputError, match="its calibration 320 × 240"):
        visual_odometry(ImageSequence(camera, Frames(np.array([0.0, 1.0]), (image[:100], image))))


def test_a_repeated_image_is_left_out(plane_world: object, camera: Camera) -> None:
    images = [plane_world.image(pose_at(0.2 * k)) for k in range(10)]  # type: ignore[attr-defined]
    images[5] = images[4]
    times = 0.25 * np.arange(10.0)
    found = visual_odometry(ImageSequence(camera, Frames(times, images)), VisualOdometryConfig(lens="given"))
    assert found.odometry.time_s.tolist() == times[[0, 1, 2, 3, 4, 6, 7, 8, 9]].tolist()
    length = np.linalg.norm(found.odometry.step, axis=1)
    assert length[4] == pytest.approx(2.0 * np.median(length), rel=0.1)
    assert found.notes == ("images repeated to the last byte were left out: 1",)
