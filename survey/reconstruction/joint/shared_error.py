"""Rows of the path's error for the heights of points, and its dominant modes."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import LinearOperator, eigsh

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.path_error import POSE, PathError
from survey.data.surface_points import SurfacePoints

# A slope and an arm that bring the unknowns of a pose to one unit, metres of height, before modes are compared.
_TYPICAL_SLOPE, _TYPICAL_ARM_M = 0.06, 12.0


@dataclass(frozen=True)
class SharedError:
    """Unknowns that points share: ``rows`` (N, S) of a point's height, prior ``information`` (S, S), both sparse.

    ``rest_m2`` (N,) is what the rows leave out, as if it were each point's own, and
    ``poses`` (6 K, S) leads back to the error of each keyframe's pose.
    """

    rows: Any
    information: Any
    rest_m2: FloatArray
    poses: Any

    @classmethod
    def full(cls, points: SurfacePoints, path: PathError, slope: FloatArray) -> "SharedError":
        """Keep every unknown of the path."""
        keyframe, by_pose = _levers(points, slope)
        rest = np.zeros(len(points))
        return cls(path.rows(keyframe, by_pose), path.information, rest, _every_pose(path))

    @classmethod
    def dominant(
        cls, points: SurfacePoints, path: PathError, slope: FloatArray, modes: FloatArray
    ) -> "SharedError":
        """Keep a few modes of the path's error, as `dominant_modes` gives them; the rest becomes the points' own."""
        keyframe, by_pose = _levers(points, slope)
        rows = path.rows(keyframe, by_pose)
        kept = np.asarray(rows @ modes)
        total = np.einsum("ni,nij,nj->n", by_pose, path.pose_covariance(keyframe), by_pose)
        rest = np.maximum(total - np.sum(kept**2, axis=1), 0.0)
        unit = sparse.identity(modes.shape[1], format="csr")
        return cls(sparse.csr_array(kept), unit, rest, sparse.csr_array(_every_pose(path) @ modes))


def dominant_modes(path: PathError, rank: int) -> FloatArray:
    """Return V (unknowns, r) with V Vᵀ close to the covariance of the poses' errors, where it matters for heights."""
    scale = np.array([_TYPICAL_SLOPE] * 2 + [1.0, _TYPICAL_SLOPE * _TYPICAL_ARM_M] + [_TYPICAL_ARM_M] * 2)
    scales = np.tile(scale, len(path))
    poses = _every_pose(path)
    rank = min(rank, len(scales) - 1)

    def product(vector: FloatArray) -> FloatArray:
        scaled: FloatArray = scales * (poses @ path.solve(poses.T @ (scales * vector.ravel())))
        return scaled

    size = len(scales)
    operator = LinearOperator((size, size), matvec=product, dtype=np.float64)
    value, vector = eigsh(operator, k=rank, v0=np.ones(size))
    modes: FloatArray = poses.T @ ((vector * np.sqrt(np.maximum(value, 0.0))) / scales[:, None])
    return modes


def height_levers(points: SurfacePoints, slope: FloatArray) -> FloatArray:
    r"""Return how a point's height above the map answers to errors of its pose (N, 6).

    A point reported at the arm (x, y, z) from a pose that errs by (e, ψ, θ, φ) errs by
    e + ∂(R o)/∂(ψ, θ, φ), and lies higher above a surface of slope g by the vertical part
    less g times the horizontal one. Heading and arm give the levers: across the heading
    for roll, along it for pitch.
    """
    (x, y, z), heading = _arms(points)
    cosine, sine = np.cos(heading), np.sin(heading)
    above = np.column_stack([-slope, np.ones(len(slope))])
    by_yaw = np.column_stack([-y, x, np.zeros_like(x)])
    by_pitch = np.column_stack([cosine * z, sine * z, -(cosine * x + sine * y)])
    by_roll = np.column_stack([sine * z, -cosine * z, cosine * y - sine * x])
    turns = [np.einsum("ni,ni->n", above, by) for by in (by_yaw, by_pitch, by_roll)]
    return np.column_stack([above, *turns])


def bow_levers(points: SurfacePoints) -> FloatArray:
    """Return how far ahead of its pose each point lies, and how far aside, to either side (N, 2) [m].

    What a camera sees may lie too high or too low by a share of either, on all of a drive alike: lens and
    mounting are never known exactly. Swaths then look like ridges, and the gaps between them like valleys.
    """
    (x, y, _), heading = _arms(points)
    cosine, sine = np.cos(heading), np.sin(heading)
    return np.column_stack([cosine * x + sine * y, np.abs(cosine * y - sine * x)])


def side_by_side(*blocks: Any) -> Any:
    """Return matrices of as many rows, sparse or not, as one sparse one."""
    parts: Any = blocks
    return sparse.csr_array(sparse.hstack(parts))


def _arms(points: SurfacePoints) -> tuple[FloatArray, FloatArray]:
    """Return the vectors (3, N) from the body to the points [m], and the body's headings (N,) [rad]."""
    if points.body is None or points.heading_rad is None:
        raise InputError(
            "the points do not state place and heading of the body that they were seen from; localize again, "
            "or map them as independent."
        )
    return (points.xyz - points.body).T, points.heading_rad


def keyframes_of(points: SurfacePoints) -> FloatArray:
    """Return where among the keyframes of the path the points (N,) were seen from; refuse points that do not name them."""
    if points.keyframe is None:
        raise InputError(
            "the points do not name the keyframes that they were seen from; localize again, or map them as independent."
        )
    return points.keyframe


def _levers(points: SurfacePoints, slope: FloatArray) -> tuple[FloatArray, FloatArray]:
    return keyframes_of(points), height_levers(points, slope)


def _every_pose(path: PathError) -> Any:
    """Return the rows (6 K, unknowns) of the errors of all keyframes' poses."""
    keyframe = np.repeat(np.arange(len(path), dtype=np.float64), POSE)
    return path.rows(keyframe, np.tile(np.eye(POSE), (len(path), 1)))
