"""Visual SLAM on drawn images whose motion is known."""

import cv2
import numpy as np
import pytest
from pyproj import CRS
from scipy.spatial.transform import Rotation
from threadpoolctl import threadpool_limits

from survey.core.arrays import FloatArray
from survey.data.camera import Camera
from survey.data.frames import Frames
from survey.data.recording import Recording
from survey.data.sensors.records import GpsFixes, Inertial, Wheels
from tests.vision_slam.odometry.poses import pose_at
from vision_slam.config import LocalizationConfig
from vision_slam.motion import RelativeMotion
from vision_slam.odometry.visual_odometry import visual_odometry
from vision_slam.odometry.visual_slam import VisualSlam
from vision_slam.pipeline import localize
from vision_slam.readers.sequence import ImageSequence


def _even(n: int, step: float) -> FloatArray:
    return np.asarray(np.arange(n) * step, dtype=np.float64)


def _driven(world: object, camera: Camera, poses: list[FloatArray], travel: bool = True) -> VisualSlam:
    slam = VisualSlam(camera)
    for k, pose in enumerate(poses):
        motion = None
        if k:
            step = np.linalg.inv(poses[k - 1]) @ pose
            motion = RelativeMotion(0.25, step[:3, :3], float(step[0, 3]) if travel else None)
        slam.step(world.image(pose), 0.25 * k, motion)  # type: ignore[attr-defined]
    return slam


def test_follows_a_straight_drive_and_maps_the_ground(plane_world: object, camera: Camera) -> None:
    poses = [pose_at(0.2 * k) for k in range(20)]
    slam = _driven(plane_world, camera, poses)
    end = slam.pose(slam.frames[-1])
    # The wheels are exact here; sideways and in height only images measure: 1 % of the path.
    assert np.linalg.norm(end[:3, 3] - poses[-1][:3, 3]) < 0.01 * 3.8
    known = np.array(
        [track.point for track in slam.live_tracks if track.point is not None and not track.is_far]
    )
    assert len(known) > 50
    assert abs(np.median(known[:, 2])) < 0.02


def test_wheels_that_slip_for_a_while_do_not_stretch_the_path(plane_world: object, camera: Camera) -> None:
    poses = [pose_at(0.2 * k) for k in range(24)]
    slam = VisualSlam(camera)
    for k, pose in enumerate(poses):
        rolled = 0.2 if k < 12 or k >= 18 else 0.3
        motion = None if k == 0 else RelativeMotion(0.25, np.eye(3), rolled)
        slam.step(plane_world.image(pose), 0.25 * k, motion)  # type: ignore[attr-defined]
    # Wheels alone would end 0.6 m too far; images keep the scale of the metres before.
    assert abs(slam.pose(slam.frames[-1])[0, 3] - poses[-1][0, 3]) < 0.15


def test_without_wheels_the_first_step_is_the_unit(plane_world: object, camera: Camera) -> None:
    """Images and gyro alone, no place and no scale given: they give only the shape of the path."""
    poses = [pose_at(0.2 * k) for k in range(16)]
    slam = _driven(plane_world, camera, poses, travel=False)
    path = np.array([slam.pose(frame)[:3, 3] for frame in slam.frames])
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    # The unit is that of the first guess, which the first window may stretch; all steps are equal here.
    assert np.abs(steps[2:] / np.median(steps) - 1.0).max() < 0.1
    assert np.linalg.norm(path[-1, 1:]) < 0.02 * path[-1, 0]


def test_a_turn_from_the_first_image_on_is_followed_without_wheels_and_gyro(
    plane_world: object, camera: Camera
) -> None:
    """A bend of 4 degrees an image: no straight step precedes it, and corners move by 20 pixels and more."""
    yaw_deg = 4.0 * np.arange(16.0)
    poses = [pose_at(0.0, yaw) for yaw in yaw_deg]
    ahead = np.column_stack([np.cos(np.radians(yaw_deg)), np.sin(np.radians(yaw_deg))])
    for k in range(1, len(poses)):
        poses[k][:2, 3] = poses[k - 1][:2, 3] + 0.3 * ahead[k - 1]
    slam = VisualSlam(camera, ground_height=0.7)
    for k, pose in enumerate(poses):
        motion = RelativeMotion(0.25, None, None) if k else None
        slam.step(plane_world.image(pose), 0.25 * k, motion)  # type: ignore[attr-defined]
    assert all(frame.health.is_visual for frame in slam.frames[1:])
    end = slam.pose(slam.frames[-1])
    turned = Rotation.from_matrix(end[:3, :3]).as_euler("zyx", degrees=True)[0]
    # Small images of a plane leave a tenth of a degree an image.
    assert turned == pytest.approx(yaw_deg[-1], abs=1.5)


def test_a_frozen_camera_does_not_hold_the_rover_back(plane_world: object, camera: Camera) -> None:
    poses = [pose_at(0.2 * k) for k in range(22)]
    slam = VisualSlam(camera)
    for k in range(len(poses)):
        shown = poses[min(k, 9)] if k < 15 else poses[k]
        slam.step(plane_world.image(shown), 0.25 * k, RelativeMotion(0.25, np.eye(3), 0.2) if k else None)  # type: ignore[attr-defined]
    is_visual = [frame.health.is_visual for frame in slam.frames]
    assert all(is_visual[1:10])
    assert not any(is_visual[10:15])
    # New corners are looked for at the next keyframe, a frame or two after the freeze.
    assert all(is_visual[18:])
    assert (
        np.linalg.norm(slam.pose(slam.frames[-1])[:3, 3] - poses[-1][:3, 3]) < 0.01 * 4.2
    )  # 1 % of the path


def test_a_turn_without_images_is_not_cut_short(plane_world: object, camera: Camera) -> None:
    # 2 m straight on, a quarter of a circle of 2 m without images, 2 m on to the left, at 1 m/s.
    def pose_after(time_s: float) -> FloatArray:
        angle = float(np.clip((time_s - 2.0) / 2.0, 0.0, np.pi / 2.0))
        before, after = min(time_s, 2.0), max(time_s - 2.0 - np.pi, 0.0)
        pose = pose_at(before + 2.0 * np.sin(angle), np.degrees(angle))
        pose[1, 3] = 2.0 * (1.0 - np.cos(angle)) + after
        return pose

    times = np.asarray(np.linspace(0.0, 6.8, 35), dtype=np.float64)
    taken = times[(times <= 2.0) | (times >= 5.2)]
    images = [plane_world.image(pose_after(time_s)) for time_s in taken]  # type: ignore[attr-defined]
    steady = np.asarray(np.linspace(0.0, 7.0, 141), dtype=np.float64)
    rates = np.where((steady > 2.0) & (steady <= 2.0 + np.pi), 0.5, 0.0)[:, None] * [0.0, 0.0, 1.0]
    inertial = Inertial(steady, rates, np.tile([0.0, 0.0, 9.81], (len(steady), 1)))
    drive = ImageSequence(camera, Frames(taken, images), Wheels(steady, steady, steady), inertial)
    odometry = visual_odometry(drive).odometry
    turns = Rotation.from_euler("xyz", odometry.attitude_rad[:-1]).as_matrix()
    end = np.einsum("nij,nj->i", turns, odometry.step)
    # Wheels and gyro are exact but for their sampling; the chord would end a metre off.
    assert np.linalg.norm(end - (pose_after(taken[-1]) - pose_after(0.0))[:3, 3]) < 0.15
    assert len(odometry.time_s) > len(taken) + 8


def test_turning_on_the_spot_moves_nothing(plane_world: object, camera: Camera) -> None:
    poses = [pose_at(0.2 * k) for k in range(8)] + [pose_at(1.4, 4.0 * k) for k in range(1, 12)]
    slam = _driven(plane_world, camera, poses)
    end = slam.pose(slam.frames[-1])
    assert np.linalg.norm(end[:3, 3] - poses[-1][:3, 3]) < 0.03
    turn = Rotation.from_matrix(end[:3, :3].T @ poses[-1][:3, :3]).magnitude()
    assert np.degrees(turn) < 0.5


def test_a_standing_camera_invents_no_motion(plane_world: object, camera: Camera) -> None:
    rng = np.random.default_rng(2)
    slam = VisualSlam(camera)
    scene = plane_world.image(pose_at(0.0)).astype(float)  # type: ignore[attr-defined]
    for k in range(15):
        noisy = (scene + rng.normal(0.0, 1.3, scene.shape)).clip(0, 255).astype(np.uint8)
        slam.step(noisy, 0.25 * k, RelativeMotion(0.25, None, None) if k else None)
    assert np.array_equal(slam.pose(slam.frames[-1]), np.eye(4))
    assert slam.window.newest == 0


def test_wheels_and_gyro_bridge_a_whiteout_that_is_declared(plane_world: object, camera: Camera) -> None:
    rng = np.random.default_rng(3)
    slam = VisualSlam(camera)
    for k in range(24):
        image = plane_world.image(pose_at(0.2 * k))  # type: ignore[attr-defined]
        if 10 <= k < 15:
            image = (235 + rng.normal(0.0, 1.3, image.shape)).clip(0, 255).astype(np.uint8)
        slam.step(image, 0.25 * k, RelativeMotion(0.25, np.eye(3), 0.2) if k else None)
    visual = [frame.health.is_visual for frame in slam.frames]
    assert not any(visual[10:15])
    # The first images after it find new corners, which are known from the second on.
    assert all(visual[17:])
    assert np.linalg.norm(slam.pose(slam.frames[-1])[:3, 3] - [4.6, 0.0, 0.0]) < 0.05


def test_steps_of_exposure_do_not_lose_the_corners(plane_world: object, camera: Camera) -> None:
    """Half the light, then all of it, then one and a half: as with none of this."""
    slam = VisualSlam(camera)
    for k in range(24):
        light = 0.5 if 8 <= k < 14 else 1.3 if k >= 18 else 1.0
        image = np.clip(light * plane_world.image(pose_at(0.2 * k)), 0, 255).astype(np.uint8)  # type: ignore[attr-defined]
        slam.step(image, 0.25 * k, RelativeMotion(0.25, np.eye(3), 0.2) if k else None)
    assert all(frame.health.is_visual for frame in slam.frames[1:])
    assert np.linalg.norm(slam.pose(slam.frames[-1])[:3, 3] - [4.6, 0.0, 0.0]) < 0.01 * 4.6


def test_the_few_corners_that_outlive_a_leap_are_rejected(plane_world: object, camera: Camera) -> None:
    """One image shows other ground but for a strip: what is followed in the strip is too little for a pose."""
    slam = VisualSlam(camera)
    for k in range(14):
        image = plane_world.image(pose_at(0.2 * k)).copy()  # type: ignore[attr-defined]
        if k >= 10:
            strange = plane_world.image(pose_at(40.0 + 0.2 * k))  # type: ignore[attr-defined]
            image[:, 60:] = strange[:, 60:]
        slam.step(image, 0.25 * k, RelativeMotion(0.25, np.eye(3), 0.2) if k else None)
    is_visual = [frame.health.is_visual for frame in slam.frames]
    assert all(is_visual[1:10])
    assert not is_visual[10]
    assert all(is_visual[12:])


def test_steps_that_nothing_saw_say_so(plane_world: object, camera: Camera) -> None:
    """Four blank frames of 0.2 m each: together they are good to 5 % of the way, and all others as usual."""
    images = [plane_world.image(pose_at(0.2 * k)) for k in range(16)]  # type: ignore[attr-defined]
    for k in range(8, 12):
        images[k] = np.full_like(images[k], 235)
    times, rolled = _even(16, 0.25), _even(16, 0.2)
    steady = Inertial(times, np.zeros((16, 3)), np.tile([0.0, 0.0, 9.81], (16, 1)))
    found = visual_odometry(
        ImageSequence(camera, Frames(times, images), Wheels(times, rolled, rolled), steady)
    )
    sigma = found.odometry.step_sigma_m
    assert sigma is not None
    is_blind = np.array([not frame.is_visual for frame in found.health[1:]])
    assert is_blind[7:11].all()
    assert ((sigma > 0.0) == is_blind).all()
    assert np.sqrt((sigma**2).sum()) == pytest.approx(0.05 * 0.2 * is_blind.sum(), rel=0.02)


def test_the_same_images_give_the_same_bytes_with_one_thread_and_two(
    plane_world: object, camera: Camera
) -> None:
    poses = [pose_at(0.2 * k, 0.5 * k) for k in range(8)]
    n_threads, found = cv2.getNumThreads(), []
    try:
        for n in (1, 2):
            cv2.setNumThreads(n)
            found.append(np.array(_driven(plane_world, camera, poses).window.poses).tobytes())
    finally:
        cv2.setNumThreads(n_threads)
    assert found[0] == found[1]


def test_the_same_recording_gives_the_same_bytes_with_one_thread_and_two(
    plane_world: object, camera: Camera
) -> None:
    found = []
    n_threads = cv2.getNumThreads()
    try:
        for n in (1, 2):
            cv2.setNumThreads(n)
            with threadpool_limits(n):
                result = localize(_short_recording(plane_world, camera, 12), _PRECISE)
            trajectory, points = result.trajectory, result.points
            parts = (trajectory.position, trajectory.quaternion, trajectory.covariance, points.xyz)
            found.append(b"".join(np.asarray(part).tobytes() for part in parts))
    finally:
        cv2.setNumThreads(n_threads)
    assert found[0] == found[1]


def test_colour_and_grey_are_the_same_drive(plane_world: object, camera: Camera) -> None:
    images = [plane_world.image(pose_at(0.2 * k)) for k in range(3)]  # type: ignore[attr-defined]
    grey, colour = VisualSlam(camera), VisualSlam(camera)
    for k, image in enumerate(images):
        motion = RelativeMotion(0.25, np.eye(3), 0.2) if k else None
        grey.step(image, 0.25 * k, motion)
        colour.step(np.repeat(image[:, :, None], 3, axis=2), 0.25 * k, motion)
    assert np.array_equal(grey.window.poses[-1], colour.window.poses[-1])


_PRECISE = LocalizationConfig(gps_bias_sigma_m=0.01, gps_white_sigma_m=0.01, landmark_min_range_m=0.5)


def _short_recording(plane_world: object, camera: Camera, n: int) -> Recording:
    """A straight drive from a known start: wheels a hundredth too long, fixes good to a centimetre."""
    times, rolled = _even(n, 0.25), _even(n, 1.01 * 0.2)
    images = tuple(plane_world.image(pose_at(0.2 * k)) for k in range(n))  # type: ignore[attr-defined]
    place = np.column_stack([_even(n, 0.2), np.zeros(n), np.zeros(n)]) + [5e5, 6e6, 100.0]
    return Recording(
        crs=CRS.from_epsg(32608), start=place[0], gps=GpsFixes(times, place), camera=camera,
        frames=Frames(times, images), wheels=Wheels(times, rolled, rolled),
    )  # fmt: skip


def test_localize_turns_images_into_a_path_and_landmarks(plane_world: object, camera: Camera) -> None:
    recording = _short_recording(plane_world, camera, 20)
    result = localize(recording, _PRECISE)
    trajectory, points = result.trajectory, result.points
    assert trajectory.health.all()
    assert np.linalg.norm(trajectory.position - recording.gps.position, axis=1).max() < 0.03
    assert abs(np.median(points.xyz[:, 2]) - 100.0) < 0.03
    assert len(points.xyz) > 100


def test_a_gap_in_the_images_is_predicted_by_its_length(plane_world: object, camera: Camera) -> None:
    """Without wheels and gyro, three images are missing after the tenth; the times are right."""
    slam = VisualSlam(camera)
    numbers = [k for k in range(18) if not 10 < k < 14]
    times = 0.25 * np.array(numbers)
    for n, k in enumerate(numbers):
        motion = RelativeMotion(float(times[n] - times[n - 1]), None, None) if n else None
        slam.step(plane_world.image(pose_at(0.125 * k)), float(times[n]), motion)  # type: ignore[attr-defined]
    at = np.array([slam.pose(frame)[0, 3] for frame in slam.frames])
    # One frame is predicted alone: the error of the last step, a twentieth, counts four times.
    assert (at[11] - at[10]) / (at[10] / 10.0) == pytest.approx(4.0, rel=0.05)
