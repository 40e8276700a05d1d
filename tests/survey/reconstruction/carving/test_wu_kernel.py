"""Wu's kernel: its value, its edge, its smoothness, and that it is positive definite."""

import numpy as np
import pytest

from survey.reconstruction.carving.descent import (
    BY_POINT,
    BY_RAY,
    Bases,
    Columns,
    Fresh,
    LevelCells,
    add_fresh,
    fresh_height,
    wu,
    wu_kernel,
)


def test_it_is_the_papers_polynomial_divided_by_four() -> None:
    rho = np.linspace(0.0, 1.5, 31)
    paper = np.maximum(1.0 - rho, 0.0) ** 4 * (4.0 + 16.0 * rho + 12.0 * rho**2 + 3.0 * rho**3)
    np.testing.assert_allclose(wu_kernel(rho, 1.0), paper / 4.0, rtol=1e-14)
    np.testing.assert_allclose([wu(r) for r in rho], paper / 4.0, rtol=1e-14)


def test_two_derivatives_are_continuous_where_it_begins_and_ends() -> None:
    h = 1e-4
    for at in (0.0, 1.0):
        d = at + h * np.arange(-3, 4)
        second = np.diff(wu_kernel(np.abs(d), 1.0), 2) / h**2
        # A jump of the second derivative would not shrink with h; its slope is below 100.
        assert np.ptp(second) < 100.0 * 4 * h


@pytest.mark.parametrize("length", [0.5, 1.0, 3.0])
def test_its_gram_matrix_is_positive_semi_definite(length: float) -> None:
    xy = np.random.default_rng(3).uniform(0.0, 5.0, (150, 2))
    gram = wu_kernel(np.linalg.norm(xy[:, None] - xy[None], axis=2), length)
    # Rounding of a symmetric matrix of ones leaves eigenvalues of about n ε.
    assert np.linalg.eigvalsh(gram)[0] > -150 * np.finfo(float).eps * 150


def columns(rng: np.random.Generator, n: int, n_levels: int) -> Columns:
    x, y, weight = rng.uniform(0.0, 9.0, n), rng.uniform(0.0, 7.0, n), rng.normal(size=n)
    made_by = rng.integers(0, 2, n).astype(np.uint8)
    return Columns(x, y, weight, made_by, rng.integers(0, n_levels, n))


def by_hand(kernels: Columns, lengths: np.ndarray, xy: np.ndarray) -> np.ndarray:
    d = np.hypot(kernels.x - xy[:, :1], kernels.y - xy[:, 1:])
    return (kernels.weight * wu_kernel(d, lengths[kernels.level])).sum(axis=1)


def test_sums_by_cells_are_sums_over_all_kernels(rng: np.random.Generator) -> None:
    lengths = np.array([3.0, 1.1, 0.4])
    kernels = columns(rng, 400, 3)
    bases = Bases.none(LevelCells.over(lengths, 9.0, 7.0)).merged(kernels)
    xy = rng.uniform(0.0, 1.0, (50, 2)) * (9.0, 7.0)
    # 400 terms of order 1 in another order.
    np.testing.assert_allclose(bases.heights(xy), by_hand(kernels, lengths, xy), atol=1e-12)
    wider = bases.on(LevelCells.over(lengths, 20.0, 30.0), 5.0, 8.0)
    np.testing.assert_allclose(wider.heights(xy + (5.0, 8.0)), bases.heights(xy), atol=1e-12)
    assert sorted(wider.made_by) == sorted(bases.made_by)


def test_kernels_being_added_count_at_once(rng: np.random.Generator) -> None:
    lengths = np.array([2.0])
    kernels = columns(rng, 300, 1)
    fresh = Fresh.on(LevelCells.over(lengths, 9.0, 7.0), 0, 300)
    for x, y, weight, made_by, _ in zip(*kernels, strict=True):
        add_fresh(fresh, x, y, weight, made_by)
    xy = np.array([[4.0, 3.0], [0.0, 0.0], [9.0, 7.0]])
    found = [fresh_height(fresh, *place) for place in xy]
    np.testing.assert_allclose(found, by_hand(kernels, lengths, xy), atol=1e-12)
    taken = fresh.taken(0)
    assert len(taken.x) == 300
    assert (taken.made_by == BY_RAY).sum() == (kernels.made_by == BY_RAY).sum()
    assert (taken.made_by == BY_POINT).sum() == (kernels.made_by == BY_POINT).sum()
