import numpy as np
import pytest

from survey import InputError
from survey.data.ice_motion import IceMotion, read_motion, write_motion

DAY_S = 86400.0


def strained() -> IceMotion:
    coefficients = np.array([[2.0, 0.5, -1.0], [0.3, 0.0, 0.2], [0.1, 0.0, 0.0]])
    return IceMotion.of(
        coefficients, np.diag(np.arange(9.0)), epoch_s=3600.0, origin_m=np.array([500.0, 200.0])
    )


def test_places_at_the_epoch_are_found_again():
    motion, rng = strained(), np.random.default_rng(3)
    at_epoch = rng.uniform(0.0, 1000.0, (20, 3))
    time_s = rng.uniform(-DAY_S, 3.0 * DAY_S, 20)
    now = at_epoch + motion.displacement(at_epoch[:, :2], time_s)
    np.testing.assert_allclose(motion.at_epoch(now, time_s), at_epoch, atol=1e-6)


def test_nothing_has_moved_at_the_epoch():
    assert not strained().displacement(np.ones((2, 2)), np.full(2, 3600.0)).any()


def test_derivatives_are_those_of_the_displacement():
    motion, xy, time_s = strained(), np.array([[900.0, 100.0]]), np.array([DAY_S])
    step = 1e-6 * np.eye(motion.n_unknowns)
    moved = [
        motion.about(row).displacement(xy, time_s)[0] - motion.displacement(xy, time_s)[0] for row in step
    ]
    np.testing.assert_allclose(np.array(moved).T / 1e-6, motion.derivatives(xy, time_s)[0], atol=1e-6)


def test_an_exact_component_is_no_unknown():
    assert strained().n_unknowns == 8  # of the nine variances the first is 0
    np.testing.assert_allclose(strained().covariance, np.diag(np.arange(9.0)), atol=1e-12)


def test_an_estimate_written_about_other_coefficients_is_the_same_estimate():
    motion = strained()
    other = motion.about(np.arange(8.0))
    assert not np.allclose(other.coefficients, motion.coefficients)
    back = other.updated(other.expected, other.spread)
    np.testing.assert_allclose(back.coefficients, motion.coefficients, atol=1e-12)


def test_a_file_reads_back_equal(tmp_path):
    write_motion(strained(), tmp_path / "motion.json")
    assert read_motion(tmp_path / "motion.json") == strained()


def test_a_damaged_file_is_refused(tmp_path):
    (tmp_path / "motion.json").write_text('{"epoch_s": 1.0}\n')
    with pytest.raises(InputError, match="no motion of the ice"):
        read_motion(tmp_path / "motion.json")


def test_coefficients_of_another_shape_are_refused():
    with pytest.raises(InputError, match=r"give \(3, 1\) or \(3, 3\)"):
        IceMotion(np.zeros((2, 1)), 0.0, np.zeros(2), np.zeros((2, 0)))
