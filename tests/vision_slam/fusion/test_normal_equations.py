"""Whitened rows over the nodes of a path."""

import numpy as np
import pytest

from vision_slam.fusion.normal_equations import (
    DATUM,
    DELAY,
    MEAN_SCALE,
    N_GLOBALS,
    PER_NODE,
    PITCH,
    PITCH_BIAS,
    ROLL,
    ROLL_BIAS,
    SCALE,
    E,
    NormalEquations,
    unknown,
)


def covariance_of(system: NormalEquations, columns: np.ndarray) -> np.ndarray:
    """Return the covariance of some unknowns; the others are held by a weak prior."""
    design = system.design.toarray()
    information = design.T @ design + 1e-12 * np.eye(system.n_unknowns)
    return np.linalg.inv(information)[np.ix_(columns, columns)]


def test_a_gauss_markov_process_keeps_its_variance_and_correlation() -> None:
    system = NormalEquations(4)
    memory = np.array([0.9, 0.5, 0.1])
    system.add_gauss_markov(E, memory, 2.0)
    covariance = covariance_of(system, unknown(np.arange(4), E))
    np.testing.assert_allclose(np.diag(covariance), 4.0, rtol=1e-9)
    np.testing.assert_allclose(np.diag(covariance, 1), 4.0 * memory, rtol=1e-9)
    assert covariance[0, 3] == pytest.approx(4.0 * memory.prod(), rel=1e-9)


def test_a_process_about_a_mean_has_the_variance_of_both() -> None:
    system = NormalEquations(3)
    system.add_prior(MEAN_SCALE, 0.03)
    system.add_gauss_markov(SCALE, np.array([0.5, 0.5]), 0.04, MEAN_SCALE)
    covariance = covariance_of(system, unknown(np.arange(3), SCALE))
    np.testing.assert_allclose(np.diag(covariance), 0.05**2, rtol=1e-9)
    assert covariance[0, 2] == pytest.approx(0.03**2 + 0.25 * 0.04**2, rel=1e-9)


def test_a_tilt_that_stays_in_the_world_changes_from_roll_to_pitch_where_the_body_turns() -> None:
    system = NormalEquations(3)
    for bias in (ROLL_BIAS, PITCH_BIAS):
        system.add_prior(bias, 0.3)
    turn = np.radians([90.0, 60.0])
    system.add_turning_gauss_markov((ROLL, PITCH), np.array([0.8, 0.5]), turn, 0.4, (ROLL_BIAS, PITCH_BIAS))
    columns = np.concatenate([unknown(np.arange(3), which) for which in (ROLL, PITCH)])
    covariance = covariance_of(system, columns)
    np.testing.assert_allclose(np.diag(covariance), 0.5**2, rtol=1e-9)
    changing, constant = 0.16, 0.09
    roll, pitch = np.arange(3), 3 + np.arange(3)
    # A quarter turn to the left: what tilted the body to the front tilts it to the side.
    assert covariance[pitch[0], roll[1]] == pytest.approx(0.8 * changing, rel=1e-9)
    assert covariance[roll[0], pitch[1]] == pytest.approx(-0.8 * changing, rel=1e-9)
    assert covariance[roll[0], roll[1]] == pytest.approx(constant, rel=1e-9)
    assert covariance[roll[0], roll[2]] == pytest.approx(
        constant + 0.4 * np.cos(turn.sum()) * changing, rel=1e-9
    )


def test_a_walk_grows_by_the_squares_of_its_steps() -> None:
    system = NormalEquations(3)
    system.add_prior(E, 1.0)
    system.add_walk(E, np.array([3.0, 4.0]))
    covariance = covariance_of(system, unknown(np.arange(3), E))
    np.testing.assert_allclose(np.diag(covariance), [1.0, 10.0, 26.0], rtol=1e-9)


def test_rows_are_divided_by_their_standard_deviation() -> None:
    system = NormalEquations(2)
    before = np.array([0])
    terms = [(unknown(before, E), np.ones(1)), (np.array(DATUM), -np.ones(1))]
    system.add(terms, np.array([6.0]), np.array([2.0]))
    row = system.design.toarray()[0]
    assert (row[E], row[DATUM], system.values[0]) == (0.5, -0.5, 3.0)
    assert system.log_sigma == pytest.approx(np.log(2.0))


@pytest.mark.parametrize("has_delay", [False, True])
def test_globals_come_after_the_nodes(has_delay: bool) -> None:
    system = NormalEquations(5, has_delay=has_delay)
    assert system.n_unknowns == 5 * PER_NODE + N_GLOBALS + has_delay
    system.add_prior(DELAY if has_delay else MEAN_SCALE, 1.0)
    assert system.design.toarray()[0].argmax() == 5 * PER_NODE
