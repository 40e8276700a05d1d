"""Errors of trajectories, against the numbers of an established tool on published trajectories."""

from pathlib import Path

import numpy as np
import pytest

from survey.core.errors import InputError
from survey.io.trajectory_files import read_kitti, read_tum
from vision_slam.evaluation import absolute_errors_m, alignment, match_times, relative_errors

# evo 1.38 (a GPL tool, not installed with the project) printed these for the same files; its
# own arithmetic is double precision, so 1e-6 m leaves only the order of summation.
KITTI_ATE_M = {"none": 7.790288882656827, "se3": 1.303449714565045, "sim3": 0.937709073611404}
KITTI_RPE_100M = (1.1939759245846355, np.radians(0.7288356182425308))
EQUAL_M = 1e-6


def _rms(errors: np.ndarray) -> float:
    return float(np.sqrt(np.mean(errors**2)))


@pytest.fixture
def published(real_data: Path) -> Path:
    folder = real_data / "traj_evo"
    if not folder.is_dir():
        pytest.skip(f"the published trajectories {folder} are not here; set FIRNLINE_DATA")
    return folder


@pytest.mark.parametrize("kind", ["none", "se3", "sim3"])
def test_absolute_error_on_kitti_00_equals_the_established_tool(published: Path, kind: str) -> None:
    estimate, reference = (read_kitti(published / f"KITTI_00_{name}.txt")[:, :, 3] for name in ("ORB", "gt"))
    assert _rms(absolute_errors_m(estimate, reference, kind)) == pytest.approx(KITTI_ATE_M[kind], abs=EQUAL_M)


def test_relative_error_on_kitti_00_equals_the_established_tool(published: Path) -> None:
    poses = {}
    for name in ("ORB", "gt"):
        poses[name] = np.tile(np.eye(4), (4541, 1, 1))
        poses[name][:, :3] = read_kitti(published / f"KITTI_00_{name}.txt")
    translation, rotation = relative_errors(poses["ORB"], poses["gt"], 100.0)
    assert len(translation) == 36
    assert _rms(translation) == pytest.approx(KITTI_RPE_100M[0], abs=EQUAL_M)
    # The text files keep nine digits, so rotations are orthonormal to 1e-7 only.
    assert _rms(rotation) == pytest.approx(KITTI_RPE_100M[1], abs=1e-6)


@pytest.mark.parametrize(
    ("name", "n", "rms"),
    [
        ("fr2_desk_ORB.txt", 2174, 0.006123163030157291),
        ("fr2_desk_ORB_kf_mono.txt", 118, 0.007729264783424151),
    ],
)
def test_absolute_error_on_fr2_desk_equals_the_established_tool(
    published: Path, name: str, n: int, rms: float
) -> None:
    reference, estimate = (read_tum(published / file) for file in ("fr2_desk_groundtruth.txt", name))
    first, second = match_times(reference[:, 0], estimate[:, 0])
    assert len(first) == n
    found = _rms(absolute_errors_m(estimate[second, 1:4], reference[first, 1:4], "sim3"))
    assert found == pytest.approx(rms, abs=EQUAL_M)


def test_alignment_gives_back_the_similarity_that_was_applied(rng: np.random.Generator) -> None:
    places = rng.normal(size=(30, 3))
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    moved = 1.7 * places @ turn.T + [10.0, -4.0, 3.0]
    found = alignment(places, moved)
    assert found.scale == pytest.approx(1.7)
    assert np.allclose(found.rotation, turn)
    assert absolute_errors_m(places, moved, "sim3").max() < 1e-12


def test_a_standing_trajectory_fixes_no_rotation() -> None:
    with pytest.raises(InputError, match="no rotation can be fitted"):
        alignment(np.zeros((5, 3)), np.ones((5, 3)))
