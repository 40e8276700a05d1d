# ruff: noqa: PLR0917 - compiled functions take no keywords
"""Levenberg-Marquardt over the poses of a window and the corners that they saw, compiled.

A corner j is a unit direction m_j and an inverse distance ρ_j from a fixed origin o, so that a camera at c with the rotation R
sees it along

    h = Rᵀ (m_j + ρ_j (o − c)),

which is linear in both and does not change its form at infinity, ρ = 0 (Civera, Davison and Montiel, "Inverse Depth
Parametrization for Monocular SLAM", IEEE Transactions on Robotics 24, 2008). Corners are eliminated by the Schur complement
(Triggs et al., "Bundle Adjustment: A Modern Synthesis", 2000). A pose changes by a turn φ about the body's place and a shift τ,
both along the axes of the window's frame.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from survey.core import FloatArray, IntArray

_OUTLYING = 5.0  # standard deviations of a pixel, of Geman and McClure's loss
# Wheels that disagree by more standard deviations are down-weighted: they slip. The first iterations give them more, so that
# one step that slipped does not settle the scale for good.
_SLIP_SIGMAS, _FIRST_SLIP_SIGMAS, _NARROWER = 3.0, 48.0, 0.25
_LEAST_AHEAD = 0.01
_MOST_NEARNESS = 20.0  # [1/m]
_ANY = 1e-4  # information about an inverse distance that nothing shows [m²]
_N_ITERATIONS, _N_TRIES = 6, 4
_DAMPING, _LEAST_DAMPING = 1e-4, 1e-8
_ENOUGH = 1e-3  # relative decrease of the cost below which the adjustment ends


class WindowPoses(NamedTuple):
    """Rotations (W, 3, 3) and places (W, 3) of the body; the first `n_held` are held."""

    rotation: FloatArray
    place: FloatArray
    n_held: int


class Mount(NamedTuple):
    """Rotation (3, 3) and place (3,) of the camera on the body."""

    rotation: FloatArray
    place: FloatArray


class Sights(NamedTuple):
    """Observations (N,), those of one corner together, oldest first.

    ``start`` (J + 1,): where those of each corner begin; ``frame``: pose of the window; ``plane`` (N, 2): where the ray
    meets z = 1; ``weight``: one over the standard deviation on that plane.
    """

    start: IntArray
    frame: IntArray
    plane: FloatArray
    weight: FloatArray


class Corners(NamedTuple):
    """Directions (J, 3) and inverse distances (J,) [1/m] from `origin` (3,); NaN where not estimated yet."""

    direction: FloatArray
    nearness: FloatArray
    origin: FloatArray


class MotionLinks(NamedTuple):
    """Motion to each free pose from the one before.

    ``turn`` (F, 3, 3) and ``shift`` (F, 3) [m] in the axes of the pose before; ``ahead`` (F, 3, 3): axes whose first is the
    direction of travel; ``sigma`` (F, 3): of the turn [rad], of the shift along and aside [m].
    """

    turn: FloatArray
    shift: FloatArray
    ahead: FloatArray
    sigma: FloatArray


@njit(cache=True)
def exp_rotation(x: float, y: float, z: float) -> FloatArray:
    """Return the rotation (3, 3) by a vector [rad], by the formula of Rodrigues."""
    square = x * x + y * y + z * z
    angle = np.sqrt(square)
    a, b = 1.0 - square / 6.0, 0.5 - square / 24.0
    if angle > 1e-4:
        a, b = np.sin(angle) / angle, (1.0 - np.cos(angle)) / square
    turn = np.empty((3, 3))
    turn[0, 0], turn[0, 1], turn[0, 2] = 1.0 - b * (y * y + z * z), b * x * y - a * z, b * x * z + a * y
    turn[1, 0], turn[1, 1], turn[1, 2] = b * x * y + a * z, 1.0 - b * (x * x + z * z), b * y * z - a * x
    turn[2, 0], turn[2, 1], turn[2, 2] = b * x * z - a * y, b * y * z + a * x, 1.0 - b * (x * x + y * y)
    return turn


@njit(cache=True)
def product(one: FloatArray, other: FloatArray) -> FloatArray:
    """Return the product of two matrices (3, 3)."""
    product = np.empty((3, 3))
    for a in range(3):
        for b in range(3):
            product[a, b] = one[a, 0] * other[0, b] + one[a, 1] * other[1, b] + one[a, 2] * other[2, b]
    return product


@njit(cache=True)
def _put(matrix: FloatArray, target: FloatArray) -> None:
    """Write a matrix (3, 3) to another. For an assignment numba compiles the text of its refusal, which takes 3 s."""
    for a in range(3):
        for b in range(3):
            target[a, b] = matrix[a, b]


@njit(cache=True)
def log_rotation(rotation: FloatArray) -> tuple[float, float, float]:
    """Return the vector [rad] of a rotation (3, 3) by less than half a circle."""
    x = 0.5 * (rotation[2, 1] - rotation[1, 2])
    y = 0.5 * (rotation[0, 2] - rotation[2, 0])
    z = 0.5 * (rotation[1, 0] - rotation[0, 1])
    sine = np.sqrt(x * x + y * y + z * z)
    cosine = 0.5 * (rotation[0, 0] + rotation[1, 1] + rotation[2, 2] - 1.0)
    factor = np.arctan2(sine, cosine) / sine if sine > 1e-8 else 1.0
    return factor * x, factor * y, factor * z


@njit(cache=True)
def adjusted(
    poses: WindowPoses, mount: Mount, sights: Sights, corners: Corners, links: MotionLinks
) -> tuple[WindowPoses, Corners, FloatArray]:
    """Return poses and corners of least squared error, and the standard deviations (J,) of the inverse distances [1/m]."""
    _begin(poses, mount, sights, corners)
    damping, slip = _DAMPING, _FIRST_SLIP_SIGMAS
    for _ in range(_N_ITERATIONS):
        before = cost = _cost(poses, mount, sights, corners, links, slip)
        of_poses, right, coupling, inner, inner_right = _linearized(
            poses, mount, sights, corners, links, slip
        )
        for j in range(len(inner)):
            if corners.nearness[j] <= 0.0:
                _hold_at_infinity(sights, j, inner, inner_right, coupling)
        for _ in range(_N_TRIES):
            step, shift = _step(of_poses, right, coupling, inner, inner_right, sights, poses.n_held, damping)
            moved = _moved_poses(poses, step)
            shifted = _moved_corners(corners, shift)
            cost = _cost(moved, mount, sights, shifted, links, slip)
            if cost < before:
                poses, corners = moved, shifted
                damping = max(0.1 * damping, _LEAST_DAMPING)
                break
            damping *= 10.0
        if slip == _SLIP_SIGMAS and before - cost < _ENOUGH * before:
            break
        slip = max(_NARROWER * slip, _SLIP_SIGMAS)
    inner = _linearized(poses, mount, sights, corners, links, slip)[3]
    return poses, corners, _nearness_sigma(inner)


@njit(cache=True)
def _cameras(poses: WindowPoses, mount: Mount) -> tuple[FloatArray, FloatArray]:
    """Return rotations (W, 3, 3) and places (W, 3) of the cameras."""
    rotation, place = np.empty_like(poses.rotation), np.empty_like(poses.place)
    for k in range(len(rotation)):
        for a in range(3):
            place[k, a] = poses.place[k, a]
            for b in range(3):
                place[k, a] += poses.rotation[k, a, b] * mount.place[b]
                rotation[k, a, b] = 0.0
                for c in range(3):
                    rotation[k, a, b] += poses.rotation[k, a, c] * mount.rotation[c, b]
    return rotation, place


@njit(cache=True)
def _begin(poses: WindowPoses, mount: Mount, sights: Sights, corners: Corners) -> None:
    """Fill in first guesses: along the oldest ray, at the inverse distance that fits the others best."""
    rotation, place = _cameras(poses, mount)
    origin = corners.origin
    for j in range(len(corners.nearness)):
        if not np.isnan(corners.nearness[j]):
            continue
        first, above, below = sights.start[j], 0.0, _ANY
        f = sights.frame[first]
        m0, m1, m2 = rotated(rotation[f], sights.plane[first, 0], sights.plane[first, 1], 1.0)
        for i in range(first + 1, sights.start[j + 1]):
            k = sights.frame[i]
            u, v = sights.plane[i, 0], sights.plane[i, 1]
            x, y, z = turned_back(rotation[k], m0, m1, m2)
            p, q, r = turned_back(
                rotation[k], place[f, 0] - place[k, 0], place[f, 1] - place[k, 1], place[f, 2] - place[k, 2]
            )
            above -= sights.weight[i] ** 2 * ((x - u * z) * (p - u * r) + (y - v * z) * (q - v * r))
            below += sights.weight[i] ** 2 * ((p - u * r) ** 2 + (q - v * r) ** 2)
        near = above / below if 0.0 < above < _MOST_NEARNESS * below else 0.0
        m0 += near * (place[f, 0] - origin[0])
        m1 += near * (place[f, 1] - origin[1])
        m2 += near * (place[f, 2] - origin[2])
        _set_direction(corners.direction, j, m0, m1, m2)
        corners.nearness[j] = near / np.sqrt(m0 * m0 + m1 * m1 + m2 * m2)


@njit(cache=True)
def _set_direction(direction: FloatArray, j: int, x: float, y: float, z: float) -> None:
    length = np.sqrt(x * x + y * y + z * z)
    direction[j, 0], direction[j, 1], direction[j, 2] = x / length, y / length, z / length


@njit(cache=True)
def rotated(rotation: FloatArray, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return R (x, y, z)."""
    return (
        rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z,
        rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z,
        rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z,
    )


@njit(cache=True)
def _cost(
    poses: WindowPoses, mount: Mount, sights: Sights, corners: Corners, links: MotionLinks, slip: float
) -> float:
    """Return twice the negative logarithm of the likelihood."""
    rotation, place = _cameras(poses, mount)
    cost = 0.0
    for j in range(len(corners.nearness)):
        for i in range(sights.start[j], sights.start[j + 1]):
            k = sights.frame[i]
            d0, d1, d2 = _toward(corners, j, place[k])
            x, y, z = turned_back(rotation[k], d0, d1, d2)
            if z > _LEAST_AHEAD:
                off_x, off_y = x / z - sights.plane[i, 0], y / z - sights.plane[i, 1]
                square = (off_x * off_x + off_y * off_y) * sights.weight[i] ** 2
                cost += square / (1.0 + square / _OUTLYING**2)
            else:
                cost += _OUTLYING**2
    for n in range(len(links.sigma)):
        error = _link_errors(poses, links, n)
        cost += error[0] ** 2 + error[1] ** 2 + error[2] ** 2
        cost += slip**2 * np.log1p(error[3] ** 2 / slip**2)
        cost += slip**2 * np.log1p((error[4] ** 2 + error[5] ** 2) / slip**2)
    return cost


@njit(cache=True)
def _toward(corners: Corners, j: int, place: FloatArray) -> tuple[float, float, float]:
    """Return the direction, not of unit length, of a corner from a place."""
    near = corners.nearness[j]
    return (
        corners.direction[j, 0] + near * (corners.origin[0] - place[0]),
        corners.direction[j, 1] + near * (corners.origin[1] - place[1]),
        corners.direction[j, 2] + near * (corners.origin[2] - place[2]),
    )


@njit(cache=True)
def turned_back(rotation: FloatArray, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return Rᵀ (x, y, z)."""
    return (
        rotation[0, 0] * x + rotation[1, 0] * y + rotation[2, 0] * z,
        rotation[0, 1] * x + rotation[1, 1] * y + rotation[2, 1] * z,
        rotation[0, 2] * x + rotation[1, 2] * y + rotation[2, 2] * z,
    )


@njit(cache=True)
def _link_errors(poses: WindowPoses, links: MotionLinks, n: int) -> FloatArray:
    """Return the normalized errors (6,) of the turn, and of the shift along and aside."""
    k = poses.n_held + n
    before, now, place = poses.rotation[k - 1], poses.rotation[k], poses.place
    x, y, z = log_rotation(product(links.turn[n].T, product(before.T, now)))
    p, q, r = turned_back(
        before, place[k, 0] - place[k - 1, 0], place[k, 1] - place[k - 1, 1], place[k, 2] - place[k - 1, 2]
    )
    shift = links.shift[n]
    p, q, r = turned_back(links.ahead[n], p - shift[0], q - shift[1], r - shift[2])
    error = np.empty(6)
    turn_sigma, along_sigma, aside_sigma = links.sigma[n]
    error[0], error[1], error[2] = x / turn_sigma, y / turn_sigma, z / turn_sigma
    error[3], error[4], error[5] = p / along_sigma, q / aside_sigma, r / aside_sigma
    return error


@njit(cache=True)
def _linearized(
    poses: WindowPoses, mount: Mount, sights: Sights, corners: Corners, links: MotionLinks, slip: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the normal equations: poses (6F, 6F), (6F,), coupling (N, 6, 3), corners (J, 3, 3), (J, 3)."""
    n_free = len(poses.place) - poses.n_held
    of_poses, right = np.zeros((6 * n_free, 6 * n_free)), np.zeros(6 * n_free)
    coupling = np.zeros((len(sights.frame), 6, 3))
    inner, inner_right = np.zeros((len(corners.nearness), 3, 3)), np.zeros((len(corners.nearness), 3))
    rotation, place = _cameras(poses, mount)
    row, by_pose, by_corner = np.empty(3), np.empty((2, 6)), np.empty((2, 3))
    error = np.empty(2)
    for j in range(len(corners.nearness)):
        basis = _tangents(corners.direction[j])
        inner[j, 2, 2] = _ANY
        for i in range(sights.start[j], sights.start[j + 1]):
            k = sights.frame[i]
            weight = _derivatives(
                poses.place[k], rotation[k], place[k], sights, corners, j, i, basis, row, error, by_pose, by_corner,
            )  # fmt: skip
            if weight == 0.0:
                continue
            _add_corner(inner[j], inner_right[j], weight, error, by_corner)
            if k >= poses.n_held:
                at = 6 * (k - poses.n_held)
                _add_pose(of_poses, right, coupling[i], at, weight, error, by_pose, by_corner)
    for n in range(n_free):
        _add_link(of_poses, right, poses, links, n, slip)
    return of_poses, right, coupling, inner, inner_right


@njit(cache=True)
def _tangents(direction: FloatArray) -> FloatArray:
    """Return two unit vectors (2, 3) across a unit direction (Duff et al., "Building an Orthonormal Basis, Revisited", 2017)."""
    x, y, z = direction
    sign = 1.0 if z >= 0.0 else -1.0
    a = -1.0 / (sign + z)
    b = x * y * a
    basis = np.empty((2, 3))
    basis[0, 0], basis[0, 1], basis[0, 2] = 1.0 + sign * x * x * a, sign * b, -sign * x
    basis[1, 0], basis[1, 1], basis[1, 2] = b, sign + y * y * a, -y
    return basis


@njit(cache=True)
def _derivatives(
    body: FloatArray,
    rotation: FloatArray,
    place: FloatArray,
    sights: Sights,
    corners: Corners,
    j: int,
    i: int,
    basis: FloatArray,
    row: FloatArray,
    error: FloatArray,
    by_pose: FloatArray,
    by_corner: FloatArray,
) -> float:
    """Fill in error (2,) and derivatives by pose (2, 6) and by corner (2, 3); return the weight of Geman and McClure's loss.

    With g a row of the projection's derivative in the window's frame, dh/dφ gives g × (m + ρ (o − t)), dh/dτ gives −ρ g.
    """
    near, origin = corners.nearness[j], corners.origin
    d0, d1, d2 = _toward(corners, j, place)
    x, y, z = turned_back(rotation, d0, d1, d2)
    if z <= _LEAST_AHEAD:
        return 0.0
    q0, q1, q2 = _toward(corners, j, body)
    scale = sights.weight[i]
    error[0] = scale * (sights.plane[i, 0] - x / z)
    error[1] = scale * (sights.plane[i, 1] - y / z)
    for a in range(2):
        slope = (x if a == 0 else y) / z
        for b in range(3):
            row[b] = scale / z * (rotation[b, a] - slope * rotation[b, 2])
        by_pose[a, 0] = row[1] * q2 - row[2] * q1
        by_pose[a, 1] = row[2] * q0 - row[0] * q2
        by_pose[a, 2] = row[0] * q1 - row[1] * q0
        by_corner[a, 0] = by_corner[a, 1] = by_corner[a, 2] = 0.0
        for b in range(3):
            by_pose[a, 3 + b] = -near * row[b]
            by_corner[a, 0] += row[b] * basis[0, b]
            by_corner[a, 1] += row[b] * basis[1, b]
            by_corner[a, 2] += row[b] * (origin[b] - place[b])
    weight: float = 1.0 / (1.0 + (error[0] ** 2 + error[1] ** 2) / _OUTLYING**2) ** 2
    return weight


@njit(cache=True)
def _add_corner(
    inner: FloatArray, right: FloatArray, weight: float, error: FloatArray, by_corner: FloatArray
) -> None:
    for a in range(3):
        right[a] += weight * (by_corner[0, a] * error[0] + by_corner[1, a] * error[1])
        for b in range(3):
            inner[a, b] += weight * (by_corner[0, a] * by_corner[0, b] + by_corner[1, a] * by_corner[1, b])


@njit(cache=True)
def _add_pose(
    of_poses: FloatArray,
    right: FloatArray,
    coupling: FloatArray,
    at: int,
    weight: float,
    error: FloatArray,
    by_pose: FloatArray,
    by_corner: FloatArray,
) -> None:
    for a in range(6):
        first, second = weight * by_pose[0, a], weight * by_pose[1, a]
        right[at + a] += first * error[0] + second * error[1]
        for b in range(6):
            of_poses[at + a, at + b] += first * by_pose[0, b] + second * by_pose[1, b]
        for b in range(3):
            coupling[a, b] = first * by_corner[0, b] + second * by_corner[1, b]


@njit(cache=True)
def _hold_at_infinity(
    sights: Sights, j: int, inner: FloatArray, right: FloatArray, coupling: FloatArray
) -> None:
    """Hold a corner at infinity where the observations would put it beyond."""
    inverse = _inverse(inner[j], 0.0)
    if inverse[2, 0] * right[j, 0] + inverse[2, 1] * right[j, 1] + inverse[2, 2] * right[j, 2] >= 0.0:
        return
    for a in range(2):
        inner[j, a, 2] = inner[j, 2, a] = 0.0
    inner[j, 2, 2], right[j, 2] = 1.0, 0.0
    for i in range(sights.start[j], sights.start[j + 1]):
        for a in range(6):
            coupling[i, a, 2] = 0.0


@njit(cache=True)
def _add_link(
    of_poses: FloatArray, right: FloatArray, poses: WindowPoses, links: MotionLinks, n: int, slip: float
) -> None:
    """Add the errors of one motion, with Cauchy's loss along and aside."""
    k = poses.n_held + n
    error = _link_errors(poses, links, n)
    now, before, place = poses.rotation[k], poses.rotation[k - 1], poses.place
    ahead = product(before, links.ahead[n])
    v0, v1, v2 = place[k, 0] - place[k - 1, 0], place[k, 1] - place[k - 1, 1], place[k, 2] - place[k - 1, 2]
    jacobian = np.zeros((6, 12))  # by the pose before and this one
    for a in range(3):
        for b in range(3):
            jacobian[a, 6 + b] = now[b, a] / links.sigma[n, 0]
            jacobian[a, b] = -jacobian[a, 6 + b]
            jacobian[3 + a, 9 + b] = ahead[b, a] / links.sigma[n, 1 if a == 0 else 2]
            jacobian[3 + a, 3 + b] = -jacobian[3 + a, 9 + b]
        g0, g1, g2 = jacobian[3 + a, 9], jacobian[3 + a, 10], jacobian[3 + a, 11]
        jacobian[3 + a, 0], jacobian[3 + a, 1], jacobian[3 + a, 2] = (
            g1 * v2 - g2 * v1, g2 * v0 - g0 * v2, g0 * v1 - g1 * v0,
        )  # fmt: skip
    along = 1.0 / (1.0 + error[3] ** 2 / slip**2)
    aside = 1.0 / (1.0 + (error[4] ** 2 + error[5] ** 2) / slip**2)
    at = 6 * (n - 1)
    for row in range(6):
        weight = 1.0 if row < 3 else along if row == 3 else aside
        for a in range(0 if n else 6, 12):  # the pose before the first free one is held
            right[at + a] -= weight * jacobian[row, a] * error[row]
            for b in range(0 if n else 6, 12):
                of_poses[at + a, at + b] += weight * jacobian[row, a] * jacobian[row, b]


@njit(cache=True)
def _step(
    of_poses: FloatArray,
    right: FloatArray,
    coupling: FloatArray,
    inner: FloatArray,
    inner_right: FloatArray,
    sights: Sights,
    n_held: int,
    damping: float,
) -> tuple[FloatArray, FloatArray]:
    """Return the step of the poses (6F,) and of the corners (J, 3)."""
    reduced, pull = of_poses.copy(), right.copy()
    inverse, gain = np.empty_like(inner), np.empty((6, 3))
    for j in range(len(inner)):
        _put(_inverse(inner[j], damping), inverse[j])
        for i in range(sights.start[j], sights.start[j + 1]):
            at = 6 * (sights.frame[i] - n_held)
            if at < 0:
                continue
            for a in range(6):
                for b in range(3):
                    gain[a, b] = (
                        coupling[i, a, 0] * inverse[j, 0, b]
                        + coupling[i, a, 1] * inverse[j, 1, b]
                        + coupling[i, a, 2] * inverse[j, 2, b]
                    )
                for b in range(3):
                    pull[at + a] -= gain[a, b] * inner_right[j, b]
            for other in range(sights.start[j], i + 1):
                to = 6 * (sights.frame[other] - n_held)
                if to >= 0:
                    _subtract(reduced, at, to, gain, coupling[other])
    for a in range(len(pull)):
        reduced[a, a] += damping * of_poses[a, a]
    solve_symmetric(reduced, pull)
    return pull, _corner_steps(pull, coupling, inverse, inner_right, sights, n_held)


@njit(cache=True)
def solve_symmetric(matrix: FloatArray, right: FloatArray) -> None:
    """Solve symmetric equations in place by the factorization L D Lᵀ of the lower triangle."""
    n = len(right)
    for a in range(n):
        for b in range(a):
            share = matrix[a, b]
            for c in range(b):
                share -= matrix[a, c] * matrix[b, c] * matrix[c, c]
            matrix[a, b] = share / matrix[b, b]
            matrix[a, a] -= matrix[a, b] ** 2 * matrix[b, b]
            right[a] -= matrix[a, b] * right[b]
    for a in range(n - 1, -1, -1):
        right[a] /= matrix[a, a]
        for b in range(a + 1, n):
            right[a] -= matrix[b, a] * right[b]


@njit(cache=True)
def _subtract(reduced: FloatArray, at: int, to: int, gain: FloatArray, coupling: FloatArray) -> None:
    """Subtract a block of the Schur complement, on and below the diagonal."""
    for a in range(6):
        for b in range(6):
            reduced[at + a, to + b] -= (
                gain[a, 0] * coupling[b, 0] + gain[a, 1] * coupling[b, 1] + gain[a, 2] * coupling[b, 2]
            )


@njit(cache=True)
def _inverse(matrix: FloatArray, damping: float) -> FloatArray:
    """Return the inverse of a symmetric matrix (3, 3) with a damped diagonal."""
    more = 1.0 + damping
    a, b, c = matrix[0, 0] * more + 1e-9, matrix[0, 1], matrix[0, 2]
    d, e, f = matrix[1, 1] * more + 1e-9, matrix[1, 2], matrix[2, 2] * more
    p, q, r = d * f - e * e, c * e - b * f, b * e - c * d
    over = 1.0 / (a * p + b * q + c * r)
    inverse = np.empty((3, 3))
    inverse[0, 0], inverse[0, 1], inverse[0, 2] = over * p, over * q, over * r
    inverse[1, 0], inverse[1, 1], inverse[1, 2] = over * q, over * (a * f - c * c), over * (b * c - a * e)
    inverse[2, 0], inverse[2, 1], inverse[2, 2] = over * r, inverse[1, 2], over * (a * d - b * b)
    return inverse


@njit(cache=True)
def _corner_steps(
    step: FloatArray,
    coupling: FloatArray,
    inverse: FloatArray,
    inner_right: FloatArray,
    sights: Sights,
    n_held: int,
) -> FloatArray:
    """Return the steps of the corners (J, 3) that belong to a step of the poses."""
    shift = inner_right.copy()
    for j in range(len(inverse)):
        for i in range(sights.start[j], sights.start[j + 1]):
            at = 6 * (sights.frame[i] - n_held)
            if at >= 0:
                for a in range(6):
                    for b in range(3):
                        shift[j, b] -= coupling[i, a, b] * step[at + a]
        x, y, z = rotated(inverse[j], shift[j, 0], shift[j, 1], shift[j, 2])
        shift[j, 0], shift[j, 1], shift[j, 2] = x, y, z
    return shift


@njit(cache=True)
def _moved_poses(poses: WindowPoses, step: FloatArray) -> WindowPoses:
    rotation, place = poses.rotation.copy(), poses.place.copy()
    for k in range(poses.n_held, len(place)):
        at = 6 * (k - poses.n_held)
        turned = product(exp_rotation(step[at], step[at + 1], step[at + 2]), rotation[k])
        _put(turned, rotation[k])
        for a in range(3):
            place[k, a] += step[at + 3 + a]
    return WindowPoses(rotation, place, poses.n_held)


@njit(cache=True)
def _moved_corners(corners: Corners, shift: FloatArray) -> Corners:
    direction, nearness = corners.direction.copy(), corners.nearness.copy()
    for j in range(len(nearness)):
        basis = _tangents(direction[j])
        for a in range(3):
            direction[j, a] += shift[j, 0] * basis[0, a] + shift[j, 1] * basis[1, a]
        _set_direction(direction, j, direction[j, 0], direction[j, 1], direction[j, 2])
        nearness[j] = min(max(nearness[j] + shift[j, 2], 0.0), _MOST_NEARNESS)
    return Corners(direction, nearness, corners.origin)


@njit(cache=True)
def _nearness_sigma(inner: FloatArray) -> FloatArray:
    """Return the standard deviations (J,) of the inverse distances, as if the poses were known [1/m]."""
    sigma = np.empty(len(inner))
    for j in range(len(inner)):
        sigma[j] = np.sqrt(max(_inverse(inner[j], 0.0)[2, 2], 0.0))
    return sigma
