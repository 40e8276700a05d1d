"""Errors of strips by their overlaps."""

import numpy as np
import pytest

from survey.reconstruction.tiled.strips import (
    Sizes,
    StripErrors,
    StripPairs,
    StripPlaces,
    as_arrays,
    from_arrays,
    solve_strips,
)
from survey.reconstruction.tiled.summaries import OVERLAP, SUMS

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
    return (first, second, *xy, *np.round(1e3 * xy).astype(int), variance, variance, d.sum(), 0.0, *sums)


def drawn(
    seed: int, n_control: int = 0, n_strips: int = N_STRIPS
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return true errors (S, 5), blocks between neighbouring strips, and control points."""
    rng = np.random.default_rng(seed)
    true = rng.standard_normal((n_strips, 5)) * [0.2, 0.1, 0.1, 0.1, 0.1]
    blocks, control = [], []
    for k in range(n_strips - 1):
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
            int(rng.integers(n_strips)),
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


def test_the_level_of_two_strips_with_four_control_points_lies_within_its_standard_deviation() -> None:
    two = StripPlaces(*(values[:2] for values in PLACES))
    middle = np.tile([0.5, 0.0, 0.0, 0.0, 0.0], 2)
    ratios = []
    for seed in range(100, 140):
        true, blocks, control = drawn(seed, 4, n_strips=2)
        found = solve_strips(two, blocks[::8], control, EXPECTED)
        ratios.append(middle @ (found.errors - true).ravel() / np.sqrt(middle @ found.covariance @ middle))
    # The standard error of a mean square of forty normal numbers is 0.22.
    assert 0.55 < np.mean(np.square(ratios)) < 1.45


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


def with_errors(blocks: np.ndarray, error_m: np.ndarray) -> np.ndarray:
    """Return blocks of cells that have one more error each [m]."""
    found = blocks.copy()
    found["dd"] += 2.0 * error_m * blocks["d"] + error_m**2 * blocks["n"]
    for name, sums in (("d", "n"), ("de", "e"), ("dv", "v")):
        found[name] += error_m * blocks[sums]
    return found


def test_strips_that_wander_are_as_uncertain_as_they_wander() -> None:
    _, blocks, _ = drawn(1)
    none = np.zeros(0, OVERLAP)
    steady = solve_strips(PLACES, blocks, none, EXPECTED)
    rng = np.random.default_rng(5)
    wander = (
        0.05 * rng.standard_normal((N_STRIPS, 8))[blocks["first"] - 1, (blocks["y"] // 256.0).astype(int)]
    )
    found = solve_strips(PLACES, with_errors(blocks, wander), none, EXPECTED)
    assert steady.sizes.wander_m < 0.01
    assert 0.03 < found.sizes.wander_m < 0.07
    at = np.array([200.0, 1000.0])
    assert found.offset_between(1, 2, at)[1] > 3.0 * steady.offset_between(1, 2, at)[1]


def test_errors_of_blocks_are_found_apart_from_wander() -> None:
    _, blocks, _ = drawn(4)
    found = solve_strips(PLACES, blocks, np.zeros(0, OVERLAP), EXPECTED)
    assert 0.007 < found.sizes.block_m < 0.013


def test_the_difference_of_two_rasters_follows_from_the_errors_and_the_places_of_points() -> None:
    _, blocks, _ = drawn(3)
    blocks["placed"] = 0.015 * blocks["n"]
    blocks["raw"] = blocks["d"] + blocks["placed"]
    found = StripPairs.of(blocks).facts(solve_strips(PLACES, blocks, np.zeros(0, OVERLAP), EXPECTED))
    for pair in found:
        difference_m = pair["cell_difference_m"] - pair["expected_cell_difference_m"]
        assert abs(difference_m) < 3.0 * pair["expected_cell_difference_m_sigma"] < 0.03
    assert [pair["strips"] for pair in found] == [[str(k), str(k + 1)] for k in range(1, N_STRIPS)]


def test_stored_errors_are_the_same() -> None:
    _, blocks, control = drawn(2, 4)
    found = solve_strips(PLACES, blocks, control, EXPECTED)
    again = from_arrays(as_arrays(found))
    assert (again.errors == found.errors).all()
    assert (again.covariance == found.covariance).all()
    assert again.facts() == found.facts()


def test_blocks_that_tiles_cut_count_as_one() -> None:
    _, blocks, control = drawn(6, 8)
    one = solve_strips(PLACES, blocks, control, EXPECTED)
    half = blocks.copy()
    for name in ("raw", "placed", *SUMS):
        half[name] *= 0.5
    cut = solve_strips(PLACES, np.concatenate([half, half]), control, EXPECTED)
    np.testing.assert_allclose(cut.errors, one.errors, atol=1e-6)
    np.testing.assert_allclose(cut.covariance, one.covariance, atol=1e-8)
