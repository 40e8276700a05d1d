"""Likelihoods of covariances, against the multivariate normal distribution."""

import numpy as np
import pytest

from survey.reconstruction.gp.kernel_search import Cell, LikelihoodView

CELLS = (Cell("squared-exponential", 16, -6), Cell("matern-3/2", 20, -3), Cell("matern-5/2", 18, -10))


@pytest.fixture
def places(rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(0.0, 100.0, (25, 2))


@pytest.fixture
def heights(rng: np.random.Generator) -> np.ndarray:
    return 500.0 + rng.standard_normal((25, 3)).cumsum(axis=0)


def view_of(places: np.ndarray, heights: np.ndarray, noise_m: float = 0.0) -> LikelihoodView:
    """Return a view of some cells, which every survey looks at."""
    view = LikelihoodView(places, heights, noise_m)
    everyone = np.ones(heights.shape[1], dtype=bool)
    assert view.look([(cell, everyone) for cell in CELLS])
    assert not view.look([(cell, everyone) for cell in CELLS])
    return view


def restricted_log_likelihood(places: np.ndarray, heights: np.ndarray, cell: Cell) -> tuple[float, float]:
    """Return the log likelihood without its constant, and the variance, with the mean integrated out."""
    n = len(places)
    covariance = cell.kernel(1.0).covariance(places, places) + 2.0**cell.ratio * np.eye(n)
    inverse, ones = np.linalg.inv(covariance), np.ones(n)
    mean = ones @ inverse @ heights / (ones @ inverse @ ones)
    variance = (heights - mean) @ inverse @ (heights - mean) / (n - 1)
    twice = (n - 1) * np.log(variance) + np.linalg.slogdet(covariance)[1] + np.log(ones @ inverse @ ones)
    return -0.5 * twice, variance


def test_likelihood_and_variance_are_those_of_the_restricted_likelihood(
    places: np.ndarray, heights: np.ndarray
) -> None:
    view = view_of(places, heights)
    for cell in CELLS:
        for survey, column in enumerate(heights.T):
            log, variance = restricted_log_likelihood(places, column, cell)
            assert view.seen[cell].log[survey] == pytest.approx(log, abs=1e-6)
            assert view.seen[cell].variance_m2[survey] == pytest.approx(variance, rel=1e-6)


def test_no_survey_depends_on_the_others(places: np.ndarray, heights: np.ndarray) -> None:
    together, alone = view_of(places, heights), view_of(places, heights[:, 1:2])
    for cell in CELLS:
        assert together.seen[cell].log[1] == pytest.approx(alone.seen[cell].log[0], abs=1e-9)


def test_a_cell_whose_noise_is_far_from_the_stated_one_is_less_likely(
    places: np.ndarray, heights: np.ndarray
) -> None:
    free, stated = view_of(places, heights), view_of(places, heights, noise_m=0.5)
    for cell in CELLS:
        implied = np.log(np.sqrt(2.0**cell.ratio * free.seen[cell].variance_m2) / 0.5)
        penalty = free.seen[cell].log - stated.seen[cell].log
        np.testing.assert_allclose(penalty, 0.5 * (implied / 0.2) ** 2, atol=1e-9)


def test_the_best_is_the_likeliest_of_those_that_were_asked_for(
    places: np.ndarray, heights: np.ndarray
) -> None:
    view = LikelihoodView(places, heights, 0.0)
    masks = np.array([[True, True, False], [False, True, True], [True, False, True]])
    view.look(zip(CELLS, masks, strict=True))
    best, logs = view.best(CELLS)
    for survey in range(3):
        asked = [cell for cell, mask in zip(CELLS, masks, strict=True) if mask[survey]]
        assert best[survey] == max(asked, key=lambda cell: view.seen[cell].log[survey])
        assert logs[survey] == view.seen[best[survey]].log[survey]
