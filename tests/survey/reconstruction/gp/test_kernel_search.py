"""The search for kernels: it ends on the likeliest cell of the whole lattice, for each survey by itself."""

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from survey.core.errors import InputError
from survey.reconstruction.gp.kernel_search import SEARCHED, Cell, KernelSearch, map_surveys

LENGTHS = range(17, 42)
"""The lattice's length scales on a site of 600 m, a thirtieth to twice of it, four per doubling."""


def surveyed(family, length_scale_m, noise_m, n_surveys=3):
    """Return wavy swaths and what surveys of terrain of this covariance measured there."""
    rng = np.random.default_rng(6)
    along = np.linspace(0.0, 600.0, 36)
    lines = [np.column_stack([along, y + 60.0 * np.sin(along / 40.0)]) for y in (100.0, 300.0, 500.0)]
    xy = np.concatenate(lines)
    covariance = 25.0 * Cell.of(family, length_scale_m, 1.0).correlation(cdist(xy, xy, "sqeuclidean"))
    # The smallest eigenvalues of so smooth a covariance are below rounding; they carry no height.
    drawn = np.linalg.cholesky(covariance + 1e-10 * np.eye(len(xy))) @ rng.standard_normal(
        (len(xy), n_surveys)
    )
    return xy, drawn + noise_m * rng.standard_normal(drawn.shape)


def log_likelihood(cell, xy, heights, noise_m):
    """Restricted likelihood up to a constant, by plain solves."""
    n = len(xy)
    matrix = cell.correlation(cdist(xy, xy, "sqeuclidean")) + 2.0**cell.ratio * np.eye(n)
    ones = np.ones(n)
    weights = np.linalg.solve(matrix, np.column_stack([ones, heights]))
    centre = ones @ weights[:, 1] / (ones @ weights[:, 0])
    variance = (heights - centre) @ (weights[:, 1] - centre * weights[:, 0]) / (n - 1)
    log_determinant = np.linalg.slogdet(matrix)[1]
    log = -0.5 * ((n - 1) * np.log(variance) + log_determinant + np.log(ones @ weights[:, 0]))
    if noise_m > 0.0:
        log -= 0.5 * (0.5 * np.log(2.0**cell.ratio * variance / noise_m**2) / 0.2) ** 2
    return log


@pytest.mark.parametrize(
    ("family", "length_scale_m", "noise_m"),
    [
        ("squared-exponential", 100.0, 0.0),
        ("squared-exponential", 100.0, 0.1),
        ("matern-3/2", 200.0, 0.1),
    ],
)
def test_the_likeliest_cell_of_the_whole_lattice_is_found(family, length_scale_m, noise_m):
    xy, heights = surveyed(family, length_scale_m, noise_m, n_surveys=1)
    (found,) = KernelSearch(xy, heights, noise_m).search()
    ratios = [-28] if noise_m == 0.0 else range(-20, -3)
    every = [Cell(family, length, ratio) for family in SEARCHED for length in LENGTHS for ratio in ratios]
    likeliest = max(every, key=lambda cell: log_likelihood(cell, xy, heights[:, 0], noise_m))
    assert found.cell == likeliest
    assert found.cell.family == family


def test_no_survey_depends_on_those_it_is_searched_with():
    xy, heights = surveyed("matern-5/2", 120.0, 0.2)
    together = KernelSearch(xy, heights, 0.2).search()
    alone = [KernelSearch(xy, heights[:, [b]], 0.2).search()[0] for b in range(3)]
    assert [one.cell for one in together] == [one.cell for one in alone]
    # Columns solved together and alone round differently.
    assert [one.variance_m2 for one in together] == pytest.approx(
        [one.variance_m2 for one in alone], rel=1e-9
    )


def test_maps_of_one_kernel_are_those_of_each_survey_alone():
    xy, heights = surveyed("matern-5/2", 120.0, 0.2)
    found = KernelSearch(xy, heights, 0.2).search()[:1] * 3
    nodes = np.random.default_rng(7).uniform(0.0, 600.0, (50, 2))
    together, claimed = map_surveys(xy, heights, found, nodes)
    for b in range(3):
        alone, its_claim = map_surveys(xy, heights[:, [b]], found[:1], nodes)
        # Micrometres: sums of another width round differently.
        np.testing.assert_allclose(together[:, [b]], alone, atol=1e-6)
        assert claimed[b] == pytest.approx(its_claim[0])


def test_too_few_samples_for_a_covariance_are_refused():
    with pytest.raises(InputError, match="2 samples are too few"):
        KernelSearch(np.zeros((2, 2)), np.zeros((2, 1)), 0.1)
    with pytest.raises(InputError, match="1 heights are NaN"):
        KernelSearch(np.eye(3)[:, :2], np.array([[0.0], [1.0], [np.nan]]), 0.1)
