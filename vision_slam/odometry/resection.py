"""Pose of one image from known points: camera resection, and view recognition after a loss of vision.

`resect` refines a predicted pose by Gauss-Newton with Geman-McClure weights. `PixelNoise` measures the error of tracked
corners by its residuals. `ViewRecognizer` matches SIFT features of the last views and solves perspective-n-point by RANSAC;
it needs a camera that still looks at ground it saw before.
"""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from numba import njit

from survey import Camera
from survey.core import BoolArray, FloatArray, IntArray
from survey.data.frames import Image
from vision_slam.config import VisualOdometryConfig
from vision_slam.motion import GAP_S, RelativeMotion
from vision_slam.odometry.window_adjustment import (
    exp_rotation,
    log_rotation,
    product,
    rotated,
    solve_symmetric,
    turned_back,
)

_N_RESECTIONS = 10
_LEAST_DISTANCE = 1e-9


def resect(
    predicted: FloatArray,
    points: FloatArray,
    rays: FloatArray,
    *,
    angle_sigma: FloatArray | float,
    turn_sigma: float,
    shift_sigma: float,
) -> tuple[FloatArray, FloatArray]:
    r"""Find the camera's pose from rays to known points, near a predicted pose.

    Minimizes Σ ρ(|u × û(T)|² / σ²) plus the prediction's own term by Gauss-Newton with
    Geman-McClure weights w = (1 + e²/c²)⁻²; u are the measured unit rays and û those that
    the pose gives. Points at infinity move with the rotation only.

    `predicted` (4, 4): camera to world. `points` (N, 4): homogeneous coordinates in the world; the last is 0 for
    directions. `rays` (N, 3): unit, camera frame. `angle_sigma` (N,) or one for all: error of a ray
    [rad]. `turn_sigma`, `shift_sigma`: error of the prediction [rad], [m]. Returns `pose` (4, 4): camera to
    world. `errors` (N,): angle between measured and expected ray [rad].
    """
    sigma = np.broadcast_to(np.asarray(angle_sigma, dtype=np.float64), len(rays)).copy()
    pose = predicted.copy()
    pose[:3, :3], pose[:3, 3] = _resected(
        *_parted(predicted), points, rays, sigma, turn_sigma**-2, shift_sigma**-2
    )
    expected, _ = _expected_rays(pose[:3, :3], pose[:3, 3], points)
    return pose, np.linalg.norm(rays - expected, axis=1)


def _parted(pose: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return rotation and place of a pose, contiguous for compiled loops."""
    return np.ascontiguousarray(pose[:3, :3]), np.ascontiguousarray(pose[:3, 3])


@njit(cache=True)
def _resected(  # noqa: PLR0917 - compiled functions take no keywords
    rotation: FloatArray,
    place: FloatArray,
    points: FloatArray,
    rays: FloatArray,
    sigma: FloatArray,
    turn_information: float,
    shift_information: float,
) -> tuple[FloatArray, FloatArray]:
    """Return rotation and place of `resect`; the information is that of the prediction [1/rad², 1/m²]."""
    base_turn, base_place = rotation, place
    for iteration in range(_N_RESECTIONS):
        # From a wide basin to a narrow one, so that a bad prediction does not reject good points.
        normal, right = _sums(rotation, place, points, rays, sigma, max(3.0, 24.0 * 0.6**iteration))
        turn = log_rotation(product(base_turn.T, rotation))
        shift = turned_back(
            rotation, place[0] - base_place[0], place[1] - base_place[1], place[2] - base_place[2]
        )
        for a in range(3):
            normal[a, a] += turn_information
            right[a] -= turn[a] * turn_information
            normal[3 + a, 3 + a] += shift_information
            right[3 + a] -= shift[a] * shift_information
        solve_symmetric(normal, right)
        x, y, z = rotated(rotation, right[3], right[4], right[5])
        place = np.array([place[0] + x, place[1] + y, place[2] + z])
        rotation = product(rotation, exp_rotation(right[0], right[1], right[2]))
        if iteration > 5 and np.abs(right).max() < 1e-6:
            break
    return rotation, place


@njit(cache=True)
def _sums(  # noqa: PLR0917
    rotation: FloatArray,
    place: FloatArray,
    points: FloatArray,
    rays: FloatArray,
    sigma: FloatArray,
    width: float,
) -> tuple[FloatArray, FloatArray]:
    """Return the normal equations (6, 6), (6,) of turn and shift, with weights of so many standard deviations of width.

    The expected unit ray û changes by û × dθ and by -w (I - û ûᵀ) dt / distance, along the axes of the camera.
    """
    normal, right, jacobian = np.zeros((6, 6)), np.zeros(6), np.zeros((3, 6))
    for n in range(len(rays)):
        near = points[n, 3]
        seen = turned_back(
            rotation,
            points[n, 0] - near * place[0],
            points[n, 1] - near * place[1],
            points[n, 2] - near * place[2],
        )
        distance = max(np.sqrt(seen[0] ** 2 + seen[1] ** 2 + seen[2] ** 2), _LEAST_DISTANCE)
        u, v, w = seen[0] / distance, seen[1] / distance, seen[2] / distance
        off = rays[n, 0] - u, rays[n, 1] - v, rays[n, 2] - w
        square = (off[0] ** 2 + off[1] ** 2 + off[2] ** 2) / sigma[n] ** 2
        weight = 1.0 / ((1.0 + square / width**2) * sigma[n]) ** 2
        share = near / distance
        jacobian[0, 1], jacobian[0, 2], jacobian[1, 2] = -w, v, -u
        jacobian[1, 0], jacobian[2, 0], jacobian[2, 1] = w, -v, u
        jacobian[0, 3], jacobian[0, 4], jacobian[0, 5] = share * (u * u - 1.0), share * u * v, share * u * w
        jacobian[1, 3], jacobian[1, 4], jacobian[1, 5] = share * u * v, share * (v * v - 1.0), share * v * w
        jacobian[2, 3], jacobian[2, 4], jacobian[2, 5] = share * u * w, share * v * w, share * (w * w - 1.0)
        for a in range(6):
            right[a] += weight * (jacobian[0, a] * off[0] + jacobian[1, a] * off[1] + jacobian[2, a] * off[2])
            for b in range(a + 1):
                normal[a, b] += weight * (
                    jacobian[0, a] * jacobian[0, b]
                    + jacobian[1, a] * jacobian[1, b]
                    + jacobian[2, a] * jacobian[2, b]
                )
    return normal, right


def resection_information(pose: FloatArray, points: FloatArray, angle_sigma: float) -> FloatArray:
    """Return the information (6, 6) of rays to known points about rotation and shift in the camera frame.

    Points and errors are those of `resect`; its prediction is not in it.
    """
    jacobian = _ray_jacobian(*_expected_rays(pose[:3, :3], pose[:3, 3], points), points[:, 3])
    information: FloatArray = np.einsum("nki,nkj->ij", jacobian, jacobian) / angle_sigma**2
    return information


def _ray_jacobian(expected: FloatArray, distance: FloatArray, nearness: FloatArray) -> FloatArray:
    """Return how û changes (N, 3, 6): by û × dθ with the turn, by -w (I - û ûᵀ) Rᵀ dt / distance with the shift."""
    jacobian = np.zeros((len(expected), 3, 6))
    jacobian[:, :, :3] = _skew(expected)
    across = np.eye(3) - expected[:, :, None] * expected[:, None, :]
    jacobian[:, :, 3:] = -across * (nearness / distance)[:, None, None]
    return jacobian


def _expected_rays(
    rotation: FloatArray, place: FloatArray, points: FloatArray
) -> tuple[FloatArray, FloatArray]:
    seen = (points[:, :3] - points[:, 3:] * place) @ rotation
    distance = np.maximum(np.linalg.norm(seen, axis=1), _LEAST_DISTANCE)
    return seen / distance[:, None], distance


def _skew(vectors: FloatArray) -> FloatArray:
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)


_RAYLEIGH_MEDIAN = float(np.sqrt(2.0 * np.log(2.0)))  # of the length of two errors of unit variance
_MEMORY = 50  # images


class PixelNoise:
    r"""Running standard deviation of the pixel error of followed corners, per coordinate.

    The residuals of corners about the best pose have the length of two Gaussian errors, whose median
    is :math:`σ \sqrt{2 \ln 2}`. They hold what blur, noise and compression add to the error of tracking;
    the difference between tracking forward and backward does not: on a street it is a seventh of the residuals.
    Of a lens that nothing states they would hold its distortion, so that they are not measured then.
    The assumed error is the least, since residuals leave out what neighbouring corners have in common.

    `assumed_px`: error of images of good quality [pixels].

    >>> noise = PixelNoise(0.5)
    >>> for _ in range(200):
    ...     noise.update(np.full(9, 2.0))
    >>> round(noise.sigma_px, 2)
    1.68
    """

    def __init__(self, assumed_px: float) -> None:
        self._assumed_px = self._mean_px = assumed_px

    @property
    def sigma_px(self) -> float:
        """The measured error, or the assumed one where that is larger [pixels]."""
        return max(self._assumed_px, self._mean_px)

    def update(self, residual_px: FloatArray) -> None:
        """Add the residuals (N,) of one image [pixels]."""
        if len(residual_px):
            measured_px = float(np.median(residual_px)) / _RAYLEIGH_MEDIAN
            self._mean_px += (measured_px - self._mean_px) / _MEMORY


_N_VIEWS, _SPACING_M = 8, 0.15
_EARLIER = (2, 4, 7)  # views before the newest that its features are triangulated with
_N_FEATURES = 1500
_RATIO = 0.8
_LEVEL = -0.04  # sine of elevation above which a feature may be a mountain
_PARALLAX_PX, _EPIPOLAR_PX, _GATE_PX = 3.0, 2.0, 3.0
_LEAST_RAY_Z = 0.2
_LEAST_AGREE, _MOST_SIGMA_M = 15, 0.1
# Over a metre or two, most in a turn, a map is as large as the wheels have it; what is level beyond is not quite straight.
_MAP_SCALE, _MAP_TURN_RAD = 0.04, np.radians(0.02)
_N_DRAWS, _SURE = 1000, 0.9999
_BRIDGED, _STILL_M = 0.05, 0.005
_ASIDE_M = 0.5
_MOST_TRIES = 20
_TURN_RAD = np.radians(1.0)
_ANY_RAD, _ANY_M = 1.0, 10.0

Descriptors = npt.NDArray[np.float32]


@dataclass(frozen=True)
class Recognition:
    """Pose (4, 4) of the body relative to a recognized view.

    ``covariance`` (6, 6) is of its turn [rad] and shift [m], in the axes of the body;
    ``n_agree`` features of near ground are where it puts them.
    """

    pose: FloatArray
    covariance: FloatArray
    n_agree: int


@dataclass(frozen=True)
class _Features:
    rays: FloatArray
    descriptors: Descriptors


@dataclass(frozen=True)
class _Map:
    """Points (N, 3), or unit directions where `is_far`, with descriptors."""

    points: FloatArray
    is_far: BoolArray
    descriptors: Descriptors


class ViewRecognizer:
    r"""Recognition of the newest views after a loss of vision.

    After a white-out, an occlusion or a lift no corner can be tracked. The next clear image is
    matched with the last view before. Features of that view that earlier views also contain are
    triangulated: with r_i their unit rays from the camera positions c_i, the point nearest to all
    of them is

    .. math:: x = (Σ_i P_i)^{-1} Σ_i P_i c_i, \quad P_i = I − r_i r_iᵀ,

    or a direction, if they lie near the horizon without parallax. RANSAC over triples of near
    matches gives a pose, which is refined with all inliers and fused with wheels and gyro. Wheels
    that contradict it by more than three standard deviations have slipped and are not used; if the
    gyro contradicts it, the match is rejected.

    Views of snow from 0.7 m match over 1.5 m of travel, at times 2 m. Longer gaps are bridged
    by wheels and gyro, and by `vision_slam.places.relocalization` after the drive. The images of
    8 keyframes are stored; after a loss of vision 20 clear images are tried.

    `camera`: calibration and mounting. `config`: errors of pixels and gyro.
    """

    def __init__(self, camera: Camera, config: VisualOdometryConfig) -> None:
        self._camera, self._config = camera, config
        self._focal_px = 0.5 * (camera.matrix[0, 0] + camera.matrix[1, 1])
        self._views: list[tuple[int, Image]] = []
        self._map: _Map | None = None
        self._way_m = self._seconds = self._bias_rad = 0.0
        self._had_gap = False
        self._n_tries = 0

    def add_view(self, keyframe: int, image: Image, poses: list[FloatArray]) -> None:
        """Add the enhanced image of a keyframe with a good pose, and reset the search."""
        kept = [k for k, _ in self._views]
        if len(kept) > 1 and np.linalg.norm(poses[kept[-1]][:3, 3] - poses[kept[-2]][:3, 3]) < _SPACING_M:
            self._views.pop()  # turned on the spot, it triangulates nothing
        self._views = [*self._views, (keyframe, image)][-_N_VIEWS:]
        self._map = None
        self._way_m = self._seconds = self._bias_rad = 0.0
        self._had_gap = False
        self._n_tries = 0

    def add_motion(self, motion: RelativeMotion) -> None:
        """Add a motion since the newest view; over a gap of the instruments it is unknown."""
        self._way_m += abs(motion.travel_m or 0.0)
        self._seconds += motion.seconds
        self._bias_rad += motion.bias_sigma_rad_s * motion.seconds
        self._had_gap |= motion.seconds > GAP_S or motion.travel_m is None or motion.rotation is None

    def recognize(self, image: Image, predicted: FloatArray, poses: list[FloatArray]) -> Recognition | None:
        """Estimate the pose of the body at an enhanced image near the newest view; None if the match is weak.

        `image` (H, W): the image after the loss of vision. `predicted` (4, 4): pose of the body by wheels and
        gyro.
        """
        self._n_tries += 1
        if len(self._views) < 2 or self._n_tries > _MOST_TRIES:
            return None
        self._map = self._map or self._mapped(poses)
        features = self._features(image)
        one, other = _matched_features(self._map.descriptors, features.descriptors)
        points, is_far, rays = self._map.points[one], self._map.is_far[one], features.rays[other]
        newest = poses[self._views[-1][0]]
        first = self._drawn(points[~is_far], rays[~is_far], newest)
        if first is None:
            return None
        camera, covariance, n_agree = self._fitted(first, points, is_far, rays, newest)
        fused = self._fused(camera, covariance, predicted, newest)
        if n_agree < _LEAST_AGREE or fused is None or _sigma_m(fused[1]) > _MOST_SIGMA_M:
            return None
        mount = self._camera.T_body_camera
        moves = np.zeros((6, 6))  # how turn and shift of the camera turn and shift the body
        moves[:3, :3] = moves[3:, 3:] = mount[:3, :3]
        moves[3:, :3] = _skew(mount[None, :3, 3])[0] @ mount[:3, :3]
        return Recognition(fused[0] @ np.linalg.inv(mount), moves @ fused[1] @ moves.T, n_agree)

    def _features(self, image: Image) -> _Features:
        finder: Any = cv2.SIFT.create(_N_FEATURES)
        keys, found = finder.detectAndCompute(image, None)
        if not keys:
            return _Features(np.zeros((0, 3)), np.zeros((0, 128), np.float32))
        rays = self._camera.rays(np.array([key.pt for key in keys]))
        rooted = np.sqrt(found / np.maximum(found.sum(axis=1, keepdims=True), 1e-9)).astype(np.float32)
        seen = rays[:, 2] > _LEAST_RAY_Z
        return _Features(rays[seen], rooted[seen])

    def _mapped(self, poses: list[FloatArray]) -> _Map:
        """Triangulate the features of the newest view."""
        newest, image = self._views[-1]
        features, eye = self._features(image), poses[newest] @ self._camera.T_body_camera
        rays = features.rays @ eye[:3, :3].T
        normal = _across(rays)
        right = normal @ eye[:3, 3]
        was_seen, parallax = np.zeros(len(rays), dtype=bool), np.zeros(len(rays))
        for back in _EARLIER:
            if back >= len(self._views):
                continue
            keyframe, image = self._views[-1 - back]
            other = poses[keyframe] @ self._camera.T_body_camera
            index, seen = self._seen_from(other, self._features(image), features, rays, eye[:3, 3])
            across = _across(seen)
            normal[index] += across
            right[index] += across @ other[:3, 3]
            was_seen[index] = True
            turned = np.linalg.norm(np.cross(rays[index], seen), axis=1)
            parallax[index] = np.maximum(parallax[index], turned)
        is_far = was_seen & (rays[:, 2] > _LEVEL) & (parallax < _PARALLAX_PX / self._focal_px)
        is_near = was_seen & (rays[:, 2] <= _LEVEL) & (parallax > _PARALLAX_PX / self._focal_px)
        points = rays.copy()
        points[is_near] = np.linalg.solve(normal[is_near], right[is_near][:, :, None])[:, :, 0]
        is_near &= ((points - eye[:3, 3]) * rays).sum(axis=1) > 0.0
        kept = is_near | is_far
        return _Map(points[kept], is_far[kept], features.descriptors[kept])

    def _seen_from(
        self, other: FloatArray, there: _Features, here: _Features, rays: FloatArray, place: FloatArray
    ) -> tuple[IntArray, FloatArray]:
        """Return which features an earlier camera saw too, where the epipolar line has them, and its rays."""
        one, two = _matched_features(here.descriptors, there.descriptors)
        seen = there.rays[two] @ other[:3, :3].T
        plane = np.cross(rays[one], other[:3, 3] - place)
        off = np.abs((seen * plane).sum(axis=1)) / np.maximum(np.linalg.norm(plane, axis=1), 1e-9)
        on_line = off < _EPIPOLAR_PX / self._focal_px
        return one[on_line], seen[on_line]

    def _drawn(self, points: FloatArray, rays: FloatArray, newest: FloatArray) -> FloatArray | None:
        """Return the camera's pose that most of some near points agree with."""
        if len(points) < _LEAST_AGREE:
            return None
        origin = newest[:3, 3]  # metres from here, so that large coordinates cost no digits
        plane = np.ascontiguousarray(rays[:, :2] / rays[:, 2:])
        cv2.setRNGSeed(0)  # RANSAC draws; the same images shall give the same bytes
        found, turn, shift, _ = cv2.solvePnPRansac(
            np.ascontiguousarray(points - origin), plane, np.eye(3), None, iterationsCount=_N_DRAWS,
            reprojectionError=_GATE_PX / self._focal_px, confidence=_SURE, flags=cv2.SOLVEPNP_AP3P,
        )  # fmt: skip
        if not found:
            return None
        pose = np.eye(4)
        pose[:3, :3] = cv2.Rodrigues(turn)[0].T
        pose[:3, 3] = origin - pose[:3, :3] @ shift.ravel()
        return pose

    def _fitted(
        self, first: FloatArray, points: FloatArray, is_far: BoolArray, rays: FloatArray, newest: FloatArray
    ) -> tuple[FloatArray, FloatArray, int]:
        """Fit the camera's pose to all that agrees; return it, its covariance (6, 6), and how many near ones do."""
        pixel = 1.0 / self._focal_px
        homogeneous = np.column_stack([points, ~is_far])
        camera, errors = resect(
            first, homogeneous, rays,
            angle_sigma=self._config.pixel_sigma * pixel, turn_sigma=_ANY_RAD, shift_sigma=_ANY_M,
        )  # fmt: skip
        agree = errors < _GATE_PX * pixel
        n_agree = int((agree & ~is_far).sum())
        if n_agree < _LEAST_AGREE:
            return camera, np.eye(6), n_agree
        spread = float(np.sqrt(0.5 * np.mean(errors[agree] ** 2)))
        angle_sigma = self._config.landmark_pixel_factor * max(self._config.pixel_sigma * pixel, spread)
        information = resection_information(camera, homogeneous[agree], angle_sigma)
        covariance = np.asarray(np.linalg.inv(information), dtype=np.float64)
        moved_m = float(np.linalg.norm(camera[:3, 3] - (newest @ self._camera.T_body_camera)[:3, 3]))
        covariance += np.diag(np.repeat([_MAP_TURN_RAD, _MAP_SCALE * moved_m], 3) ** 2)
        return camera, covariance, n_agree

    def _fused(
        self, camera: FloatArray, covariance: FloatArray, predicted: FloatArray, newest: FloatArray
    ) -> tuple[FloatArray, FloatArray] | None:
        """Weigh a camera's pose with the prediction's, each by its errors; None where they exclude each other."""
        gyro_rad = np.radians(self._config.gyro_sigma_deg) * self._seconds**0.5
        turn_sigma = float(np.linalg.norm([_MAP_TURN_RAD, gyro_rad, self._bias_rad]))
        shift_sigma = _BRIDGED * self._way_m + _STILL_M
        off = np.linalg.inv(camera) @ predicted @ self._camera.T_body_camera
        moved_m = np.linalg.norm((camera - newest @ self._camera.T_body_camera)[:3, 3])
        away = np.r_[cv2.Rodrigues(off[:3, :3])[0].ravel(), off[:3, 3]]
        if self._had_gap:
            turn_sigma, shift_sigma = _ANY_RAD, _ANY_M
        elif np.linalg.norm(away[:3]) > _TURN_RAD + 3.0 * turn_sigma or moved_m > _ASIDE_M + self._way_m:
            return None
        elif np.linalg.norm(away[3:]) > 3.0 * np.hypot(shift_sigma, _sigma_m(covariance)):
            shift_sigma = _ANY_M  # the wheels have slipped
        prior = np.diag(np.repeat([turn_sigma, shift_sigma], 3) ** 2)
        gain = covariance @ np.linalg.inv(covariance + prior)
        weighed = gain @ away
        fused = camera.copy()
        fused[:3, 3] += camera[:3, :3] @ weighed[3:]
        fused[:3, :3] = camera[:3, :3] @ cv2.Rodrigues(weighed[:3])[0]
        return fused, (np.eye(6) - gain) @ covariance


def _matched_features(one: Descriptors, other: Descriptors) -> tuple[IntArray, IntArray]:
    """Return indices (M,) into both of mutual nearest neighbours that pass the ratio test."""
    nothing = np.zeros(0, dtype=np.int64)
    if min(len(one), len(other)) < 2:
        return nothing, nothing
    likeness = one @ other.T  # root-SIFT is of unit length, so that d² = 2 - 2 u·v
    best, rows = likeness.argmax(axis=1), np.arange(len(one))
    is_mutual = likeness.argmax(axis=0)[best] == rows
    top = likeness[rows, best]
    likeness[rows, best] = -1.0
    clear = (1.0 - top) < _RATIO**2 * (1.0 - likeness.max(axis=1))
    kept = np.flatnonzero(is_mutual & clear)
    return kept, best[kept]


def _across(rays: FloatArray) -> FloatArray:
    """Return the projections (N, 3, 3) on the planes across unit rays."""
    across: FloatArray = np.eye(3) - rays[:, :, None] * rays[:, None, :]
    return across


def _sigma_m(covariance: FloatArray) -> float:
    """Return the largest standard deviation of the shift."""
    return float(np.sqrt(np.linalg.eigvalsh(covariance[3:, 3:])[-1]))
