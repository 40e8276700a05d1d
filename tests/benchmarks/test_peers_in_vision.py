"""Scores of paths that programs found on the same images."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.peers_in_vision.drives import PeerDrive
from benchmarks.peers_in_vision.programs import FoundPath
from benchmarks.peers_in_vision.scores import median_run, score_of
from survey import Camera
from survey.data.frames import Frames
from vision_slam.readers.sequence import ImageSequence

N = 61


def _drive() -> PeerDrive:
    """Return a drive of 60 m along a bend without images."""
    camera = Camera("pinhole", 640, 480, np.diag([500.0, 500.0, 1.0]), np.zeros(5), np.eye(4))
    heading = np.linspace(0.0, 1.0, N)
    poses = np.tile(np.eye(4), (N, 1, 1))
    poses[:, :3, :3] = Rotation.from_rotvec(
        np.column_stack([0.0 * heading, 0.0 * heading, heading])
    ).as_matrix()
    poses[1:, :2, 3] = np.cumsum(np.column_stack([np.cos(heading[1:]), np.sin(heading[1:])]), axis=0)
    time_s = np.arange(float(N))
    return PeerDrive(
        "bend", ImageSequence(camera, Frames(time_s, []), reference_time_s=time_s, reference=poses)
    )


def _found(drive: PeerDrive, scale: float, index: np.ndarray, aside_m: float = 0.0) -> FoundPath:
    """Return the reference in another frame and scale, with the middle displaced."""
    poses = drive.reference[index].copy()
    poses[len(index) // 2, 2, 3] += aside_m
    poses[:, :3, 3] *= scale
    other = np.eye(4)
    other[:3, :3], other[:3, 3] = Rotation.from_rotvec([0.3, -0.2, 0.9]).as_matrix(), [5.0, 6.0, 7.0]
    return FoundPath(index, other @ poses, 10.0, N)


def test_a_path_in_another_frame_and_scale_has_no_error() -> None:
    """End error, error of shape and drift are 0; speed is that of all images."""
    drive = _drive()
    score = score_of(drive, "any", _found(drive, 0.37, np.arange(N)))
    assert score.is_followed
    assert score.n_lost == 0
    found = [*score.end_per_cent.values(), score.ate_m, score.drift_per_cent]
    assert found == pytest.approx([0.0] * 4, abs=1e-6)
    assert score.frames_per_s == pytest.approx(N / 10.0)


def test_lost_images_are_counted() -> None:
    """A path of two thirds of the images is scored and counts as not followed; one of nine is no path."""
    drive = _drive()
    some = score_of(drive, "any", _found(drive, 1.0, np.arange(40)))
    assert (some.n_lost, some.is_followed, some.failed) == (N - 40, False, "")
    assert score_of(drive, "any", _found(drive, 1.0, np.arange(9))).failed


def test_the_run_with_the_median_error_counts() -> None:
    """Of three runs the one between the other two, a run without a path as the worst."""
    drive, every = _drive(), np.arange(N)
    runs = [_found(drive, 1.0, part, aside) for part, aside in ((every, 0.0), (every[:5], 0.0), (every, 3.0))]
    error_m = median_run(drive, "any", runs).ate_m
    assert error_m == pytest.approx(score_of(drive, "any", runs[2]).ate_m)
    assert 0.2 < error_m < 1.0
