"""Maps cut off at lines of sight, against integrals and a world with a known answer."""

import numpy as np
import pytest
from scipy import stats

from survey.core.errors import InputError
from survey.data.grid import Grid
from survey.data.surface_points import SurfacePoints
from survey.reconstruction.line_of_sight.ceiling import truncated
from survey.reconstruction.mapping import reconstruct
from survey.reconstruction.terrain_map import RAY_BOUNDED

CRS = "EPSG:32608"


@pytest.mark.parametrize("ceiling", [-0.4, 1.0, 1.7, 9.0])
def test_the_truncated_normal_is_scipys(ceiling: float) -> None:
    mean, std = np.array([1.0]), np.array([0.5])
    expected = stats.truncnorm(-np.inf, (ceiling - 1.0) / 0.5, loc=1.0, scale=0.5)
    got = [float(value[0]) for value in truncated(mean, std, np.array([ceiling]))]
    assert got == pytest.approx(
        [expected.mean(), expected.std(), expected.ppf(0.025), expected.ppf(0.975)], abs=1e-6
    )


def test_without_a_ceiling_nothing_is_cut() -> None:
    mean, std, lower, upper = truncated(np.array([2.0]), np.array([0.5]), np.array([np.inf]))
    assert (mean[0], std[0]) == pytest.approx((2.0, 0.5))
    assert (lower[0], upper[0]) == pytest.approx((2.0 - 0.98, 2.0 + 0.98), abs=1e-3)


def test_landmarks_seen_across_a_gap_bound_it() -> None:
    """Ground at 0 with a hole in the survey; rays from the west to the east run through it."""
    rng = np.random.default_rng(2)
    xy = rng.uniform(0.0, 60.0, (500, 2))
    xy = xy[(xy[:, 0] < 15.0) | (xy[:, 0] > 45.0)]
    xyz = np.column_stack([xy, 0.5 * np.sin(xy[:, 0] / 4.0) * np.cos(xy[:, 1] / 5.0)])
    origins = np.column_stack([np.full(len(xy), 5.0), xy[:, 1], np.full(len(xy), 2.5)])
    points = SurfacePoints(xyz, sigma_m=0.05, origins=origins, crs=CRS)
    grid = Grid((0.0, 0.0, 60.0, 60.0), 2.0, CRS)
    plain, bounded = (reconstruct(points, grid, rays=rays) for rays in (False, True))
    gap = (np.abs(grid.xy[:, 0] - 30.0) < 10.0).reshape(grid.shape)
    assert bounded.upper is not None
    assert bounded.lower is not None
    heard = gap & (bounded.support == RAY_BOUNDED)
    assert heard.sum() > 0.5 * gap.sum()
    assert (bounded.upper.elevation[heard] <= 2.5).all()
    assert (bounded.upper.elevation <= plain.interval()[1].elevation + 1e-6).all()
    assert (bounded.lower.elevation <= bounded.mean.elevation).all()
    assert (bounded.mean.elevation <= bounded.upper.elevation).all()


def test_points_without_origins_are_refused() -> None:
    points = SurfacePoints(np.random.default_rng(0).random((9, 3)), sigma_m=0.1, crs=CRS)
    with pytest.raises(InputError, match="do not say where their sensor stood"):
        reconstruct(points, Grid((0.0, 0.0, 1.0, 1.0), 0.5, CRS), rays=True)
