"""Estimates from finished tracks: triangulated landmarks, and heading drift from far features.

`LandmarkTriangulator` triangulates near corners relative to the body, with covariances. `FarFeatures` estimates the heading
drift from the bearings of ridges over many keyframes: it needs the complete drive, lengths in metres, and mountains in sight
over more than 12 m.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve

from survey import Camera
from survey.core import BoolArray, FloatArray, IntArray
from survey.data.sensors.odometry import Sightings
from vision_slam.config import VisualOdometryConfig
from vision_slam.odometry.tracks import Track

_LEAST_LANDMARK_SIGHTS = 4
_GREATEST_RANGE_M = 60.0
_GREATEST_ERROR_PX = 1.5


class EndedTrack(NamedTuple):
    """Observations of a corner that is not followed any more: keyframes (N,), unit rays (N, 3), and whether it is far."""

    keyframes: IntArray
    rays: FloatArray
    is_far: bool

    @classmethod
    def of(cls, track: Track) -> "EndedTrack":
        """Return the observations of a track in less memory."""
        return cls(
            np.array(track.keyframes, dtype=np.int64), np.array(track.rays).reshape(-1, 3), track.is_far
        )


class LandmarkTriangulator:
    """Triangulation of tracks with enough near observations, relative to the body at the last keyframe.

    Its covariance is that of pixels and of poses together, since the poses within the
    window are themselves estimates: with Λ = Σ JᵀJ the information of the rays about the
    place, σ the pixel's angle, o the arm from the body, φ the attitude error between the
    poses and s that of the window's scale,

        C = (k σ)² Λ⁻¹ + φ² (|o|² I − o oᵀ) + s² o oᵀ + f² I

    where k, φ, s and the floor f are those of `VisualOdometryConfig`, calibrated on a drive
    over ground that is known. A landmark's error is not independent of its neighbours'.
    """

    def __init__(self, camera: Camera, config: VisualOdometryConfig) -> None:
        self._T_body_camera, self._config = camera.T_body_camera, config
        self._focal_px = 0.5 * (camera.matrix[0, 0] + camera.matrix[1, 1])
        self.pixel_sigma = config.pixel_sigma
        self._frame: list[int] = []
        self._offset: list[FloatArray] = []
        self._covariance: list[FloatArray] = []
        self._range_m: list[FloatArray] = []

    def add(self, tracks: Sequence[Track | EndedTrack], poses: FloatArray, frame_of: IntArray) -> None:
        """Triangulate tracks under poses (K, 4, 4); `frame_of` (K,) is the first frame of each keyframe."""
        near = [track for track in tracks if not track.is_far and len(track.rays) >= _LEAST_LANDMARK_SIGHTS]
        if not near:
            return
        points, information, error, is_good = intersected(*self._sights(near, poses))
        is_good &= error <= _GREATEST_ERROR_PX / self._focal_px
        ends = np.array([[poses[track.keyframes[end]] for end in (0, -1)] for track in near])
        range_m = np.linalg.norm(points - ends[:, 0, :3, 3], axis=1)
        chosen = np.flatnonzero(is_good & (range_m <= _GREATEST_RANGE_M))
        turn, place = ends[chosen, 1, :3, :3], ends[chosen, 1, :3, 3]
        arm = np.einsum("nji,nj->ni", turn, points[chosen] - place)
        self._frame += [int(frame_of[near[index].keyframes[-1]]) for index in chosen.tolist()]
        self._offset.append(arm)
        self._covariance.append(self._own(information[chosen], turn) + _of_poses(arm, self._config))
        self._range_m.append(range_m[chosen])

    def _sights(
        self, tracks: Sequence[Track | EndedTrack], poses: FloatArray
    ) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return the rays (T, N, 3) of tracks in the window's frame, where they begin, and which there are."""
        shape = len(tracks), max(len(track.rays) for track in tracks)
        rays, places, there = np.zeros((*shape, 3)), np.zeros((*shape, 3)), np.zeros(shape, dtype=np.bool_)
        rays[..., 2] = 1.0
        eyes = poses @ self._T_body_camera
        for row, track in enumerate(tracks):
            eye = eyes[track.keyframes]
            rays[row, : len(eye)] = np.einsum("nij,nj->ni", eye[:, :3, :3], np.array(track.rays))
            places[row, : len(eye)], there[row, : len(eye)] = eye[:, :3, 3], True
        return rays, places, there

    def _own(self, information: FloatArray, turn: FloatArray) -> FloatArray:
        """Return the covariances (N, 3, 3) that pixels alone give, in the body frame [m²]."""
        sigma = self._config.landmark_pixel_factor * self.pixel_sigma / self._focal_px
        own: FloatArray = sigma**2 * (turn.transpose(0, 2, 1) @ np.linalg.inv(information) @ turn)
        return own

    @property
    def sightings(self) -> Sightings:
        """All of them."""
        return Sightings(
            np.array(self._frame, dtype=np.int64),
            np.concatenate([np.zeros((0, 3)), *self._offset]),
            np.concatenate([np.zeros((0, 3, 3)), *self._covariance]),
            np.concatenate([np.zeros(0), *self._range_m]),
        )


def _of_poses(arm: FloatArray, config: VisualOdometryConfig) -> FloatArray:
    """Return the covariances (N, 3, 3) of arms (N, 3) by the errors of the poses [m²]."""
    along = arm[:, :, None] * arm[:, None, :]
    across = (arm**2).sum(axis=1)[:, None, None] * np.eye(3) - along
    spread: FloatArray = (
        np.radians(config.landmark_attitude_deg) ** 2 * across + config.landmark_scale_sigma**2 * along
    )
    return spread + config.landmark_floor_m**2 * np.eye(3)


def intersected(
    rays: FloatArray, places: FloatArray, there: BoolArray
) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
    """Intersect the rays (T, N, 3) of each track that are `there` (T, N).

    Returns the point (T, 3) nearest to all rays by angle, the information of its place
    (T, 3, 3) [1/m² per rad²], the RMS angle [rad], and which of them are points at all.
    """
    across = np.eye(3) - rays[..., :, None] * rays[..., None, :]
    is_good, weight = np.ones(len(rays), dtype=np.bool_), there.astype(np.float64)
    for _ in range(3):
        normal = np.einsum("tn,tnij->tij", weight, across)
        is_good &= np.linalg.det(normal) >= 1e-12 * np.trace(normal, axis1=1, axis2=2) ** 3
        normal[~is_good] = np.eye(3)
        right = np.einsum("tn,tni->ti", weight, np.einsum("tnij,tnj->tni", across, places))
        point = np.linalg.solve(normal, right[..., None])[..., 0]
        gap = point[:, None] - places
        distance = np.linalg.norm(gap, axis=2)
        is_good &= np.where(there, distance, np.inf).min(axis=1) >= 0.1
        distance = np.maximum(distance, 1e-9)
        weight = there / distance**2
    information = np.einsum("tn,tnij->tij", weight, across)
    is_good &= np.linalg.eigvalsh(information)[:, 0] > 0.0
    is_good &= np.where(there, (gap * rays).sum(axis=2), np.inf).min(axis=1) >= 0.0
    error = np.einsum("tnij,tnj->tni", across, gap) / distance[..., None]
    squares = np.where(there, (error**2).sum(axis=2), 0.0).sum(axis=1)
    return point, information, np.sqrt(squares / there.sum(axis=1)), is_good


_EVERY = 5  # keyframes; nearer ones are redundant, because tracked corners drift slowly
_LEAST_SPAN = 60
_LEAST_BEARINGS = 4
_LEAST_ELEVATION_RAD = np.radians(0.3)  # below is the ground's own horizon, which is near
_WALK_RAD_SQRT_M = np.radians(0.02)  # what the heading of images walks beside ridges
_NEARNESS_PER_M, _ITS_SPREAD_PER_M = 1.0 / 2000.0, 1.0 / 25000.0
_ODD = 2.0  # spreads; a hillside a kilometre away is no ridge
_PIXEL_SIGMA, _PRIOR_WEIGHT = 0.3, 5.0  # prior error of a corner, with the weight of so many observations
_OUTLYING = 3.0
_N_ITERATIONS = 8
_HELD, _FREE = 1e4, 1e-3


@dataclass(frozen=True)
class _Bearings:
    """Sights (N,) of far corners.

    Node of the heading, number of the corner, bearing beyond that at first sight [rad], way since then [m].
    """

    node: IntArray
    corner: IntArray
    bearing_rad: FloatArray
    aside_m: FloatArray
    along_m: FloatArray


class FarFeatures:
    r"""Heading drift of visual odometry, estimated from the bearings of far features.

    A window of a few metres takes a ridge for infinitely far, and sees no parallax; but one
    at 8 km to the left moves by 0.007 degrees a metre, and where ridges stand on one side
    the heading drifts with it. Over hundreds of metres both are observable. A corner j at a
    keyframe k has, in the frame of images, the bearing

    .. math:: α_{kj} = θ_j + δ_k + ρ_j s_{kj} / (1 − ρ_j a_{kj}) + e_{kj}

    with its bearing θ and nearness ρ [1/m] from where it was first seen, the way a along
    that bearing and s aside since then, and the drift δ of the heading, a random walk of
    0.02°/√m. A steady drift of all looks like ridges that are nearer to one side, even
    behind the rover to the other: they are separated by the prior that nearness spreads by 1/25 km
    about its mean, which is not known; nearer hillsides get little weight. All are
    solved for by least squares at once; e has a scale of its own for each corner, since some
    creep along an edge while they are followed, and Cauchy's weights.

    `camera`: calibration and mounting.

    The drift is relative to the first image. The complete drive and lengths in metres are
    needed. Without mountains in sight for more than 12 m there is none. On
    development surveys it takes a fifth to a half off what the heading changes by over 100 m
    and more, and nothing off shorter ones; where ridges hide behind the ground nearby, the
    heading drifts on. What it leaves is measured as the walk of the heading, and has no
    covariance of its own.

    >>> camera = Camera("pinhole", 640, 480, [[400, 0, 320], [0, 400, 240], [0, 0, 1]], np.zeros(5), np.eye(4))
    >>> far_features = FarFeatures(camera)
    >>> far_features.add([])
    >>> far_features.drift_rad(np.tile(np.eye(3), (2, 1, 1)), np.zeros((2, 3)), np.array([0, 0, 1])).tolist()
    [0.0, 0.0, 0.0]
    """

    def __init__(self, camera: Camera) -> None:
        self._body_camera = camera.T_body_camera[:3, :3]
        self._pixel_rad = 2.0 / float(camera.matrix[0, 0] + camera.matrix[1, 1])
        self._sights: list[tuple[IntArray, FloatArray]] = []

    def add(self, tracks: Sequence[Track | EndedTrack]) -> None:
        """Add the observations of finished tracks that were far and long."""
        for track in tracks:
            if not track.is_far or track.keyframes[-1] - track.keyframes[0] < _LEAST_SPAN:
                continue
            keyframes = np.array(track.keyframes)
            is_used = keyframes % _EVERY == 0
            if is_used.sum() >= _LEAST_BEARINGS:
                self._sights.append((keyframes[is_used], np.array(track.rays)[is_used]))

    def drift_rad(self, turn: FloatArray, place: FloatArray, of_frame: IntArray) -> FloatArray:
        """Return the heading drift of visual odometry since the first image [rad].

        `turn` (K, 3, 3): upright turns of the body at the keyframes. `place` (K, 3): where they are, in the
        same frame [m]. `of_frame` (N,) int: the keyframe of each frame that is asked for.
        """
        bearings = self._bearings(turn, place)
        if bearings is None:
            return np.zeros(len(of_frame))
        nodes = np.arange(0, len(place), _EVERY)
        travel = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(place, axis=0), axis=1))][nodes]
        drift = _solved_bearings(bearings, np.maximum(np.diff(travel), 1e-3), self._pixel_rad)
        spread: FloatArray = np.interp(of_frame, nodes, drift)
        return spread

    def _bearings(self, turn: FloatArray, place: FloatArray) -> _Bearings | None:
        """Return the observations of features above the horizon; None where there are none."""
        parts = []
        for keyframes, rays in self._sights:
            seen = np.einsum("nij,jk,nk->ni", turn[keyframes], self._body_camera, rays)
            if seen[:, 2].min() < np.sin(_LEAST_ELEVATION_RAD):
                continue
            bearing = np.unwrap(np.arctan2(seen[:, 1], seen[:, 0]))
            way = place[keyframes, :2] - place[keyframes[0], :2]
            ahead = np.array([np.cos(bearing[0]), np.sin(bearing[0])])
            aside = way @ [ahead[1], -ahead[0]]
            parts.append((keyframes // _EVERY, bearing - bearing[0], aside, way @ ahead))
        if not parts:
            return None
        corner = np.repeat(np.arange(len(parts)), [len(part[0]) for part in parts])
        node, bearing_rad, aside_m, along_m = (np.concatenate(column) for column in zip(*parts, strict=True))
        return _Bearings(node, corner, bearing_rad, aside_m, along_m)


def _solved_bearings(bearings: _Bearings, apart_m: FloatArray, pixel_rad: float) -> FloatArray:
    """Return the drift at the nodes (M,) [rad] by reweighted least squares; lengths are in km within."""
    n, n_nodes, n_corners = len(bearings.node), len(apart_m) + 1, int(bearings.corner[-1]) + 1
    counts = np.bincount(bearings.corner)
    row, ones = np.arange(n), np.ones(n)
    columns = np.r_[bearings.node, n_nodes + bearings.corner, n_nodes + n_corners + bearings.corner]
    before = pixel_rad * _PIXEL_SIGMA
    weight, nearness, is_ridge = np.full(n, 1.0 / before), np.zeros(n_corners), np.ones(n_corners)
    for _ in range(_N_ITERATIONS):
        parallax = (
            1e-3 * bearings.aside_m / (1.0 - (nearness[bearings.corner] * bearings.along_m).clip(-0.5, 0.5))
        )
        entries = np.r_[ones, ones, parallax], (np.r_[row, row, row], columns)
        design = sp.csr_matrix(entries, shape=(n, n_nodes + 2 * n_corners + 1))
        weighted, prior = sp.diags(weight) @ design, _nearness_prior(apart_m, is_ridge)
        found = spsolve((weighted.T @ weighted + prior).tocsc(), weighted.T @ (weight * bearings.bearing_rad))
        nearness = 1e-3 * found[n_nodes + n_corners : -1]
        odd = (nearness - 1e-3 * found[-1]) / (_ODD * _ITS_SPREAD_PER_M)
        is_ridge = 1.0 / (1.0 + odd**2)
        error = bearings.bearing_rad - design @ found
        scale = np.sqrt(
            (np.bincount(bearings.corner, error**2) + _PRIOR_WEIGHT * before**2) / (counts + _PRIOR_WEIGHT)
        )
        sigma = scale[bearings.corner]
        weight = 1.0 / sigma / np.sqrt(1.0 + (error / (_OUTLYING * sigma)) ** 2)
    drift: FloatArray = found[:n_nodes]
    return drift


def _nearness_prior(apart_m: FloatArray, is_ridge: FloatArray) -> Any:
    """Return the prior information: drift that walks from zero, any bearing, nearness about a mean."""
    known = 1.0 / (_WALK_RAD_SQRT_M**2 * apart_m)
    diagonal = np.r_[_HELD**2, known] + np.r_[known, 0.0]
    walk = sp.diags([diagonal, -known, -known], [0, 1, -1])
    bearing = sp.diags(np.full(len(is_ridge), _FREE**2))
    spread, mean = is_ridge * (1e3 * _ITS_SPREAD_PER_M) ** -2, (1e3 * _NEARNESS_PER_M) ** -2
    to_mean: Any = sp.csr_matrix(-spread[:, None])
    total = sp.csr_matrix([[mean + spread.sum()]])
    nearness: Any = sp.bmat([[sp.diags(spread), to_mean], [to_mean.T, total]])
    return sp.block_diag([walk, bearing, nearness], format="csr")
