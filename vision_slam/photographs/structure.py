"""Poses of photographs and points of the ground from matched features alone (structure from motion).

`reconstruct_cameras` begins with two photographs whose rays cross well, adds those that see enough of the known points, and
adjusts all together after each round (Schönberger and Frahm 2016). The unit of length is the distance of the first two.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np
from scipy.linalg import LinAlgError

from survey import Camera
from survey.core import BoolArray, FloatArray, IntArray, Progress
from vision_slam.config import VisualOdometryConfig
from vision_slam.odometry.adjustment_kernels import seen_from_anchors
from vision_slam.odometry.global_adjustment import (
    UNCHANGED,
    Geometry,
    GlobalAdjustment,
    MotionFactors,
    TrackPixels,
    triangulated,
)
from vision_slam.photographs.matches import MatchedPair, Matches, sorted_tracks

_LEAST_PLACED = 3
_N_STARTS = 4  # first pairs that are tried while most photographs stay out
_MOST = 0.7
_N_CANDIDATES = 40  # pairs with most matches, of which the first is taken
_START_ANGLE_DEG, _LEAST_START_DEG = (
    8.0,
    2.0,
)  # median angle of the rays of a good first pair, and the least one
_LEAST_START = 30  # points of a first pair
_CROSSING_DEG = 1.5  # least angle of the rays of a point
_LEAST_SEEN = 15  # known points of a photograph that is added
_AS_MANY = 0.4  # of the known points of the best one, that others of the same round see
_RESECTION, _EPIPOLAR, _FIRST_GATE, _LEAST_GATE = 0.006, 0.0015, 0.015, 0.0015  # in focal lengths
_GATE = 4.0  # standard deviations of a pixel
_N_TRIALS, _CONFIDENCE = 2000, 0.9999
_N_ROUND, _N_LAST = 12, 40  # iterations of an adjustment
_LEAST_FOR_LENS = 5
_ANY_LENS = np.array([0.2, 0.2, 0.1])  # prior errors of log f, k1 and k2 where nothing states the distortion


class PlacedCameras(NamedTuple):
    """Cameras and points, in units of the distance of the first two photographs.

    `camera`: the calibration with the adjusted lens, at the origin of its body. `image` (K,): photographs that are placed, in
    their order. `poses` (K, 4, 4): T_world_camera. `tracks`: pixels of the points, by the index into `image`. `points` (J, 3): places.
    `errors` (S, K, 6): draws of the errors of the poses, rotation in the camera's axes [rad] and translation. `pixel_sigma`:
    standard deviation of a pixel [pixels].
    """

    camera: Camera
    image: IntArray
    poses: FloatArray
    tracks: TrackPixels
    points: FloatArray
    errors: FloatArray
    pixel_sigma: float


def reconstruct_cameras(
    matches: Matches, camera: Camera, progress: Progress | None = None
) -> PlacedCameras | None:
    """Place as many photographs as matched features allow; None where these are fewer than three."""
    best: _Growing | None = None
    n = len({image for one in matches.pairs for image in (one.first, one.second)})
    for start in _starts(matches, camera):
        grown = _Growing(matches.tracks, camera)
        if grown.begin(start):
            grown.grow(progress, n)
        if best is None or len(grown.poses) > len(best.poses):
            best = grown
        if len(best.poses) >= _MOST * n:
            break
    return None if best is None or len(best.poses) < _LEAST_PLACED else best.finished()


class _Start(NamedTuple):
    """Two photographs, and the pose (4, 4) of the second in the frame of the first."""

    pair: MatchedPair
    pose: FloatArray


def _starts(matches: Matches, camera: Camera) -> Iterator[_Start]:
    """Yield the best first pairs: many points whose rays cross at a wide angle."""
    found = []
    for one in sorted(matches.pairs, key=lambda pair: -len(pair.features))[:_N_CANDIDATES]:
        first, second = (
            camera.rays(matches.pixels[image][one.features[:, side]])
            for side, image in enumerate((one.first, one.second))
        )
        pose, angle_deg = _relative_pose(first, second)
        if len(angle_deg) >= _LEAST_START and np.median(angle_deg) > _LEAST_START_DEG:
            weight = len(angle_deg) * min(float(np.median(angle_deg)) / _START_ANGLE_DEG, 1.0)
            found.append((weight, _Start(one, pose)))
    yield from (start for _, start in sorted(found, key=lambda scored: -scored[0])[:_N_STARTS])


def _relative_pose(first: FloatArray, second: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the pose (4, 4) of a second camera in the first, a unit away, and the angles [deg] of the rays (N, 3) that fit."""
    pose = np.eye(4)
    plane = [np.ascontiguousarray(rays[:, :2] / rays[:, 2:]) for rays in (first, second)]
    matrix, fits = cv2.findEssentialMat(
        plane[0], plane[1], np.eye(3), cv2.USAC_MAGSAC, _CONFIDENCE, _EPIPOLAR, _N_TRIALS
    )
    if matrix is None or matrix.shape != (3, 3):
        return pose, np.zeros(0)
    _, turn, shift, ahead = cv2.recoverPose(matrix, plane[0], plane[1], np.eye(3), mask=fits)
    pose[:3, :3], pose[:3, 3] = turn.T, -turn.T @ shift.ravel()
    fit = ahead.ravel() > 0
    cosine = np.einsum("ni,ni->n", first[fit], second[fit] @ turn)
    return pose, np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))


class _Growing:
    """Photographs placed so far: poses by photograph, the lens, and which observations are kept."""

    def __init__(self, tracks: TrackPixels, camera: Camera) -> None:
        self.camera = replace(camera, T_body_camera=np.eye(4))
        self.lens = UNCHANGED
        self.poses: dict[int, FloatArray] = {}
        self._image, self._pixel = tracks.keyframe, tracks.pixel
        self._track = np.repeat(np.arange(len(tracks.first) - 1), np.diff(tracks.first))
        self._is_kept = np.ones(len(self._track), dtype=np.bool_)
        self._focal_px = float(camera.matrix[0, 0])
        self._pixel_sigma = VisualOdometryConfig().pixel_sigma
        self._place = np.full((len(tracks.first) - 1, 3), np.nan)

    def begin(self, start: _Start) -> bool:
        """Place the first two photographs; return whether their points hold together."""
        self.poses = {start.pair.first: np.eye(4), start.pair.second: start.pose}
        return self._adjust(_N_ROUND) is not None

    def grow(self, progress: Progress | None, n: int) -> None:
        """Add photographs until none is left that sees enough known points."""
        while True:
            if progress is not None:
                progress("cameras", len(self.poses), n)
            added = self._resected()
            if not added:
                return
            before = dict(self.poses)
            self.poses |= added
            if self._adjust(_N_ROUND) is None:
                self.poses = before
                return

    def finished(self) -> PlacedCameras | None:
        """Adjust to the end, and draw the errors; None where the equations are singular."""
        self._adjust(_N_LAST)
        found = self._adjust(_N_LAST)
        if found is None:
            return None
        adjustment, geometry, seen = found
        try:
            errors, _ = adjustment.errors(geometry)
        except LinAlgError:
            return None
        camera = self.lens.applied(self.camera)
        points = _places(geometry, seen)
        is_near = np.isfinite(points).all(axis=1)
        return PlacedCameras(
            camera,
            np.array(sorted(self.poses)),
            geometry.poses,
            seen.select(np.flatnonzero(is_near)),
            points[is_near],
            errors,
            self._pixel_sigma,
        )

    def _adjust(self, n_iterations: int) -> tuple[GlobalAdjustment, Geometry, TrackPixels] | None:
        """Adjust poses, points and lens, and drop observations that do not fit; None where too few points hold."""
        images = sorted(self.poses)
        start = np.array([self.poses[image] for image in images])
        rows = self._crossing(images, start, self._gate_px())
        if len(np.unique(self._track[rows])) < _LEAST_START:
            return None
        seen = self._selected(rows, images)
        rays = self.lens.applied(self.camera).rays(seen.pixel)
        geometry = Geometry(start, triangulated(start, rays, seen), self.lens)
        is_free = self.camera.distortion_is_assumed and len(images) >= _LEAST_FOR_LENS
        motions = MotionFactors.of(start, (), VisualOdometryConfig())
        adjustment = GlobalAdjustment(
            self.camera, seen, self._pixel_sigma, _ANY_LENS if is_free else np.zeros(3), motions
        )
        geometry = adjustment.solve(adjustment.with_points(geometry), n_iterations).geometry
        self._pixel_sigma = adjustment.pixel_error(geometry)
        self.lens = geometry.lens
        self.poses = dict(zip(images, geometry.poses, strict=True))
        self._is_kept[rows] = self._off_px(geometry, seen) < self._gate_px()
        self._place[:] = np.nan
        self._place[np.unique(self._track[rows])] = _places(geometry, seen)
        return adjustment, geometry, seen

    def _gate_px(self) -> float:
        """Return the largest error of an observation that is kept [pixels]; a wide one before anything is adjusted."""
        if len(self.poses) == 2:  # a first pair
            return _FIRST_GATE * self._focal_px
        return max(_GATE * self._pixel_sigma, _LEAST_GATE * self._focal_px)

    def _off_px(self, geometry: Geometry, seen: TrackPixels) -> FloatArray:
        """Return the distances (N,) of observations from where their points are seen [pixels]; infinite behind a camera."""
        local, _ = seen_from_anchors(geometry.poses, geometry.points, seen.first, seen.keyframe)
        off = np.linalg.norm(geometry.lens.applied(self.camera).project(local) - seen.pixel, axis=1)
        return np.where(np.isfinite(off), off, np.inf)

    def _selected(self, rows: IntArray, images: list[int]) -> TrackPixels:
        """Return the tracks of observations, by the index into the photographs that are placed."""
        return sorted_tracks(self._track[rows], np.searchsorted(images, self._image[rows]), self._pixel[rows])

    def _crossing(self, images: list[int], poses: FloatArray, gate_px: float) -> IntArray:
        """Return the kept observations of tracks that placed photographs see, whose rays cross and meet in a point."""
        rows = np.flatnonzero(self._is_kept & np.isin(self._image, images))
        rows = rows[self._is_shared(rows)]
        if len(rows) == 0:
            return rows
        seen = self._selected(rows, images)
        rays = self.lens.applied(self.camera).rays(seen.pixel)
        points = triangulated(poses, rays, seen)
        off_px = self._off_px(Geometry(poses, points, self.lens), seen)
        widest = np.repeat(_crossing_deg(poses, rays, seen), np.diff(seen.first))
        new = ~np.isfinite(self._place[self._track[rows]]).all(axis=1)
        # A point that is known keeps its observations until the adjustment has seen them.
        fits = (off_px < max(gate_px, _RESECTION * self._focal_px)) | ~new
        rows = np.asarray(rows[(widest > _CROSSING_DEG) & fits], dtype=np.int64)
        crossing: IntArray = rows[self._is_shared(rows)]
        return crossing

    def _is_shared(self, rows: IntArray) -> BoolArray:
        """Return which observations belong to a track that two of them see."""
        counts = np.bincount(self._track[rows], minlength=len(self._place))
        shared: BoolArray = counts[self._track[rows]] > 1
        return shared

    def _resected(self) -> dict[int, FloatArray]:
        """Return poses of photographs that see most known points, from these."""
        known = np.isfinite(self._place[self._track]).all(axis=1) & self._is_kept
        known &= ~np.isin(self._image, list(self.poses))
        counts = np.bincount(self._image[known])
        if counts.max(initial=0) < _LEAST_SEEN:
            return {}
        added = {}
        for image in np.flatnonzero(counts >= max(_LEAST_SEEN, _AS_MANY * counts.max())).tolist():
            rows = np.flatnonzero(known & (self._image == image))
            pose = self._pose(rows)
            if pose is not None:
                added[image] = pose
            else:
                self._is_kept[rows] = False  # it is tried again when it sees other points
        return added or self._resected()

    def _pose(self, rows: IntArray) -> FloatArray | None:
        """Return the pose (4, 4) of a photograph by the known points it sees; None where too few agree."""
        rays = self.lens.applied(self.camera).rays(self._pixel[rows])
        plane, place = np.ascontiguousarray(rays[:, :2] / rays[:, 2:]), self._place[self._track[rows]]
        found, turn, shift, fits = cv2.solvePnPRansac(
            place, plane, np.eye(3), None, iterationsCount=_N_TRIALS, reprojectionError=_RESECTION,
            confidence=_CONFIDENCE, flags=cv2.SOLVEPNP_SQPNP,
        )  # fmt: skip
        if not found or fits is None or len(fits) < _LEAST_SEEN:
            return None
        inside = np.asarray(fits, dtype=np.int64).ravel()
        turn, shift = cv2.solvePnPRefineLM(place[inside], plane[inside], np.eye(3), None, turn, shift)
        self._is_kept[np.delete(rows, inside)] = False
        pose = np.eye(4)
        pose[:3, :3] = cv2.Rodrigues(turn)[0].T
        pose[:3, 3] = -pose[:3, :3] @ shift.ravel()
        return pose


def _crossing_deg(poses: FloatArray, rays: FloatArray, seen: TrackPixels) -> FloatArray:
    """Return the widest angle (J,) of a ray of each track from its first one [deg]."""
    turned = np.einsum("nij,nj->ni", poses[seen.keyframe, :3, :3], rays)
    first = np.repeat(turned[seen.first[:-1]], np.diff(seen.first), axis=0)
    angle = np.degrees(np.arccos(np.clip(np.einsum("ni,ni->n", turned, first), -1.0, 1.0)))
    widest: FloatArray = np.maximum.reduceat(angle, seen.first[:-1])
    return widest


def _places(geometry: Geometry, seen: TrackPixels) -> FloatArray:
    """Return the places (J, 3) of points; NaN where their depth is not positive."""
    anchor = geometry.poses[seen.keyframe[seen.first[:-1]]]
    depth = np.where(geometry.points[:, 2] > 0.0, 1.0 / np.maximum(geometry.points[:, 2], 1e-12), np.nan)
    ray = np.column_stack([geometry.points[:, :2], np.ones(len(depth))])
    places: FloatArray = anchor[:, :3, 3] + depth[:, None] * np.einsum("jab,jb->ja", anchor[:, :3, :3], ray)
    return places
