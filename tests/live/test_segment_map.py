"""Segment by segment, the joint estimate is that of all unknowns at once."""

import numpy as np
import pytest
from scipy import sparse

from live.watch.live_map import LiveMap, local_nodes, path_segments
from survey import Grid, SurfacePoints
from survey.core.crs import projected_crs
from survey.data.path_error import PathError
from survey.reconstruction import GaussianProcessConfig
from survey.reconstruction.gp.config import JointConfig
from survey.reconstruction.gp.kernels import Kernel, Matern32, SquaredExponential
from survey.reconstruction.joint.joint_map import JointTerrain

CRS = projected_crs("EPSG:32608", "the test")
GRID = Grid((0.0, 0.0, 300.0, 120.0), 20.0, CRS)


def path_error(n: int, links: tuple[tuple[int, int], ...] = ()) -> PathError:
    """Keyframes of eight unknowns, each tied to the next, the last unknown of all to a global one, with links across."""
    information = np.zeros((8 * n + 1, 8 * n + 1))
    sigma = np.array([0.3, 0.3, 0.2, 0.01, 0.005, 0.005, 1.0, 1.0])
    for k in range(n):
        at = 8 * k + np.arange(8)
        information[at, at] += 0.01 * sigma**-2
        information[at[7], -1] = information[-1, at[7]] = 0.005
    for a, b, share in [*((k, k + 1, 0.1) for k in range(n - 1)), *((a, b, 0.05) for a, b in links)]:
        for j in range(8):
            pair = np.array([8 * a + j, 8 * b + j])
            information[np.ix_(pair, pair)] += (share * sigma[j]) ** -2 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    information[-1, -1] += 1.0
    return PathError(5.0 * np.arange(n), sparse.csr_array(information), 8)


def landmarks(path: PathError, n: int) -> SurfacePoints:
    rng = np.random.default_rng(5)
    keyframe = np.sort(rng.uniform(0.0, len(path) - 1.0, n))
    origin = np.column_stack([10.0 + 280.0 * keyframe / (len(path) - 1), np.full(n, 60.0), np.zeros(n)])
    xy = origin[:, :2] + rng.uniform(-20.0, 20.0, (n, 2))
    z = 2.0 * np.sin(xy[:, 0] / 40.0) * np.cos(xy[:, 1] / 50.0) + 0.05 * rng.standard_normal(n)
    own = np.tile(np.diag([1e-6, 1e-6, 0.05**2]), (n, 1, 1))
    seen = {"keyframe": keyframe, "heading_rad": np.zeros(n), "origins": origin}
    return SurfacePoints(np.column_stack([xy, z]), own + 0.1 * np.eye(3), crs=CRS, own_covariance=own, **seen)


@pytest.mark.parametrize(
    ("n_keyframes", "links", "kernel"),
    [
        (80, (), SquaredExponential(4.0, 40.0)),
        (80, ((3, 70), (10, 41)), Matern32(4.0, 60.0)),
        (9, (), SquaredExponential(4.0, 40.0)),
    ],
)
def test_segment_by_segment_the_map_is_that_of_one_solve(n_keyframes, links, kernel: Kernel):
    path = path_error(n_keyframes, links)
    points = landmarks(path, 900)
    mean, std = LiveMap(kernel, 0.05, GRID).of_landmarks(points, path)
    config = GaussianProcessConfig(fit=False, kernel=kernel, nugget_m=0.05, mean="plane")
    whole = JointTerrain(path, None, config, JointConfig(slope_passes=1)).solve(points, GRID.bounds)
    expected, expected_std = whole.terrain.fields(GRID)
    assert np.abs(mean - expected).max() < 5e-3
    assert np.abs(std / expected_std - 1.0).max() < 0.01


def test_every_unknown_and_every_point_lies_in_one_place():
    path = path_error(80, ((3, 70),))
    points = landmarks(path, 200)
    rows = path.rows(points.keyframe, np.ones((200, 6)))
    found = path_segments(path, points.keyframe, rows)
    assert sorted(np.r_[found.interior, found.knots].tolist()) == list(range(path.n_unknowns))
    assert sorted(found.points.tolist()) == list(range(200))
    knots = set((found.knots[:-1] // 8).tolist())
    assert {0, 3, 70, 79} <= knots
    inside = path.information[found.interior][:, found.interior].tocoo()
    segment = np.searchsorted(found.bounds, np.arange(len(found.interior)), side="right")
    assert (segment[inside.row] == segment[inside.col]).all()


def test_nodes_stand_for_points_within_the_tolerance():
    rng = np.random.default_rng(2)
    xy = rng.uniform(0.0, 1.0, (400, 2)) * [120.0, 30.0]
    omega, strengths = rng.normal(0.0, 0.02, (50, 2)), np.full(50, 0.3)
    nodes = local_nodes(xy, omega, strengths, 1e-3)
    assert len(nodes.xy) < 100
    waves = strengths * np.cos(xy @ omega.T)
    error = nodes.weights @ (strengths * np.cos(nodes.xy @ omega.T)) - waves
    assert np.linalg.norm(error, axis=1).max() < 3e-3
    few = local_nodes(xy[:5], omega, strengths, 1e-6)
    np.testing.assert_array_equal(few.xy, xy[:5])
