"""Camera resection: pose of one image from known points."""

import cv2
import numpy as np

from survey.core.arrays import BoolArray, FloatArray


def resect(
    predicted: FloatArray,
    points: FloatArray,
    is_far: BoolArray,
    rays: FloatArray,
    *,
    angle_sigma: float,
    turn_sigma: float,
    shift_sigma: float,
) -> tuple[FloatArray, FloatArray]:
    r"""Find the camera's pose from rays to known points, near a predicted pose.

    Minimizes Σ ρ(|u × û(T)|² / σ²) plus the prediction's own term by Gauss-Newton with
    Geman-McClure weights w = (1 + e²/c²)⁻²; u are the measured unit rays and û those that
    the pose gives. Points at infinity move with the rotation only.

    Parameters
    ----------
    predicted : (4, 4) ndarray
        Camera to world.
    points : (N, 3) ndarray
        World places, or unit directions where `is_far`.
    is_far : (N,) ndarray of bool
        Which are directions.
    rays : (N, 3) ndarray
        Unit, camera frame.
    angle_sigma : float
        Error of a ray [rad].
    turn_sigma, shift_sigma : float
        Error of the prediction [rad], [m].

    Returns
    -------
    pose : (4, 4) ndarray
        Camera to world.
    errors : (N,) ndarray
        Angle between measured and expected ray [rad].
    """
    rotation, place = predicted[:3, :3].copy(), predicted[:3, 3].copy()
    base_turn, base_place = rotation.copy(), place.copy()
    for iteration in range(10):
        expected, distance = _expected(rotation, place, points, is_far)
        error = rays - expected
        # From a wide basin to a narrow one, so that a bad prediction does not reject good points.
        width = angle_sigma * max(3.0, 24.0 * 0.6**iteration)
        weight = (1.0 + (error**2).sum(axis=1) / width**2) ** -2 / angle_sigma**2
        jacobian = _jacobian(expected, distance, is_far)
        normal = np.einsum("n,nki,nkj->ij", weight, jacobian, jacobian)
        right = np.einsum("n,nki,nk->i", weight, jacobian, error)
        normal[:3, :3] += np.eye(3) / turn_sigma**2
        normal[3:, 3:] += np.eye(3) / shift_sigma**2
        right[:3] -= cv2.Rodrigues(base_turn.T @ rotation)[0].ravel() / turn_sigma**2
        right[3:] -= rotation.T @ (place - base_place) / shift_sigma**2
        step = np.linalg.solve(normal, right)
        place = place + rotation @ step[3:]
        rotation = rotation @ cv2.Rodrigues(step[:3])[0]
        if iteration > 5 and np.abs(step).max() < 1e-6:
            break
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, place
    expected, _ = _expected(rotation, place, points, is_far)
    return pose, np.linalg.norm(rays - expected, axis=1)


def resection_information(
    pose: FloatArray, points: FloatArray, is_far: BoolArray, angle_sigma: float
) -> FloatArray:
    """Return the information (6, 6) of rays to known points about rotation and shift in the camera frame.

    Points, far points and errors are those of `resect`; its prediction is not in it.
    """
    jacobian = _jacobian(*_expected(pose[:3, :3], pose[:3, 3], points, is_far), is_far)
    information: FloatArray = np.einsum("nki,nkj->ij", jacobian, jacobian) / angle_sigma**2
    return information


def _jacobian(expected: FloatArray, distance: FloatArray, is_far: BoolArray) -> FloatArray:
    """Return how û changes (N, 3, 6): by û × dθ with the turn, by -(I - û ûᵀ) Rᵀ dt / distance with the shift."""
    jacobian = np.zeros((len(expected), 3, 6))
    jacobian[:, :, :3] = _skew(expected)
    across = np.eye(3) - expected[:, :, None] * expected[:, None, :]
    jacobian[:, :, 3:] = -(across / distance[:, None, None]) * (~is_far)[:, None, None]
    return jacobian


def _expected(
    rotation: FloatArray, place: FloatArray, points: FloatArray, is_far: BoolArray
) -> tuple[FloatArray, FloatArray]:
    seen = np.where(is_far[:, None], points, points - place) @ rotation
    distance = np.maximum(np.linalg.norm(seen, axis=1), 1e-6)
    return seen / distance[:, None], distance


def _skew(vectors: FloatArray) -> FloatArray:
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
