"""Triangulation: the point where rays meet, and rays that meet nowhere."""

import numpy as np

from vision_slam.odometry.landmarks import intersected

PLACES = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.5, 0.0]])


def test_rays_to_a_point_meet_in_it() -> None:
    points = np.array([[0.5, 2.0, 6.0], [1.0, -3.0, 9.0]])
    gap = points[:, None] - PLACES
    rays = gap / np.linalg.norm(gap, axis=2, keepdims=True)
    there = np.array([[True, True, True], [True, False, True]])
    found, information, error, is_point = intersected(rays, np.broadcast_to(PLACES, gap.shape), there)
    np.testing.assert_allclose(found, points, atol=1e-8)
    assert is_point.all()
    assert error.max() < 1e-9
    # Depth is known least, and the point seen three times better than the one seen twice.
    depth = np.einsum(
        "ti,tij,tj->t",
        *(points / np.linalg.norm(points, axis=1, keepdims=True),),
        information,
        points / np.linalg.norm(points, axis=1, keepdims=True),
    )
    assert depth[0] > depth[1]


def test_parallel_and_diverging_rays_are_no_points() -> None:
    ahead = np.array([0.0, 0.0, 1.0])
    apart = np.array([[-0.3, 0.0, 1.0], [0.3, 0.0, 1.0], [0.6, 0.0, 1.0]])
    rays = np.stack([np.tile(ahead, (3, 1)), apart / np.linalg.norm(apart, axis=1, keepdims=True)])
    there = np.ones((2, 3), dtype=bool)
    *_, is_point = intersected(rays, np.broadcast_to(PLACES, rays.shape), there)
    assert not is_point.any()
