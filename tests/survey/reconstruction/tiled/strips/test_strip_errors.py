"""Errors of strips by their overlaps."""

import numpy as np
import pytest

from survey.reconstruction.tiled.strips.overlaps import OVERLAP
from survey.reconstruction.tiled.strips.strip_errors import (
    Sizes,
    StripErrors,
    StripPlaces,
    as_arrays,
    from_arrays,
    solve_strips,
)

EXPECTED = Sizes(0.2, 0.1)
N_STRIPS, N_BLOCKS, N_CELLS = 5, 40, 400
PLACES = StripPlaces(
    np.arange(1, N_STRIPS + 1, dtype=np.uint32),
    np.column_stack([400.0 * np.arange(N_STRIPS), np.full(N_STRIPS, 1000.0)]),
    np.full(N_STRIPS, 1000.0),
)


def block(
    first: int, second: int, xy: np.ndarray, slope: np.ndarray, d: np.ndarray, variance: float
) -> tuple[float, ...]:
    e, v = slope.T
    sums = (len(d), e.sum(), v.sum(), e @ e, e @ v, v @ v, d.sum(), d @ e, d @ v, d @ d)
    return (first, second, *xy, variance, variance, *sums)


def drawn(seed: int, n_control: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return true errors (S, 5), blocks between neighbouring strips, and control points."""
    rng = np.random.default_rng(seed)
    true = rng.standard_normal((N_STRIPS, 5)) * [0.2, 0.1, 0.1, 0.1, 0.1]
    blocks, control = [], []
    for k in range(N_STRIPS - 1):
        for y in np.linspace(0.0, 2000.0, N_BLOCKS):
            xy, slope = np.array([400.0 * k + 200.0, y]), 0.2 * rng.standard_normal((N_CELLS, 2))
            at = np.tile(xy, (N_CELLS, 1))
            d = sum(
                sign * np.sum(PLACES.design(np.full(N_CELLS, s), at, slope) * true[s], axis=1)
                for s, sign in ((k, 1.0), (k + 1, -1.0))
            )
            d = d + 0.05 * rng.standard_normal(N_CELLS) + 0.01 * rng.standard_normal() * np.sqrt(2.0)
            blocks.append(block(k + 1, k + 2, xy, slope, d, 0.05**2))
    for _ in range(n_control):
        s, xy, slope = (
            int(rng.integers(N_STRIPS)),
            rng.uniform(0.0, 2000.0, (1, 2)),
            0.2 * rng.standard_normal((1, 2)),
        )
        d = np.sum(PLACES.design(np.array([s]), xy, slope) * true[s], axis=1) + 0.02 * rng.standard_normal(1)
        control.append(block(s + 1, 0, xy[0], slope, d, 0.02**2))
    return true, np.array(blocks, OVERLAP), np.array(control, OVERLAP)


def ratio(found: StripErrors, true: np.ndarray) -> float:
    """Return the squared error in standard deviations, for each error."""
    error = (found.errors - true).ravel()
    return float(error @ np.linalg.solve(found.covariance, error)) / error.size


def test_errors_lie_within_their_joint_covariance() -> None:
    ratios = []
    for seed in range(6):
        true, blocks, control = drawn(seed, 8)
        ratios.append(ratio(solve_strips(PLACES, blocks, control, EXPECTED), true))
    assert 0.6 < np.mean(ratios) < 1.6


def test_differences_of_strips_are_known_better_than_their_level() -> None:
    true, blocks, _ = drawn(3)
    found = solve_strips(PLACES, blocks, np.zeros(0, OVERLAP), EXPECTED)
    at = np.array([200.0, 1000.0])
    between_m, sigma_m = found.offset_between(1, 2, at)
    exact = sum(
        sign * float(PLACES.design(np.array([s]), at[None], np.zeros((1, 2)))[0] @ true[s])
        for s, sign in ((0, 1.0), (1, -1.0))
    )
    assert abs(between_m - exact) < 3.0 * sigma_m < 0.02
    assert np.sqrt(found.covariance[0, 0]) > 0.03


def test_control_points_give_the_level() -> None:
    true, blocks, control = drawn(3, 40)
    found = solve_strips(PLACES, blocks, control, EXPECTED)
    assert np.abs(found.errors[:, 0] - true[:, 0]).max() < 0.03


def test_without_overlap_the_errors_are_as_uncertain_as_expected() -> None:
    none = np.zeros(0, OVERLAP)
    found = solve_strips(PLACES, none, none, EXPECTED)
    assert (found.errors == 0.0).all()
    assert np.sqrt(np.diag(found.covariance))[:3] == pytest.approx([0.2, 0.1, 0.1])


def test_errors_that_wander_over_hundreds_of_metres_inflate_the_covariance() -> None:
    _, blocks, _ = drawn(1)
    steady = solve_strips(PLACES, blocks, np.zeros(0, OVERLAP), EXPECTED).inflation
    wave = 0.1 * np.sin(blocks["y"] / 150.0)
    blocks["dd"] += 2.0 * wave * blocks["d"] + wave**2 * blocks["n"]
    for name, sums in (("d", "n"), ("de", "e"), ("dv", "v")):
        blocks[name] += wave * blocks[sums]
    assert solve_strips(PLACES, blocks, np.zeros(0, OVERLAP), EXPECTED).inflation > max(1.2, steady)


def test_stored_errors_are_the_same() -> None:
    _, blocks, control = drawn(2, 4)
    found = solve_strips(PLACES, blocks, control, EXPECTED)
    again = from_arrays(as_arrays(found))
    assert (again.errors == found.errors).all()
    assert (again.covariance == found.covariance).all()
    assert again.facts() == found.facts()
