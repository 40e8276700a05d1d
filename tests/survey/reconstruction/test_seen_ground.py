"""Ground as a scanner has seen it: probabilities of rises, lines of sight, gaps, and the window that moves."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from survey.core import InputError
from survey.reconstruction.nodes import NodeWindow
from survey.reconstruction.seen_ground import RiseLimit, SeenGround, _beyond, steep_terrain

LIMIT = RiseLimit(25.0, 1.0)


def seen_from_above(height, rng: np.random.Generator, sigma_m: float = 0.02, n: int = 6) -> SeenGround:
    """Return ground of 20 × 20 m with a height (east) that was seen from above, without rays."""
    seen = SeenGround(NodeWindow(0.25, 0, 0, 80, 80))
    xy = np.repeat(seen.window.xy, n, axis=0) + rng.uniform(-0.12, 0.12, (n * 6400, 2))
    z = height(xy) + sigma_m * rng.standard_normal(len(xy))
    order = rng.permutation(len(xy))
    seen.add(np.column_stack([xy, z])[order], None, np.full(len(xy), sigma_m))
    return seen


def test_the_probability_of_a_rise_is_that_of_the_mixture() -> None:
    rise, sigma, common, limit = 0.4, 0.08, 0.1, LIMIT.rise_m

    def density(u: float) -> float:
        prior = 0.98 * norm.pdf(u, scale=common) + 0.02 * norm.pdf(u, scale=2.0 * limit)
        return float(prior * norm.pdf(rise, u, sigma))

    beyond = quad(density, limit, 3.0)[0] / (quad(density, -3.0, limit)[0] + quad(density, limit, 3.0)[0])
    assert _beyond.py_func(rise, sigma**2, (limit, common)) == pytest.approx(beyond, rel=1e-6)


def test_gentle_ground_with_noise_is_not_steep(rng: np.random.Generator) -> None:
    seen = seen_from_above(lambda xy: 0.15 * xy[:, 0] + 0.05 * np.sin(xy[:, 1]), rng, sigma_m=0.05)
    assert seen.steep_probability(LIMIT).max() < 0.05
    assert not seen.gaps(LIMIT, np.ones((80, 80), dtype=bool)).any()
    assert seen.is_seen().all()


def test_a_wall_is_steep_where_a_rover_would_stand_on_it(rng: np.random.Generator) -> None:
    seen = seen_from_above(lambda xy: 1.0 * (xy[:, 0] > 10.1), rng)
    steep = seen.steep_probability(LIMIT) > 0.5
    east = seen.window.xy[:, 0].reshape(steep.shape)
    assert steep[np.abs(east - 10.1) < 0.3].all()
    assert not steep[np.abs(east - 10.1) > 0.8].any()


def test_ground_that_rays_pass_over_is_steep_before_it_is_seen() -> None:
    # A plateau that is seen up to 10 m, and rays that fall beyond its edge by 1.2 m within a metre.
    seen = SeenGround(NodeWindow(0.25, 0, 0, 20, 80))
    xy = np.repeat(seen.window.xy, 5, axis=0)
    xy = xy[xy[:, 0] <= 10.0]
    seen.add(np.column_stack([xy, np.zeros(len(xy))]), None, np.full(len(xy), 0.02))
    north = np.repeat(np.arange(0.5, 4.5, 0.1), 4)
    start = np.column_stack([np.full(len(north), 9.0), north, np.full(len(north), 1.5)])
    end = np.column_stack([np.full(len(north), 14.0), north, np.full(len(north), -5.2)])
    seen.add(end, start, np.full(len(north), 0.02))
    steep = seen.steep_probability(LIMIT) > 0.5
    assert steep[8, 40:44].any()
    assert not steep[8, :36].any()


def test_a_narrow_dip_may_be_a_gap_and_a_dune_is_none(rng: np.random.Generator) -> None:
    everywhere = np.ones((80, 80), dtype=bool)
    slot = seen_from_above(lambda xy: -0.25 * (np.abs(xy[:, 0] - 10.0) < 0.3), rng).gaps(LIMIT, everywhere)
    assert slot[:, 40].all()
    assert not slot[:, :34].any()
    dune = seen_from_above(lambda xy: -0.25 * np.exp(-(((xy[:, 0] - 10.0) / 2.0) ** 2)), rng)
    assert not dune.gaps(LIMIT, everywhere).any()


def test_a_window_that_moves_keeps_what_it_still_holds(rng: np.random.Generator) -> None:
    seen = seen_from_above(lambda xy: xy[:, 0], rng)
    before, _ = seen.heights()
    seen.move_to(NodeWindow(0.25, 20, 0, 80, 80))
    after, _ = seen.heights()
    assert np.array_equal(after[:, :60], before[:, 20:])
    assert np.isnan(after[:, 60:]).all()
    assert not seen.is_seen()[:, 63:].any()


def test_tracks_bridge_narrow_gaps() -> None:
    height = np.zeros((1, 41))
    height[0, 20] = -4.0
    assert not steep_terrain(np.repeat(height, 41, axis=0), 0.25, LIMIT, gap_m=0.3).any()
    height[0, 20:23] = -4.0
    assert steep_terrain(np.repeat(height, 41, axis=0), 0.25, LIMIT, gap_m=0.3)[:, 19:24].all()


@pytest.mark.parametrize(("slope_deg", "base_m"), [(0.0, 1.0), (90.0, 1.0), (25.0, 0.0), (25.0, np.nan)])
def test_a_limit_that_is_none_is_refused(slope_deg: float, base_m: float) -> None:
    with pytest.raises(InputError):
        RiseLimit(slope_deg, base_m)
