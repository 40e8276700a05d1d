"""Top-down ground mosaics and their features."""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from survey.core.arrays import BoolArray, FloatArray, IntArray
from survey.data.camera.calibration import Camera
from survey.data.camera.frames import Frames, Image
from survey.data.sensors.odometry import Odometry
from survey.data.sensors.sightings import Sightings
from vision_slam.odometry.clahe import grey_of
from vision_slam.rotation import rotations

_STEP_M = 0.025
_HALF_M = 3.0
_NEAREST_M, _FARTHEST_M = (
    0.75,
    2.3,
)  # nearer lies the rover's own shadow, farther a bump hides what is behind it
_FRAME_SPACING_M = 0.35
_BEHIND_M = _HALF_M + _FARTHEST_M
_SURFACE_M = 3.5
_LEAST_LANDMARKS = 12
_RELIEF_M = 0.03
_LEAST_WEIGHT = 0.02
_N_FEATURES = 800
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

    Parameters
    ----------
    frames : Frames
        Images; a pose without one of its time has seen nothing.
    camera : Camera
        That took them.
    path : (N, 3) ndarray
        Reckoned places of the poses [m]; only what lies within some metres of travel counts.
    odometry : Odometry
        Their attitudes.
    sightings : Sightings
        Landmarks.
    """

    def __init__(
        self,
        frames: Frames,
        camera: Camera,
        path: FloatArray,
        odometry: Odometry,
        sightings: Sightings,
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
        return _powers(self._cells) @ (plane + _fitted(points, plane))

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


def _fitted(points: FloatArray, plane: FloatArray) -> FloatArray:
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
