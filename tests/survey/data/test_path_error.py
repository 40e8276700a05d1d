"""The error of a path: what its keyframes share, kept and given back."""

import numpy as np
import pytest
from scipy import sparse

from survey import InputError
from survey.data.path_error import POSE, PathError
from survey.data.trajectory import Trajectory

CRS = "EPSG:32608"


def chain_error(n_keyframes: int = 5, n_states: int = 8) -> PathError:
    """A random chain with two globals behind it; every unknown has a prior."""
    rng = np.random.default_rng(3)
    size = n_keyframes * n_states + 2
    information = np.eye(size)
    for k in range(n_keyframes - 1):
        rows = np.zeros((n_states, size))
        rows[:, k * n_states : (k + 2) * n_states] = rng.normal(size=(n_states, 2 * n_states))
        rows[:, -2:] = rng.normal(size=(n_states, 2))
        information += rows.T @ rows
    return PathError(np.arange(n_keyframes) * 10.0, sparse.csr_array(information), n_states)


def test_covariance_of_any_function_is_that_of_the_dense_inverse():
    error = chain_error()
    rng = np.random.default_rng(4)
    rows = error.rows(np.array([0.0, 1.25, 3.5, 4.0]), rng.normal(size=(4, POSE)))
    dense = rows.toarray() @ np.linalg.inv(error.information.toarray()) @ rows.toarray().T
    # Two factorizations of a matrix with a condition of about 1e3.
    np.testing.assert_allclose(error.covariance(rows), dense, rtol=1e-10, atol=1e-12)


def test_marginals_of_poses_between_keyframes_agree_with_the_rows():
    error = chain_error()
    place = np.array([2.3])
    by_each = error.rows(np.repeat(place, POSE), np.eye(POSE))
    np.testing.assert_allclose(error.pose_covariance(place)[0], error.covariance(by_each), atol=1e-12)


def test_path_error_survives_the_run_folder(tmp_path):
    error = chain_error()
    n = 41
    turn = np.tile([0.0, 0.0, 0.0, 1.0], (n, 1))
    path = Trajectory(
        np.arange(n) * 1.0, np.zeros((n, 3)), turn, np.tile(np.eye(3), (n, 1, 1)), CRS, error=error
    )
    path.write(tmp_path / "trajectory.csv")
    back = Trajectory.read(tmp_path / "trajectory.csv", CRS).error
    assert back is not None
    np.testing.assert_array_equal(back.information.toarray(), error.information.toarray())
    np.testing.assert_array_equal(back.time_s, error.time_s)
    first = (tmp_path / "trajectory.error.npz").read_bytes()
    path.write(tmp_path / "trajectory.csv")
    assert (tmp_path / "trajectory.error.npz").read_bytes() == first


def test_a_damaged_file_is_refused_in_one_sentence(tmp_path):
    file = tmp_path / "trajectory.error.npz"
    chain_error().write(file)
    file.write_bytes(file.read_bytes()[:200])
    with pytest.raises(InputError, match="localize again"):
        PathError.read(file)


def test_keyframes_of_another_path_are_refused():
    with pytest.raises(InputError, match="do not belong together"):
        chain_error().rows(np.array([7.0]), np.zeros((1, POSE)))


def test_errors_of_several_drives_are_joined_without_correlation(tmp_path):
    long, short = chain_error(5), chain_error(3)
    joined = PathError.joined([long, short])
    by_pose = np.eye(POSE)[:2]
    rows = joined.rows(np.array([4.0, 5.5]), by_pose)
    covariance = joined.covariance(rows)
    alone = [
        error.covariance(error.rows(np.array([at]), by_pose[k : k + 1]))[0, 0]
        for k, (error, at) in enumerate([(long, 4.0), (short, 0.5)])
    ]
    np.testing.assert_allclose(np.diag(covariance), alone, rtol=1e-10)
    assert covariance[0, 1] == pytest.approx(0.0, abs=1e-14)
    assert joined.drive_of(np.array([0.0, 4.0, 5.0, 7.0])).tolist() == [0, 0, 1, 1]
    assert (np.diff(joined.time_s) > 0.0).all()
    joined.write(tmp_path / "error.npz")
    assert PathError.read(tmp_path / "error.npz") == joined
    with pytest.raises(InputError, match="unknowns per keyframe"):
        PathError.joined([long, chain_error(3, 6)])


def test_text_of_poses_is_read_whatever_its_ending(tmp_path):
    (tmp_path / "a.txt").write_text("# ground truth\n1 2 3 4 0 0 0 1\n2 2 3 5 0 0 0 1\n")
    assert Trajectory.read(tmp_path / "a.txt", CRS).position.tolist() == [[2.0, 3.0, 4.0], [2.0, 3.0, 5.0]]
