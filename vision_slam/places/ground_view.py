"""Top-down ground mosaics, their features, and the alignment of two views.

`GroundMosaics` projects images of the last metres onto a quadratic ground surface through the landmarks, weighted by 1/range³, and
describes the mosaic by SIFT features, which do not depend on the heading. `match_overlay` aligns two views by rotation and
shift: two matches of equal distance give a guess, and the guess with the most inliers is refined by least squares.
"""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from survey import Camera
from survey.core import BoolArray, FloatArray, IntArray
from survey.data.frames import Frames, Image
from survey.data.sensors.odometry import Odometry, Sightings
from vision_slam.attitude import rotations
from vision_slam.odometry.tracks import grey_of

_STEP_M = 0.025  # side of a pixel of a mosaic
_HALF_M = 3.0  # of a mosaic's side
# Nearer lies the rover's own shadow, farther a bump hides what is behind it.
_NEAREST_M, _FARTHEST_M = 0.75, 2.3
_FRAME_SPACING_M = 0.35  # of travel, between the images that a mosaic is made of
_BEHIND_M = _HALF_M + _FARTHEST_M
_SURFACE_M = 3.5
_LEAST_LANDMARKS = 12
_RELIEF_M = 0.03  # height of the landmarks above and below the surface that is fitted to them
_LEAST_WEIGHT = 0.02
_N_FEATURES = 800
# Brightness that changes over more than the first width is that of light and slopes; the contrast is made even over the second.
_WIDE_M, _CONTRAST_M = 0.5, 0.7

ViewDescriptors = npt.NDArray[np.float32]


@dataclass(frozen=True)
class GroundView:
    """Features of the ground around a pose.

    ``xyz`` (N, 3) [m] in the level frame of the pose: origin at the body, x along its heading,
    z up; ``descriptors`` (N, 128) of unit length, the same whatever the heading.
    """

    pose: int
    xyz: FloatArray
    descriptors: ViewDescriptors


class GroundMosaics:
    r"""Top-down mosaics of images on the ground surface of the landmarks.

    Seen from 0.7 m above it, snow looks different from every side: near ground is sharp
    across and blurred along the line of sight. Each cell of the view is therefore the mean
    of all images of the last metres that saw it from near, weighted with 1/range³: what
    one image blurs, the others have sharp. The ground is the surface

    .. math:: z(x, y) = c_0 + c_1 x + c_2 y + c_3 x^2 + c_4 x y + c_5 y^2

    through the landmarks within 3.5 m, by least squares that prefer a plane.

    `frames`: images; a pose without one of its time has seen nothing. `camera`: that took them. `path` (N,
    3): reckoned places of the poses [m]; only what lies within some metres of travel counts. `odometry`:
    their attitudes. `sightings`: landmarks.
    """

    def __init__(
        self, frames: Frames, camera: Camera, path: FloatArray, odometry: Odometry, sightings: Sightings
    ) -> None:
        self._frames, self._camera, self._path = frames, camera, path
        nearest = np.searchsorted(frames.time_s, odometry.time_s - 1e-6).clip(max=len(frames) - 1)
        self._image_of: IntArray = nearest
        self._has_image: BoolArray = np.abs(frames.time_s[nearest] - odometry.time_s) < 1e-6
        self._turn = rotations(odometry.attitude_rad)
        self._yaw = odometry.attitude_rad[:, 2]
        self.travel_m = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))]
        self._landmark = path[sightings.pose] + np.einsum(
            "nij,nj->ni", self._turn[sightings.pose], sightings.offset
        )
        self._landmark_travel = self.travel_m[sightings.pose]
        axis = (np.arange(round(2 * _HALF_M / _STEP_M)) + 0.5) * _STEP_M - _HALF_M
        self._side = len(axis)
        self._cells = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
        self._sift: Any = cv2.SIFT.create(_N_FEATURES, contrastThreshold=0.01)

    def around(self, pose: int) -> GroundView:
        """Return the ground view around a pose from the images up to it."""
        ground = np.column_stack([self._cells, self._surface(pose)])
        total, weight = np.zeros(len(ground)), np.zeros(len(ground))
        for frame in self._frames_before(pose):
            seen, pixels, share = self._looked(frame, pose, ground)
            if len(seen):
                total[seen] += share * self._sampled(frame, pixels)
                weight[seen] += share
        shape = (self._side, self._side)
        is_seen = (weight > _LEAST_WEIGHT).reshape(shape)
        grey = (total / np.maximum(weight, 1e-9)).reshape(shape)
        return self._described(pose, grey, is_seen, ground)

    def _frames_before(self, pose: int) -> IntArray:
        """Return frames within reach behind the pose, one for every so much of travel."""
        behind = self.travel_m[pose] - self.travel_m
        within = np.flatnonzero(
            (behind >= 0.0) & (behind < _BEHIND_M) & (np.arange(len(behind)) <= pose) & self._has_image
        )
        step = (behind[within] / _FRAME_SPACING_M).astype(int)
        return within[np.unique(step, return_index=True)[1]]

    def level(self, pose: int) -> FloatArray:
        """Return the axes (3, 3) of a pose's level frame, as columns in the world."""
        cosine, sine = np.cos(self._yaw[pose]), np.sin(self._yaw[pose])
        return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])

    def _surface(self, pose: int) -> FloatArray:
        """Return the height of the ground at the cells above the body, in its level frame."""
        level = self.level(pose)
        near = np.abs(self._landmark_travel - self.travel_m[pose]) < _BEHIND_M + _SURFACE_M
        points = (self._landmark[near] - self._path[pose]) @ level
        points = points[(np.hypot(points[:, 0], points[:, 1]) < _SURFACE_M)]
        up = level.T @ self._turn[pose][:, 2]
        plane = np.array([0.0, -up[0] / up[2], -up[1] / up[2], 0.0, 0.0, 0.0])
        return _powers(self._cells) @ (plane + _fitted_surface(points, plane))

    def _looked(
        self, frame: int, pose: int, ground: FloatArray
    ) -> tuple[IntArray, npt.NDArray[np.float32], FloatArray]:
        """Return which cells a frame sees from near, at which pixels, and their weight."""
        camera = self._camera
        eye = np.linalg.inv(camera.T_body_camera)
        turn = self._turn[frame].T @ self.level(pose)
        shift = self._turn[frame].T @ (self._path[pose] - self._path[frame])
        body = ground @ turn.T + shift
        ahead = body[:, 0] - camera.T_body_camera[0, 3]
        distance = np.hypot(ahead, body[:, 1])
        near = np.flatnonzero((distance < _FARTHEST_M) & (ahead > _NEAREST_M - camera.T_body_camera[0, 3]))
        pixels = camera.project(body[near] @ eye[:3, :3].T + eye[:3, 3])
        inside = ((pixels > 2.0) & (pixels < np.array([camera.width, camera.height]) - 3.0)).all(axis=1)
        near = near[inside]
        return near, pixels[inside].astype(np.float32), distance[near] ** -3

    def _sampled(self, frame: int, pixels: npt.NDArray[np.float32]) -> FloatArray:
        grey = grey_of(self._frames[int(self._image_of[frame])], self._camera.width, self._camera.height)
        values = cv2.remap(grey.astype(np.float32), pixels[None, :, 0], pixels[None, :, 1], cv2.INTER_LINEAR)
        return np.asarray(values[0], dtype=np.float64)

    def _described(self, pose: int, grey: FloatArray, is_seen: BoolArray, ground: FloatArray) -> GroundView:
        even = _even(grey, is_seen)
        inner = cv2.erode(is_seen.astype(np.uint8), np.ones((9, 9), np.uint8))
        keys, descriptors = self._sift.detectAndCompute(even, inner)
        if not keys:
            return GroundView(pose, np.zeros((0, 3)), np.zeros((0, 128), np.float32))
        at = np.array([key.pt for key in keys])
        cell = np.rint(at).astype(int)
        height = ground[cell[:, 1] * self._side + cell[:, 0], 2]
        xy = (at + 0.5) * _STEP_M - _HALF_M
        rooted = np.sqrt(descriptors / np.maximum(descriptors.sum(axis=1, keepdims=True), 1e-9))
        return GroundView(pose, np.column_stack([xy, height]), rooted.astype(np.float32))


def _powers(xy: FloatArray) -> FloatArray:
    x, y = xy.T
    return np.column_stack([np.ones_like(x), x, y, x**2, x * y, y**2])


def _fitted_surface(points: FloatArray, plane: FloatArray) -> FloatArray:
    """Return the coefficients to add to a plane (6,) so that points (N, 3) lie on the surface; zero for too few."""
    if len(points) < _LEAST_LANDMARKS:
        return np.zeros(6)
    powers = _powers(points[:, :2])
    off = points[:, 2] - powers @ plane
    added: FloatArray = np.zeros(6)
    weight: FloatArray = np.ones(len(off), dtype=np.float64)
    # The plane of the tracks may be off by a few degrees, and dunes bend by some centimetres over a metre.
    prefer = np.diag(1.0 / np.array([0.05, 0.1, 0.1, 0.02, 0.02, 0.02]) ** 2)
    for _ in range(5):
        normal = powers.T @ (weight[:, None] * powers) / _RELIEF_M**2 + prefer
        added[:] = np.linalg.solve(normal, powers.T @ (weight * off) / _RELIEF_M**2)
        far = (off - powers @ added) / (2.0 * _RELIEF_M)
        weight = np.asarray(1.0 / (1.0 + far**2), dtype=np.float64)
    return added


def _even(grey: FloatArray, is_seen: BoolArray) -> Image:
    """Return a picture without wide shades, of the same contrast everywhere."""
    mean = float(grey[is_seen].mean()) if is_seen.any() else 0.0
    filled = np.where(is_seen, grey, mean).astype(np.float32)
    detail: Any = filled - cv2.GaussianBlur(filled, (0, 0), _WIDE_M / _STEP_M)
    spread = np.sqrt(cv2.GaussianBlur(detail**2, (0, 0), _CONTRAST_M / _STEP_M)) + 1.0
    picture = np.clip(128.0 + 45.0 * detail / spread, 0.0, 255.0).astype(np.uint8)
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), 1.0), dtype=np.uint8)


_RATIO = 0.9  # Lowe's ratio test: distance to the best match over that to the second
_AGREE_M = 0.10
_BASE_M = 0.6  # between the two matches of a guess: nearer ones leave the rotation open
_N_GUESSES = 1500
_LEAST_MATCHES = 12


@dataclass(frozen=True)
class Overlay:
    """Position and rotation of the second view in the level frame of the first.

    ``shift`` (3,) [m] and ``turn_rad`` counter-clockwise; ``n_agree`` of ``n_matches``
    features that fit, ``spread_m`` how far they reach (least standard deviation of their
    places), ``misfit_m`` the RMS distance left between them on one axis.
    """

    shift: FloatArray
    turn_rad: float
    n_agree: int
    n_matches: int
    spread_m: float
    misfit_m: float


def match_overlay(first: GroundView, second: GroundView) -> Overlay | None:
    """Align two views by rotation and shift; None where too few features match.

    Lengths are known, so that two matches give a guess: of all pairs of matches those as
    far apart in both views are tried, and the guess with the most inliers within 10 cm
    is taken. It is then fitted to them by least squares, the height by their median. How many
    agree is for the caller to judge: on ground that only seems the same up to a dozen do.

    >>> rng = np.random.default_rng(1)
    >>> xyz, looks = rng.uniform(-2.0, 2.0, (40, 3)), rng.random((40, 128), np.float32)
    >>> looks /= np.linalg.norm(looks, axis=1, keepdims=True)
    >>> overlay = match_overlay(GroundView(0, xyz, looks), GroundView(9, xyz - [0.5, 0.2, 0.1], looks))
    >>> overlay.shift.round(3).tolist(), overlay.n_agree
    ([0.5, 0.2, 0.1], 40)
    """
    one, other = _matched(first, second)
    if len(one) < _LEAST_MATCHES:
        return None
    agree = _largest_agreement(one[:, :2], other[:, :2])
    turn, shift = 0.0, np.zeros(2)
    for _ in range(5):
        if agree.sum() < _LEAST_MATCHES // 2:
            return None
        turn, shift = _fitted_rigid_motion(one[agree, :2], other[agree, :2])
        agree = _distance(one[:, :2], other[:, :2], turn, shift) < _AGREE_M
    if agree.sum() < _LEAST_MATCHES // 2:
        return None
    off = _distance(one[agree, :2], other[agree, :2], turn, shift)
    places = one[agree, :2] - one[agree, :2].mean(axis=0)
    return Overlay(
        np.append(shift, np.median(one[agree, 2] - other[agree, 2])),
        turn,
        int(agree.sum()),
        len(one),
        float(np.sqrt(np.linalg.eigvalsh(places.T @ places / len(places))[0])),
        float(np.sqrt(0.5 * np.mean(off**2))),
    )


def _matched(first: GroundView, second: GroundView) -> tuple[FloatArray, FloatArray]:
    """Return the places (M, 3) in both views of features that look alike, and like no other."""
    if min(len(first.xyz), len(second.xyz)) < _LEAST_MATCHES:
        return np.zeros((0, 3)), np.zeros((0, 3))
    likeness = first.descriptors @ second.descriptors.T  # descriptors are of unit length
    best = likeness.argmax(axis=1)
    rows = np.arange(len(best))
    top = likeness[rows, best]
    likeness[rows, best] = -1.0
    runner_up = likeness.max(axis=1)
    # The ratio of distances, d² = 2 - 2 u·v.
    clear = (1.0 - top) < _RATIO**2 * (1.0 - runner_up)
    # Of several features that look like one, the likeliest.
    order = np.flatnonzero(clear)[np.argsort(-top[clear], kind="stable")]
    _, once = np.unique(best[order], return_index=True)
    chosen = order[np.sort(once)]
    return first.xyz[chosen], second.xyz[best[chosen]]


def _largest_agreement(one: FloatArray, other: FloatArray) -> BoolArray:
    """Return which matches agree with the best guess from a pair of them."""
    i, j = np.triu_indices(len(one), 1)
    here, there = one[j] - one[i], other[j] - other[i]
    length = np.hypot(*here.T)
    fits = (length > _BASE_M) & (np.abs(length - np.hypot(*there.T)) < _AGREE_M)
    tried = np.flatnonzero(fits)
    if len(tried) == 0:
        return np.zeros(len(one), dtype=bool)
    tried = tried[np.linspace(0, len(tried) - 1, min(_N_GUESSES, len(tried))).astype(int)]
    here, there = here[tried], there[tried]
    turn = np.arctan2(here[:, 1], here[:, 0]) - np.arctan2(there[:, 1], there[:, 0])
    # Complex numbers turn and shift all matches by all guesses at once.
    spin = np.exp(1j * turn)
    p, q = one[:, 0] + 1j * one[:, 1], other[:, 0] + 1j * other[:, 1]
    shift = 0.5 * (p[i[tried]] + p[j[tried]]) - spin * 0.5 * (q[i[tried]] + q[j[tried]])
    off = np.abs(p[None] - spin[:, None] * q[None] - shift[:, None])
    agree: BoolArray = off[(off < _AGREE_M).sum(axis=1).argmax()] < _AGREE_M
    return agree


def _fitted_rigid_motion(one: FloatArray, other: FloatArray) -> tuple[float, FloatArray]:
    """Turn and shift (2,) that lay `other` on `one` by least squares."""
    p, q = one[:, 0] + 1j * one[:, 1], other[:, 0] + 1j * other[:, 1]
    turn = float(np.angle(((p - p.mean()) * (q - q.mean()).conj()).sum()))
    shift = p.mean() - np.exp(1j * turn) * q.mean()
    return turn, np.array([shift.real, shift.imag])


def _distance(one: FloatArray, other: FloatArray, turn: float, shift: FloatArray) -> FloatArray:
    cosine, sine = np.cos(turn), np.sin(turn)
    off = one - other @ np.array([[cosine, sine], [-sine, cosine]]) - shift
    distance: FloatArray = np.hypot(*off.T)
    return distance
