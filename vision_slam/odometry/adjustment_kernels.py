"""Compiled loops of the global bundle adjustment: normal equations of points by inverse depth, and their Schur complement.

Observations are sorted by point, then by keyframe; the first of a point is that of its anchor. A point has three unknowns in
the frame of its anchor camera: where its ray meets z = 1, and the inverse of its depth. Unknowns of a pose are a rotation
and a translation (6). Matrices of poses are lower bands: ``band[j, i - j]`` is the entry of row i and column j.
"""

import numpy as np
from numba import njit

from survey.core import FloatArray, IntArray


@njit(cache=True)
def seen_from_anchors(
    poses: FloatArray, points: FloatArray, first: IntArray, keyframe: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return the points in the frame of each observing camera (N, 3), and how they change with inverse depth (N, 3)."""
    local, by_depth = np.empty((len(keyframe), 3)), np.empty((len(keyframe), 3))
    for j in range(len(first) - 1):
        anchor = poses[keyframe[first[j]]]
        ray = anchor[:3, 0] * points[j, 0] + anchor[:3, 1] * points[j, 1] + anchor[:3, 2]
        for n in range(first[j], first[j + 1]):
            pose = poses[keyframe[n]]
            for a in range(3):
                local[n, a], by_depth[n, a] = 0.0, 0.0
                for b in range(3):
                    local[n, a] += pose[b, a] * ray[b]
                    by_depth[n, a] += pose[b, a] * (anchor[b, 3] - pose[b, 3])
                local[n, a] += points[j, 2] * by_depth[n, a]
    return local, by_depth


@njit(cache=True)
def _write_slopes(  # noqa: PLR0917
    pose: FloatArray,
    anchor: FloatArray,
    point: FloatArray,
    by_local: FloatArray,
    local: FloatArray,
    by_depth: FloatArray,
    by_pose: FloatArray,
    by_anchor: FloatArray,
    by_point: FloatArray,
) -> None:
    """Write how a pixel changes with its own pose and that of the anchor (2, 6), and with the point (2, 3)."""
    x, y, z = local[0], local[1], local[2]
    u, v, rho = point[0], point[1], point[2]
    for r in range(2):
        s0, s1, s2 = by_local[r, 0], by_local[r, 1], by_local[r, 2]
        by_pose[r, 0], by_pose[r, 1], by_pose[r, 2] = s1 * z - s2 * y, s2 * x - s0 * z, s0 * y - s1 * x
        c0, c1, c2 = 0.0, 0.0, 0.0
        for q in range(3):
            in_world = s0 * pose[q, 0] + s1 * pose[q, 1] + s2 * pose[q, 2]
            by_pose[r, 3 + q], by_anchor[r, 3 + q] = -rho * in_world, rho * in_world
            c0, c1, c2 = (
                c0 + in_world * anchor[q, 0],
                c1 + in_world * anchor[q, 1],
                c2 + in_world * anchor[q, 2],
            )
        by_anchor[r, 0], by_anchor[r, 1], by_anchor[r, 2] = c2 * v - c1, c0 - c2 * u, c1 * u - c0 * v
        by_point[r, 0], by_point[r, 1] = c0, c1
        by_point[r, 2] = s0 * by_depth[0] + s1 * by_depth[1] + s2 * by_depth[2]


@njit(cache=True)
def add_observations(  # noqa: PLR0912, PLR0917 - compiled functions take no keywords, and inline their loops
    poses: FloatArray,
    points: FloatArray,
    first: IntArray,
    keyframe: IntArray,
    weight: FloatArray,
    error: FloatArray,
    by_local: FloatArray,
    by_lens: FloatArray,
    local: FloatArray,
    by_depth: FloatArray,
    band: FloatArray,
    pose_lens: FloatArray,
    lens: FloatArray,
    g_pose: FloatArray,
    g_lens: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Add all observations to the equations of poses and lens.

    Returns the blocks of the points (J, 3, 3), their gradients (J, 3), what couples them with the lens (J, 3, 3) and with
    the pose of each observation (N, 6, 3), and gradients by pose (N, 6) and lens (J, 3) of each point alone. The row of a
    point's first observation holds the couplings with its anchor.
    """
    n_all, n_points = len(keyframe), len(first) - 1
    own, g_own = np.zeros((n_points, 3, 3)), np.zeros((n_points, 3))
    lens_point, g_of_lens = np.zeros((n_points, 3, 3)), np.zeros((n_points, 3))
    pose_point, g_of_pose = np.zeros((n_all, 6, 3)), np.zeros((n_all, 6))
    by_pose, by_anchor = np.zeros((2, 6)), np.zeros((2, 6))
    by_point = np.zeros((2, 3))
    for j in range(n_points):
        start = first[j]
        a = keyframe[start]
        for n in range(start, first[j + 1]):
            k, w = keyframe[n], weight[n]
            _write_slopes(
                poses[k], poses[a], points[j], by_local[n], local[n], by_depth[n], by_pose, by_anchor, by_point,
            )  # fmt: skip
            for r in range(2):
                e = error[n, r]
                for p in range(3):
                    wp = w * by_point[r, p]
                    g_own[j, p] += wp * e
                    wl = w * by_lens[n, r, p]
                    g_of_lens[j, p] += wl * e
                    for q in range(3):
                        own[j, p, q] += wp * by_point[r, q]
                        lens_point[j, p, q] += wl * by_point[r, q]
                        lens[p, q] += wl * by_lens[n, r, q]
                if n == start:
                    continue
                for p in range(6):
                    wp, wa = w * by_pose[r, p], w * by_anchor[r, p]
                    g_of_pose[n, p] += wp * e
                    g_of_pose[start, p] += wa * e
                    for q in range(3):
                        pose_point[n, p, q] += wp * by_point[r, q]
                        pose_point[start, p, q] += wa * by_point[r, q]
                        pose_lens[6 * k + p, q] += wp * by_lens[n, r, q]
                        pose_lens[6 * a + p, q] += wa * by_lens[n, r, q]
                    for q in range(6):
                        band[6 * a + q, 6 * (k - a) + p - q] += wp * by_anchor[r, q]
                    for q in range(p + 1):
                        band[6 * k + q, p - q] += wp * by_pose[r, q]
                        band[6 * a + q, p - q] += wa * by_anchor[r, q]
        for p in range(3):
            g_lens[p] += g_of_lens[j, p]
        for n in range(start, first[j + 1]):
            for p in range(6):
                g_pose[6 * keyframe[n] + p] += g_of_pose[n, p]
    return own, g_own, lens_point, pose_point, g_of_pose, g_of_lens


@njit(cache=True)
def eliminate_points(  # noqa: PLR0917
    first: IntArray,
    keyframe: IntArray,
    inverse: FloatArray,
    g_own: FloatArray,
    lens_point: FloatArray,
    pose_point: FloatArray,
    band: FloatArray,
    pose_lens: FloatArray,
    lens: FloatArray,
    g_pose: FloatArray,
    g_lens: FloatArray,
) -> None:
    """Subtract from the equations of poses and lens what the points take up, whose blocks have an `inverse` (J, 3, 3).

    Three rows of length 6 stand for the solved block of an observation, so that the inner loop runs over neighbours in memory.
    """
    by_u, by_v, by_rho = np.zeros(6), np.zeros(6), np.zeros(6)
    for j in range(len(first) - 1):
        own = inverse[j]
        solved_lens = lens_point[j] @ own
        for p in range(3):
            for r in range(3):
                g_lens[p] -= solved_lens[p, r] * g_own[j, r]
                for q in range(3):
                    lens[p, q] -= solved_lens[p, r] * lens_point[j, q, r]
        for n in range(first[j], first[j + 1]):
            row = 6 * keyframe[n]
            for p in range(6):
                u, v, rho = pose_point[n, p, 0], pose_point[n, p, 1], pose_point[n, p, 2]
                by_u[p] = u * own[0, 0] + v * own[1, 0] + rho * own[2, 0]
                by_v[p] = u * own[0, 1] + v * own[1, 1] + rho * own[2, 1]
                by_rho[p] = u * own[0, 2] + v * own[1, 2] + rho * own[2, 2]
                g_pose[row + p] -= by_u[p] * g_own[j, 0] + by_v[p] * g_own[j, 1] + by_rho[p] * g_own[j, 2]
                for q in range(3):
                    pose_lens[row + p, q] -= (
                        by_u[p] * lens_point[j, q, 0]
                        + by_v[p] * lens_point[j, q, 1]
                        + by_rho[p] * lens_point[j, q, 2]
                    )
            for m in range(first[j], n):
                column = 6 * keyframe[m]
                for q in range(6):
                    u, v, rho = pose_point[m, q, 0], pose_point[m, q, 1], pose_point[m, q, 2]
                    below = band[column + q, row - column - q : row - column - q + 6]
                    for p in range(6):
                        below[p] -= by_u[p] * u + by_v[p] * v + by_rho[p] * rho
            for q in range(6):
                u, v, rho = pose_point[n, q, 0], pose_point[n, q, 1], pose_point[n, q, 2]
                for p in range(q, 6):
                    band[row + q, p - q] -= by_u[p] * u + by_v[p] * v + by_rho[p] * rho


@njit(cache=True)
def add_scores(  # noqa: PLR0917
    first: IntArray,
    keyframe: IntArray,
    inverse: FloatArray,
    g_own: FloatArray,
    lens_point: FloatArray,
    pose_point: FloatArray,
    g_of_pose: FloatArray,
    g_of_lens: FloatArray,
    sign: FloatArray,
    drawn: FloatArray,
) -> None:
    """Add the gradient of each track by poses and lens, less that of its point, times its signs (J, S) to `drawn` (6 K + 3, S)."""
    n_lens = len(drawn) - 3
    for j in range(len(first) - 1):
        solved = inverse[j] @ g_own[j]
        for p in range(3):
            _add_signed(g_of_lens[j, p] - lens_point[j, p] @ solved, sign[j], drawn[n_lens + p])
        for n in range(first[j], first[j + 1]):
            for p in range(6):
                value = g_of_pose[n, p] - pose_point[n, p] @ solved
                _add_signed(value, sign[j], drawn[6 * keyframe[n] + p])


@njit(cache=True)
def _add_signed(value: float, sign: FloatArray, row: FloatArray) -> None:
    """Add a value times its signs (S,) to a row (S,)."""
    for s in range(len(row)):
        row[s] += sign[s] * value
