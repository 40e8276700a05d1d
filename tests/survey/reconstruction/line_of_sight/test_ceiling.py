"""The lowest rays over every node, against a caster that asks every cell about every ray."""

import numpy as np
import pytest

from survey.core.arrays import FloatArray
from survey.reconstruction.line_of_sight.ceiling import LowestRays
from survey.reconstruction.nodes import NodeWindow

WINDOW = NodeWindow(0.5, -10, -8, 17, 21)
END_IN_STEPS, SIGMAS, RANKING_SLOPE = 1.5, 3.0, 1.0


def brute_force(start: FloatArray, end: FloatArray, sigma_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Cut every ray to every cell's square, and sort what each node hears."""
    heard: dict[int, list[tuple[float, float, float]]] = {}
    for a, b, sigma in zip(start, end, sigma_m, strict=True):
        along = b[:2] - a[:2]
        length = np.hypot(*along)
        for number, node in enumerate(WINDOW.xy):
            first, last = 0.0, 1.0 - END_IN_STEPS * WINDOW.step_m / length
            for axis in range(2):
                low, high = sorted(
                    (node[axis] + side * WINDOW.step_m / 2.0 - a[axis]) / along[axis] for side in (-1, 1)
                )
                first, last = max(first, low), min(last, high)
            if last - first > 1e-12:
                t = np.clip((node - a[:2]) @ along / length**2, first, last)
                d = np.hypot(*(a[:2] + t * along - node))
                h = a[2] + t * (b[2] - a[2]) + SIGMAS * sigma
                heard.setdefault(number, []).append((h + RANKING_SLOPE * d, h, d))
    height, offset = np.full((3, len(WINDOW.xy)), np.inf), np.zeros((3, len(WINDOW.xy)))
    for number, all_of_it in heard.items():
        for k, (_, h, d) in enumerate(sorted(all_of_it)[:3]):
            height[k, number], offset[k, number] = h, d
    return height.reshape(3, *WINDOW.shape), offset.reshape(3, *WINDOW.shape)


def test_rays_of_moving_sensors_are_those_of_brute_force() -> None:
    """Sensors inside the map and beyond it, flat and steep rays, long and short ones."""
    rng = np.random.default_rng(3)
    n = 200
    start = np.column_stack([rng.uniform(-8.0, 8.0, (n, 2)), rng.uniform(1.0, 4.0, n)])
    end = np.column_stack([rng.uniform(-8.0, 8.0, (n, 2)), rng.uniform(-1.0, 1.0, n)])
    end[:20] = start[:20] + rng.normal(0.0, 0.6, (20, 3))
    sigma = rng.uniform(0.0, 0.1, n)
    rays = LowestRays.empty(WINDOW.shape)
    rays.add(WINDOW, start, end, sigma)
    height, offset = brute_force(start, end, sigma)
    assert np.isfinite(height[2]).mean() > 0.8
    # The only difference is in rounding.
    assert np.allclose(rays.height, height, rtol=0.0, atol=1e-9)
    assert np.allclose(rays.offset, offset, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("along", [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
def test_rays_along_the_rows_and_through_the_corners_of_cells(along: tuple[float, float]) -> None:
    """Every node under the ray hears of it, at its own place and height."""
    direction = np.array(along)
    start = np.array([*(-3.0 * direction), 3.0])
    end = np.array([*(3.0 * direction), 0.0])
    rays = LowestRays.empty(WINDOW.shape)
    rays.add(WINDOW, start[None], end[None], np.zeros(1))
    for share in np.arange(1, 10) / 12.0:
        node = -3.0 * direction + share * 6.0 * direction
        if np.linalg.norm(3.0 * direction - node) < END_IN_STEPS * WINDOW.step_m:
            continue
        i, j = np.round(WINDOW.coordinates(node[None])[0]).astype(int)
        assert rays.height[0, j, i] == pytest.approx(3.0 - 3.0 * share)
        assert rays.offset[0, j, i] == pytest.approx(0.0, abs=1e-9)


def test_nothing_is_said_beyond_the_end() -> None:
    rays = LowestRays.empty(WINDOW.shape)
    start, end = np.array([[-4.0, 0.0, 2.0]]), np.array([[0.0, 0.0, 0.0]])
    rays.add(WINDOW, start, end, np.zeros(1))
    heard = np.isfinite(rays.height[0])
    x = WINDOW.xy[:, 0].reshape(WINDOW.shape)
    assert heard.any()
    assert x[heard].max() <= -0.5


def test_a_steep_ray_beside_its_sensor_says_nothing() -> None:
    """It stays within a step and a half of its end, where the point itself says more."""
    rays = LowestRays.empty(WINDOW.shape)
    rays.add(WINDOW, np.array([[0.1, 0.0, 2.0]]), np.array([[0.6, 0.0, 0.0]]), np.zeros(1))
    assert not np.isfinite(rays.height[0]).any()


def test_one_ray_is_outvoted_and_three_are_accepted() -> None:
    rays = LowestRays.empty(WINDOW.shape)
    start, end = np.array([[-4.0, 0.0, 2.0]]), np.array([[4.0, 0.0, 0.0]])
    for n in range(3):
        assert rays.covered().any() == (n == 3)
        rays.add(WINDOW, start, end - [0.0, 0.0, 0.1 * n], np.zeros(1))
    level = np.zeros(WINDOW.shape)
    i, j = np.round(WINDOW.coordinates(np.zeros((1, 2)))[0]).astype(int)
    assert rays.ceiling(level)[j, i] == pytest.approx(1.0)
    assert rays.height[0, j, i] == pytest.approx(0.9)


def test_the_margin_grows_with_the_slope_and_the_distance() -> None:
    rays = LowestRays.empty(WINDOW.shape)
    start, end = np.tile([-4.0, 0.1, 2.0], (3, 1)), np.tile([4.0, 0.1, 2.0], (3, 1))
    rays.add(WINDOW, start, end, np.zeros(3))
    i, j = np.round(WINDOW.coordinates(np.zeros((1, 2)))[0]).astype(int)
    for slope in (0.0, 1.0):
        assert rays.ceiling(np.full(WINDOW.shape, slope))[j, i] == pytest.approx(2.0 + 0.1 * (slope + 0.3))


def test_rays_move_with_the_window() -> None:
    rays = LowestRays.empty(WINDOW.shape)
    start, end = np.tile([-4.0, 0.1, 2.0], (3, 1)), np.tile([4.0, 0.1, 2.0], (3, 1))
    rays.add(WINDOW, start, end, np.zeros(3))
    new = NodeWindow(0.5, -4, -8, 17, 21)
    moved = rays.carried(new, WINDOW)
    assert np.array_equal(moved.height[:, :, :15], rays.height[:, :, 6:])
    assert np.isinf(moved.height[:, :, 15:]).all()


def test_a_ray_below_the_third_lowest_is_outvoted_where_three_passed() -> None:
    rays = LowestRays.empty(WINDOW.shape)
    start = np.tile([-4.0, 0.0, 2.0], (3, 1))
    end = np.tile([4.0, 0.0, 2.0], (3, 1))
    start[0, 2] = end[0, 2] = -9.0
    rays.add(WINDOW, start[:2], end[:2], np.zeros(2))
    assert (rays.outvoted() == -np.inf).all()
    rays.add(WINDOW, start[2:], end[2:], np.zeros(1))
    under = rays.outvoted()[8, 4:16]
    # 0.2 m below the two that agree, wherever the odd one runs.
    np.testing.assert_allclose(under, 1.8)
