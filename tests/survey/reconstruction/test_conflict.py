"""Conflicts between cells of a prior and points."""

import numpy as np

from survey.reconstruction.prior import ErrorScale
from survey.reconstruction.prior_likelihood import Innovations, Level, conflicts, level

CENTRE = np.random.default_rng(1).uniform(0.0, 600.0, (40, 2))
DRAWN = np.random.default_rng(2).standard_normal(40)


def of(offset_m: float, size: float = 1.0) -> Innovations:
    """Cells that err by 1 m each where the size is 1."""
    return Innovations(CENTRE, offset_m + size * DRAWN, np.eye(40))


def said(innovations: Innovations, white_m: float = 1.0) -> tuple[str, ...]:
    return conflicts(level(innovations, 1.0), innovations, white_m, ErrorScale(1.0))


def test_the_level_is_the_weighted_mean_with_its_standard_deviation() -> None:
    found = level(of(3.0), 2.0)
    assert np.isclose(found.offset_m, 3.0 + DRAWN.mean())
    assert np.isclose(found.sigma_m, 40.0**-0.5)
    assert np.isclose(found.in_sigmas, found.offset_m / np.hypot(2.0, 40.0**-0.5))


def test_cells_that_agree_are_no_conflict() -> None:
    assert said(of(0.0)) == ()


def test_an_offset_beyond_three_standard_deviations_is_one_sentence_with_its_size() -> None:
    (sentence,) = said(of(-40.0))
    assert "40." in sentence
    assert "below the points" in sentence


def test_cells_that_differ_more_than_their_errors_allow_contradict() -> None:
    (sentence,) = said(of(0.0, 2.0))
    assert "contradict the points" in sentence


def test_an_error_far_beyond_the_class_is_reported_unless_the_class_leaves_it_open() -> None:
    (sentence,) = said(of(0.0), white_m=3.5)
    assert "3.50 m each" in sentence
    open_size = ErrorScale(1.0, np.inf)
    assert conflicts(level(of(0.0), 1.0), of(0.0), 3.5, open_size) == ()


def test_a_level_is_less_probable_the_farther_it_lies_whatever_its_size() -> None:
    for sigma_m in (0.05, 1.0):
        near, middle, far = (Level(k * sigma_m, sigma_m, 0.0).probability for k in (2.0, 3.6, 5.0))
        assert near > 0.95
        assert 0.3 < middle < 0.5
        assert far < 0.005


def test_a_conflict_states_the_probability_with_which_the_level_is_used() -> None:
    (sentence,) = conflicts(level(of(40.0), 1.0), of(40.0), 1.0, ErrorScale(1.0), 0.25)
    assert "counts with a probability of 25 %" in sentence
