"""Photographs far apart: cameras and ground from shared features, and their place by fixes."""

from dataclasses import replace

import numpy as np
import pytest

from survey import Recording
from survey.core import InputError, stream
from survey.data.frames import Frames
from survey.data.sensors.records import GpsFixes, Wheels
from tests.printing import assert_printable
from tests.vision_slam.photographed_ground import LENS, flight, height_m, photograph, texture, with_distortion
from vision_slam import localize
from vision_slam.config import LocalizationConfig
from vision_slam.photographs.georeference import georeferenced
from vision_slam.photographs.localization import are_far_apart
from vision_slam.photographs.matches import tracks_of
from vision_slam.photographs.structure import reconstruct_cameras
from vision_slam.pipeline import localize_images
from vision_slam.plotting import features_on_photographs
from vision_slam.readers.sequence import ImageSequence

TRUE_LENS = with_distortion(LENS, -0.05, 1.03)
GIVEN = replace(LENS, distortion_is_assumed=True)
ORIGIN = np.array([5e5, 6.7e6, 300.0])
POSES = flight(2, 2, 5, 9.0, 26.0, 80.0)
TIME_S = 5.0 * np.arange(len(POSES))


class Images(list):
    """Photographs in memory."""


@pytest.fixture(scope="module")
def frames():
    """Photographs of a lens that its header does not state."""
    ground = texture(1)
    return Frames(TIME_S, Images(photograph(pose, TRUE_LENS, ground) for pose in POSES))


@pytest.fixture(scope="module")
def structure(frames):
    return reconstruct_cameras(tracks_of(frames), GIVEN)


def recording(frames, offset_m, camera=GIVEN):
    """Return the photographs with fixes that are off by so much (N, 3)."""
    place = ORIGIN + POSES[:, :3, 3] + offset_m
    return Recording(
        "EPSG:32608", place[0], GpsFixes(TIME_S, place), camera=camera, frames=frames, start_is_surveyed=False
    )


def receiver_errors(seed):
    """Return errors of a receiver as the settings assume them: a level that lasts, and one of each fix."""
    draw = stream(seed, "fixes")
    axes = np.array([1.0, 1.0, 1.7])
    return axes * (draw.standard_normal(3) + 0.5 * draw.standard_normal((len(POSES), 3)))


def test_cameras_and_ground_have_the_right_shape_and_the_lens_is_found(structure):
    assert structure.image.tolist() == list(range(len(POSES)))
    estimate, real = structure.poses[:, :3, 3], POSES[:, :3, 3]
    estimate, real = estimate - estimate.mean(axis=0), real - real.mean(axis=0)
    u, size, v = np.linalg.svd(real.T @ estimate)
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ v))])
    scale = (size * sign).sum() / (estimate**2).sum()
    off = scale * estimate @ (u * sign @ v).T - real
    assert np.linalg.norm(off, axis=1).max() < 0.1
    assert structure.camera.matrix[0, 0] == pytest.approx(TRUE_LENS.matrix[0, 0], rel=0.01)
    assert structure.camera.distortion[0] == pytest.approx(-0.05, abs=0.01)


def test_path_and_ground_lie_within_their_errors_in_the_crs(frames, structure):
    squares, off_ground = [], []
    for seed in range(6):
        found = georeferenced(structure, recording(frames, receiver_errors(seed)), LocalizationConfig())
        off = found.trajectory.position - ORIGIN - POSES[:, :3, 3]
        information = np.linalg.inv(found.trajectory.covariance)
        squares.append(np.einsum("ni,nij,nj->n", off, information, off).mean() / 3.0)
        points = found.points
        x, y, z = (points.xyz - ORIGIN).T
        off_ground.append((z - height_m(x, y)) / points.sigma_z)
    assert 0.3 < np.mean(squares) < 2.0
    assert np.mean(np.abs(np.concatenate(off_ground)) < 1.96) > 0.85
    assert np.median(np.sqrt(points.own_covariance[:, 2, 2])) < 0.05
    assert found.trajectory.error is not None
    assert set(points.keyframe.tolist()) <= set(range(len(POSES)))


def test_a_fix_that_contradicts_the_photographs_is_left_out(frames, structure):
    errors = receiver_errors(1)
    errors[3] += [40.0, 0.0, 0.0]
    found = georeferenced(structure, recording(frames, errors), LocalizationConfig())
    assert (found.n_fixes, found.n_fixes_refused) == (len(POSES), 1)
    assert any("contradict the photographs" in note for note in found.notes)
    assert np.linalg.norm(found.trajectory.position - ORIGIN - POSES[:, :3, 3], axis=1).max() < 4.0


def test_fixes_that_scatter_more_than_assumed_widen_the_errors(frames, structure):
    errors = 5.0 * stream(5, "fixes").standard_normal((len(POSES), 3))
    found = georeferenced(structure, recording(frames, errors), LocalizationConfig())
    assert any("the fixes scatter by" in note for note in found.notes)
    off = found.trajectory.position - ORIGIN - POSES[:, :3, 3]
    information = np.linalg.inv(found.trajectory.covariance)
    assert np.einsum("ni,nij,nj->n", off, information, off).mean() / 3.0 < 3.0


def test_too_few_fixes_are_refused(frames, structure):
    one = recording(frames, receiver_errors(1))
    few = replace(one, gps=one.gps.select(np.arange(len(POSES)) < 3))
    with pytest.raises(
        InputError, match="3 of the 10 photographs that could be placed have a fix within 2 s"
    ):
        georeferenced(structure, few, LocalizationConfig())


def test_fixes_that_stay_in_one_place_are_refused(frames, structure):
    one = recording(frames, receiver_errors(1))
    same = replace(one, gps=replace(one.gps, position=np.tile(ORIGIN, (len(POSES), 1))))
    with pytest.raises(InputError, match=r"scatter by 0\.0 m about their middle, too little for a scale"):
        georeferenced(structure, same, LocalizationConfig())


def test_the_error_of_the_scale_grows_where_fixes_are_near(frames, structure):
    def scale_sigma(factor):
        one = recording(frames, receiver_errors(1))
        near = replace(one.gps, position=ORIGIN + factor * (one.gps.position - ORIGIN))
        notes = georeferenced(structure, replace(one, gps=near), LocalizationConfig()).notes
        return float(next(note for note in notes if "the scale" in note).split()[-2])

    assert 1.5 * scale_sigma(1.0) < scale_sigma(0.3) < 30.0


def test_localization_takes_photographs_that_cannot_be_followed(frames):
    found = localize(recording(frames, receiver_errors(2)))
    assert any("10 of 10 were placed by features" in note for note in found.notes)
    assert any("the lens was estimated" in note for note in found.notes)
    assert found.visual_odometry is None
    assert len(found.points.xyz) > 500


def test_shared_features_are_drawn_on_two_photographs(frames):
    figure = features_on_photographs(frames)
    assert_printable(figure)
    left, right = figure.axes
    assert left.get_title(loc="left").startswith("Image ")
    assert right.get_title(loc="left").startswith("Found again in image ")
    shown = [np.asarray(panel.collections[0].get_offsets()) for panel in (left, right)]
    assert len(shown[0]) == len(shown[1]) > 50
    # The camera moved: the ground in both images is not at one place of them.
    assert np.median(np.abs(shown[0] - shown[1])) > 20.0


def test_photographs_without_fixes_are_placed_in_a_unit_of_their_own(frames):
    found = localize_images(ImageSequence(GIVEN, frames))
    assert any("lengths have no scale" in note for note in found.notes)
    real = np.linalg.norm(POSES[:, None, :3, 3] - POSES[:, :3, 3], axis=2)
    own = np.linalg.norm(found.position[:, None] - found.position, axis=2)
    ratio = own[real > 5.0] / real[real > 5.0]
    assert np.ptp(ratio) < 0.02 * ratio.mean()
    np.testing.assert_allclose(found.position[0], 0.0, atol=1e-9)


def test_photographs_of_a_camera_held_both_ways_are_placed():
    poses = flight(4, 2, 3, 9.0, 26.0, 80.0)
    poses[1::2, :3, :3] = poses[1::2, :3, :3] @ [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    ground, times = texture(4), TIME_S[: len(poses)]
    frames = Frames(times, Images(photograph(pose, LENS, ground) for pose in poses))
    place = ORIGIN + poses[:, :3, 3]
    exact = Recording(
        "EPSG:32608", place[0], GpsFixes(times, place), camera=LENS, frames=frames, start_is_surveyed=False
    )
    found = georeferenced(reconstruct_cameras(tracks_of(frames), LENS), exact, LocalizationConfig())
    # Those held across count as level, which they are within the ten degrees by which the camera looks ahead.
    assert np.linalg.norm(found.trajectory.position - place, axis=1).max() < 0.5
    x, y, z = (found.points.xyz - ORIGIN).T
    assert np.median(np.abs(z - height_m(x, y))) < 0.5


def test_photographs_of_different_places_are_not_placed():
    pictures = [photograph(POSES[0], LENS, texture(seed)) for seed in (3, 4, 5, 6)]
    matches = tracks_of(Frames(TIME_S[:4], Images(pictures)))
    assert reconstruct_cameras(matches, LENS) is None
    blank = Frames(TIME_S[:4], Images(np.full_like(picture, 90) for picture in pictures))
    assert reconstruct_cameras(tracks_of(blank), LENS) is None


def test_drives_with_wheels_and_images_that_can_be_followed_are_left_to_odometry(frames):
    one = recording(frames, receiver_errors(2))
    rolled = np.linalg.norm(POSES[:, :3, 3] - POSES[0, :3, 3], axis=1)
    health = [type("Frame", (), {"is_visual": k > 3}) for k in range(len(POSES))]
    visual = type("Visual", (), {"health": health})
    assert not are_far_apart(replace(one, wheels=Wheels(TIME_S, rolled, rolled)), visual)
    assert not are_far_apart(one, visual)
    health[5:8] = [health[0]] * 3
    assert are_far_apart(one, visual)
