"""Batch bundle adjustment over keyframes: poses, points and the lens.

`BundleAdjustment` estimates all poses, points and the lens by Levenberg-Marquardt with the points eliminated by the Schur
complement. Cauchy's loss is that of all errors.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import cv2
import numpy as np
import scipy.sparse as sp
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.transform import Rotation

from survey import Camera
from survey.core import BoolArray, FloatArray, IntArray

_LEAST_DEPTH_M = 1e-3
_OUTLYING = 2.5  # standard deviations, of Cauchy's loss
_BEHIND = 1e4  # squared error of a point behind the camera
_HELD_INFORMATION = (
    1e10  # information that holds the first pose, the size of the path, and what the prior excludes
)
_ANY = 1.0  # information per step about poses that see nothing [1/m², 1/rad²]
_SIZE_HELD, _SMALLEST = 1e6, 1e-9
_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-4, 1e-9, 1e6
_ENOUGH = 2e-5  # relative decrease of the cost below which the adjustment ends
_N_ITERATIONS = 50
_EXTREME = np.array([0.7, 2.0, 2.0])


class LensChange(NamedTuple):
    """Logarithm of the factor of the focal length, and changes of the first two radial coefficients."""

    log_focal: float = 0.0
    k1: float = 0.0
    k2: float = 0.0

    def applied(self, camera: Camera) -> Camera:
        """Return the camera with this change of its lens."""
        matrix, distortion = camera.matrix.copy(), camera.distortion.copy()
        matrix[[0, 1], [0, 1]] *= np.exp(self.log_focal)
        distortion[:2] += [self.k1, self.k2]
        return replace(camera, matrix=matrix, distortion=distortion)


class PixelObservations(NamedTuple):
    """Pixels (N, 2) of points, with the keyframe and the number of the point (N,) of each."""

    keyframe: IntArray
    point: IntArray
    pixel: FloatArray


class Travel(NamedTuple):
    """Travel by wheels between neighbouring keyframes (K - 1,) [m], NaN where unknown, and its error."""

    rolled_m: FloatArray
    sigma_m: FloatArray


class Geometry(NamedTuple):
    """Camera poses (K, 4, 4), points (J, 3) and the lens."""

    poses: FloatArray
    points: FloatArray
    lens: LensChange


class Adjusted(NamedTuple):
    """Result of a bundle adjustment.

    ``covariance`` (3, 3) of the lens includes its prior; ``cost`` is twice the negative logarithm of the
    likelihood; ``error_px`` (N,) is the distance of each observation from its point.
    """

    geometry: Geometry
    covariance: FloatArray
    cost: float
    error_px: FloatArray


class _Linear(NamedTuple):
    """Errors (N, 2) with their weights (N,), and how pixels change with pose, lens and point of each."""

    weight: FloatArray
    error: FloatArray
    by_pose: FloatArray
    by_lens: FloatArray
    by_point: FloatArray


class _Equations(NamedTuple):
    """Blocks of the normal equations: poses, lens, points, and what couples them; gradients with the same letters."""

    poses: FloatArray
    pose_lens: FloatArray
    lens: FloatArray
    pose_point: Any
    lens_point: FloatArray
    points: FloatArray
    g_poses: FloatArray
    g_lens: FloatArray
    g_points: FloatArray


class BundleAdjustment:
    r"""Camera poses, points and lens of least squared error over all keyframes.

    Minimizes by Levenberg-Marquardt

    .. math:: Σ ρ(|u_{kj} − π(R_k^T(x_j − t_k); f, k_1, k_2)|² / σ²) + Σ ρ((|t_{k+1} − t_k| − r_k)² / σ_k²) + |c|² / σ_c²

    with Cauchy's loss ρ, the travel by wheels r where they measured, and the prior of the lens c.
    Points are eliminated by the Schur complement. The first pose is held, and without wheels the
    size of the path.

    `camera`: calibration that the lens is relative to. `seen`: pixels of the points. `pixel_sigma`: error of
    a pixel [pixels]. `prior_sigma` (3,): prior errors of log f, k1 and k2; 0 holds a parameter. `travel`:
    travel by wheels.
    """

    def __init__(
        self,
        camera: Camera,
        seen: PixelObservations,
        pixel_sigma: float,
        prior_sigma: FloatArray,
        travel: Travel,
    ) -> None:
        self._camera, self._seen, self._sigma = camera, seen, pixel_sigma
        self._prior = np.where(
            prior_sigma > 0.0, np.maximum(prior_sigma, _SMALLEST) ** -2.0, _HELD_INFORMATION
        )
        self._rolled = np.flatnonzero(np.isfinite(travel.rolled_m))
        self._travel = Travel(*(values[self._rolled] for values in travel))

    def solve(self, start: Geometry, n_iterations: int = _N_ITERATIONS) -> Adjusted:
        """Adjust from initial poses, points and lens."""
        state, cost, damping = start, self._cost(start), _DAMPING
        for _ in range(n_iterations):
            equations, before = self._linearized(state), cost
            while damping < _MOST_DAMPING:
                trial = _moved_geometry(state, equations, damping)
                trial_cost = np.inf if trial is None else self._cost(trial)
                if trial is not None and trial_cost < cost:
                    state, cost, damping = trial, trial_cost, max(0.2 * damping, _LEAST_DAMPING)
                    break
                damping *= 8.0
            if before - cost < _ENOUGH * before:
                break
        error_px = np.sqrt(self._squares(state)[0]) * self._sigma
        return Adjusted(state, _lens_covariance(self._linearized(state)), cost, error_px)

    def _local(self, state: Geometry) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return the rotation of each observation's camera, its point in that frame, and whether it lies ahead."""
        rotation, place = (state.poses[self._seen.keyframe, :3, part] for part in (slice(3), 3))
        local = np.einsum("nji,nj->ni", rotation, state.points[self._seen.point] - place)
        ahead = local[:, 2] > _LEAST_DEPTH_M
        local[~ahead] = [0.0, 0.0, 1.0]
        return rotation, local, ahead

    def _squares(self, state: Geometry) -> tuple[FloatArray, FloatArray]:
        """Return the squared normalized errors of pixels and of wheels."""
        _, local, ahead = self._local(state)
        off = (self._seen.pixel - state.lens.applied(self._camera).project(local)) / self._sigma
        step_m = np.linalg.norm(np.diff(state.poses[:, :3, 3], axis=0), axis=1)[self._rolled]
        rolled = (step_m - self._travel.rolled_m) / self._travel.sigma_m
        return np.where(ahead, (off**2).sum(axis=1), _BEHIND), rolled**2

    def _cost(self, state: Geometry) -> float:
        loss = sum(np.log1p(squares / _OUTLYING**2).sum() for squares in self._squares(state))
        return float(_OUTLYING**2 * loss + (self._prior * np.array(state.lens) ** 2).sum())

    def _linearized(self, state: Geometry) -> _Equations:
        rotation, local, ahead = self._local(state)
        camera = state.lens.applied(self._camera)
        pixel, by_local, by_lens = _projected(camera, local)
        by_lens = by_lens * (self._prior < _HELD_INFORMATION)
        error = self._seen.pixel - pixel
        weight = ahead / (self._sigma**2 + (error**2).sum(axis=1) / _OUTLYING**2)
        by_point = by_local @ rotation.transpose(0, 2, 1)
        by_pose = np.concatenate([by_local @ _skew(local), -by_point], axis=2)
        equations = self._assembled(_Linear(weight, error, by_pose, by_lens, by_point), state)
        self._add_wheels(equations, state.poses)
        self._hold(equations, state)
        return equations

    def _assembled(self, linear: _Linear, state: Geometry) -> _Equations:
        """Sum the blocks of all observations."""
        keyframe, point = self._seen.keyframe, self._seen.point
        n_poses, n_points = len(state.poses), len(state.points)
        weighted_pose, weighted_lens, weighted_point = (
            (linear.weight[:, None, None] * part).transpose(0, 2, 1) for part in linear[2:]
        )
        _, error, by_pose, by_lens, by_point = linear
        blocks = np.zeros((n_poses, 6, n_poses, 6))
        every = np.arange(n_poses)
        blocks[every, :, every, :] = _summed(keyframe, weighted_pose @ by_pose, n_poses)
        return _Equations(
            blocks.reshape(6 * n_poses, 6 * n_poses),
            _summed(keyframe, weighted_pose @ by_lens, n_poses).reshape(-1, 3),
            (weighted_lens @ by_lens).sum(axis=0) + np.diag(self._prior),
            _block_rows(keyframe, point, weighted_pose @ by_point, (n_poses, n_points)),
            _summed(point, weighted_lens @ by_point, n_points).transpose(1, 0, 2).reshape(3, -1),
            _summed(point, weighted_point @ by_point, n_points),
            _summed(keyframe, weighted_pose @ error[:, :, None], n_poses).ravel(),
            (weighted_lens @ error[:, :, None]).sum(axis=0).ravel() - self._prior * np.array(state.lens),
            _summed(point, weighted_point @ error[:, :, None], n_points)[..., 0],
        )

    def _add_wheels(self, equations: _Equations, poses: FloatArray) -> None:
        """Add the travel by wheels, each with the weight that Cauchy's loss leaves it."""
        for k, rolled_m, sigma_m in zip(self._rolled.tolist(), *self._travel, strict=True):
            step = poses[k + 1, :3, 3] - poses[k, :3, 3]
            length_m = max(float(np.linalg.norm(step)), _SMALLEST)
            off = (rolled_m - length_m) / sigma_m
            slope = np.r_[-step, step] / (length_m * sigma_m)
            index = np.r_[6 * k + 3 : 6 * k + 6, 6 * k + 9 : 6 * k + 12]
            weight = 1.0 / (1.0 + (off / _OUTLYING) ** 2)
            equations.poses[np.ix_(index, index)] += weight * np.outer(slope, slope)
            equations.g_poses[index] += weight * off * slope

    def _hold(self, equations: _Equations, state: Geometry) -> None:
        """Hold the first pose, weakly all others, and without wheels the size of the path."""
        first, every = np.arange(6), np.arange(len(equations.poses))
        equations.poses[every, every] += _ANY
        equations.poses[first, first] += _HELD_INFORMATION
        if len(self._rolled):
            return
        place = state.poses[:, :3, 3] - state.poses[0, :3, 3]
        size = np.zeros((len(place), 6))
        size[:, 3:] = place / max(float((place**2).sum()), _SMALLEST)
        equations.poses[...] += _SIZE_HELD * np.outer(size, size)


def _projected(camera: Camera, local: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return pixels (N, 2) of points, and how they change with the points (N, 2, 3) and the lens (N, 2, 3)."""
    zero, points = np.zeros(3), np.ascontiguousarray(local[:, None])
    if camera.model == "fisheye":
        found = cv2.fisheye.projectPoints(points, zero, zero, camera.matrix, camera.distortion)
        by_point, by_focal, by_radial = (slice(first, first + n) for first, n in ((11, 3), (0, 2), (4, 2)))
    else:
        found = cv2.projectPoints(points, zero, zero, camera.matrix, camera.distortion)
        by_point, by_focal, by_radial = (slice(first, first + n) for first, n in ((3, 3), (6, 2), (10, 2)))
    pixel = np.asarray(found[0], dtype=np.float64).reshape(-1, 2)
    slopes = np.asarray(found[1], dtype=np.float64).reshape(len(local), 2, -1)
    focal = slopes[:, :, by_focal] @ np.diag(camera.matrix)[:2, None]
    return pixel, slopes[:, :, by_point], np.concatenate([focal, slopes[:, :, by_radial]], axis=2)


def _moved_geometry(state: Geometry, equations: _Equations, damping: float) -> Geometry | None:
    """Return the geometry after one damped step; None where rounding errors leave no solution."""
    points = equations.points.copy()
    every = np.arange(3)
    points[:, every, every] = (1.0 + damping) * points[:, every, every] + _SMALLEST
    inverse = np.asarray(np.linalg.inv(points), dtype=np.float64)
    reduced, right = _reduced(equations, inverse)
    diagonal = np.arange(len(reduced))
    reduced[diagonal, diagonal] *= 1.0 + damping
    try:
        step = cho_solve(cho_factor(reduced), right)
    except np.linalg.LinAlgError:
        return None
    pull = equations.pose_point.T @ step[:-3] + equations.lens_point.T @ step[-3:]
    shift = np.einsum("jik,jk->ji", inverse, equations.g_points - pull.reshape(-1, 3))
    poses, moves = state.poses.copy(), step[:-3].reshape(-1, 6)
    poses[:, :3, :3] = poses[:, :3, :3] @ Rotation.from_rotvec(moves[:, :3]).as_matrix()
    poses[:, :3, 3] += moves[:, 3:]
    lens = LensChange(*np.clip(np.array(state.lens) + step[-3:], -_EXTREME, _EXTREME).tolist())
    return Geometry(poses, state.points + shift, lens)


def _reduced(equations: _Equations, inverse: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the Schur complement (6 K + 3, 6 K + 3) of the points, and its right-hand side."""
    n_points = len(inverse)
    solved = sp.bsr_array((inverse, np.arange(n_points), np.arange(n_points + 1)))
    of_pose = equations.pose_point @ solved
    of_lens = np.asarray(solved @ equations.lens_point.T).T
    poses = equations.poses - (of_pose @ equations.pose_point.T).toarray()
    coupled = equations.pose_lens - np.asarray(of_pose @ equations.lens_point.T)
    lens = equations.lens - of_lens @ equations.lens_point.T
    gradient = equations.g_points.ravel()
    right = np.r_[equations.g_poses - of_pose @ gradient, equations.g_lens - of_lens @ gradient]
    return np.block([[poses, coupled], [coupled.T, lens]]), right


def _lens_covariance(equations: _Equations) -> FloatArray:
    """Return the covariance (3, 3) of the lens when poses and points are unknown too; infinite where that is singular."""
    inverse = np.asarray(np.linalg.inv(equations.points + _SMALLEST * np.eye(3)), dtype=np.float64)
    reduced, _ = _reduced(equations, inverse)
    units = np.eye(len(reduced))[:, -3:]
    try:
        covariance: FloatArray = cho_solve(cho_factor(reduced), units)[-3:]
    except np.linalg.LinAlgError:
        return np.diag(np.full(3, np.inf))
    return covariance


def _block_rows(row: IntArray, column: IntArray, blocks: FloatArray, shape: tuple[int, int]) -> Any:
    """Return a sparse matrix of blocks (N, 6, 3), one for each pair of row and column."""
    order = np.lexsort((column, row))
    starts = np.searchsorted(row[order], np.arange(shape[0] + 1))
    size = (6 * shape[0], 3 * shape[1])
    return sp.bsr_array((np.ascontiguousarray(blocks[order]), column[order], starts), shape=size)


def _summed(index: IntArray, values: FloatArray, n: int) -> FloatArray:
    """Sum values (N, ...) of equal index to (n, ...)."""
    flat = values.reshape(len(values), -1)
    sums = sp.csr_array((np.ones(len(index)), (index, np.arange(len(index)))), shape=(n, len(index))) @ flat
    total: FloatArray = np.asarray(sums).reshape(n, *values.shape[1:])
    return total


def _skew(vectors: FloatArray) -> FloatArray:
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
