r"""Photographs in the CRS of their fixes: similarity, correction by the fixes, and covariances.

The errors of poses and points are linear in few coefficients c of standard deviation 1: draws of the errors of the adjustment,
and the seven errors of a similarity, which are almost unknown. With A from coefficients to positions, fixes z of covariance R
give their posterior,

.. math:: C = (I + A^T R^{-1} A)^{-1}, \qquad c = C A^T R^{-1} (z - x)

and every covariance here is that of a linear function of c.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from survey import Recording, SurfacePoints, Trajectory
from survey.core import BoolArray, FloatArray, InputError, IntArray
from survey.data.path_error import POSE, PathError
from survey.data.sensors.records import GpsFixes
from vision_slam.config import UNKNOWN_MEMORY_S, LocalizationConfig
from vision_slam.drive_estimate import Localization, fix_errors
from vision_slam.photographs.structure import PlacedCameras

_NEAR_S = 2.0  # between a photograph and the fix that is taken for it
_LEAST_FIXES = 4
_LEAST_SPREAD_M = 2.0
_LEVEL_RAD = 0.05  # tilt of the camera's horizontal axis, by all photographs together
_SIDEWAYS = 0.5  # cosine of the angle of that axis with the vertical, from which a photograph is not upright
_UNKNOWN_SCALE, _UNKNOWN_TURN_RAD, _UNKNOWN_SHIFT_M = 0.3, 0.3, 100.0
_REFUSED = 6.0  # standard deviations of a fix from the photographs
_SCATTERED = 1.5  # of the fixes about the photographs over what is assumed, from which it is used
_NMAD = 1.4826
_CORRELATED = 2.0  # errors of one feature in several photographs, over independent ones
_LEAST_VIEWS = 3
_N_YAWS, _N_TRIED = 12, 4  # first headings of the similarity, and those that are fitted
_FLOOR = np.array(
    [1e-3, 1e-3, 1e-3, 1e-5, 1e-5, 1e-5]
)  # of the errors of poses [m, rad], which the draws do not span
_AT_ONCE = 1000  # points
_TO_WORLD = np.array(
    [[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]
)  # of a camera that looks level to the east


class PlacedFixes(NamedTuple):
    """Fixes of photographs: which of the placed ones (M,), time [s], position and errors (M, 3) [m]."""

    photo: IntArray
    time_s: FloatArray
    position: FloatArray
    sigma_m: FloatArray

    def select(self, chosen: BoolArray) -> "PlacedFixes":
        """Return some of the fixes."""
        return PlacedFixes(
            self.photo[chosen], self.time_s[chosen], self.position[chosen], self.sigma_m[chosen]
        )


def fixes_of(gps: GpsFixes, time_s: FloatArray, sigma_m: FloatArray) -> PlacedFixes:
    """Return the fixes (M) at the times of photographs (K,), on the line between neighbours at most 2 s away.

    `sigma_m` (N, 3): standard deviations of the fixes [m].
    """
    nearest = np.abs(time_s[:, None] - gps.time_s).argmin(axis=1)
    index = np.flatnonzero(np.abs(gps.time_s[nearest] - time_s) <= _NEAR_S)
    at_s = time_s[index]
    position = np.column_stack([np.interp(at_s, gps.time_s, axis) for axis in gps.position.T])
    return PlacedFixes(index, at_s, position, sigma_m[nearest[index]])


@dataclass(frozen=True)
class Placed:
    """Photographs in world axes, with the directions of their errors.

    `structure`: cameras and points in units of their own. `scale`, `turn` (3, 3), `shift` (3,): similarity to the world [m].
    `lever_m` (3,): position of the camera on the body. `mount` (3, 3): R_body_camera. `mean` (m,), `covariance` (m, m): posterior of the
    coefficients.
    """

    structure: PlacedCameras
    scale: float
    turn: FloatArray
    shift: FloatArray
    mount: FloatArray
    lever_m: FloatArray
    mean: FloatArray | None = None
    covariance: FloatArray | None = None

    @cached_property
    def bodies(self) -> FloatArray:
        """Poses T_world_body (K, 4, 4) before any correction."""
        poses = self.structure.poses
        bodies = np.tile(np.eye(4), (len(poses), 1, 1))
        bodies[:, :3, :3] = self.turn @ poses[:, :3, :3] @ self.mount.T
        bodies[:, :3, 3] = (
            self.scale * poses[:, :3, 3] @ self.turn.T + self.shift - bodies[:, :3, :3] @ self.lever_m
        )
        return bodies

    @cached_property
    def turns(self) -> FloatArray:
        """Errors of attitude (K, 3, m), as turns about the axes of the world [rad], per coefficient."""
        poses, errors = self.structure.poses, self.structure.errors
        drawn = np.einsum("ab,kbc,skc->kas", self.turn, poses[:, :3, :3], errors[:, :, :3]) / np.sqrt(
            len(errors)
        )
        shared = np.zeros((len(poses), 3, 7))
        shared[:, :, 1:4] = _UNKNOWN_TURN_RAD * np.eye(3)
        return np.concatenate([drawn, shared], axis=2)

    @cached_property
    def shifts(self) -> FloatArray:
        """Errors of the positions of the bodies (K, 3, m) [m] per coefficient."""
        errors, place = self.structure.errors, self.bodies[:, :3, 3]
        drawn = self.scale * np.einsum("ab,skb->kas", self.turn, errors[:, :, 3:]) / np.sqrt(len(errors))
        away = place - place.mean(axis=0)
        shared = np.zeros((len(place), 3, 7))
        shared[:, :, 0] = _UNKNOWN_SCALE * away
        shared[:, :, 1:4] = _UNKNOWN_TURN_RAD * np.cross(np.eye(3), away[:, None]).transpose(0, 2, 1)
        shared[:, :, 4:] = _UNKNOWN_SHIFT_M * np.eye(3)
        moved = np.concatenate([drawn, shared], axis=2)
        # The lever turns with its camera; a common turn is one about the middle of the bodies already.
        lever = self.bodies[:, :3, :3] @ self.lever_m
        moved[:, :, :-7] -= np.cross(self.turns[:, :, :-7], lever[:, :, None], axis=1)
        return moved

    def moved(self, place: FloatArray, index: IntArray) -> FloatArray:
        """Return by how much places (N, 3) move (N, 3, m) with the bodies that they are fixed to (N,), per coefficient."""
        arm = place - self.bodies[index, :3, 3]
        stretch = np.zeros((len(place), 3, self.shifts.shape[2]))
        stretch[:, :, -7] = _UNKNOWN_SCALE * arm
        turned: FloatArray = (
            self.shifts[index] + np.cross(self.turns[index], arm[:, :, None], axis=1) + stretch
        )
        return turned

    def corrected(self, fixes: PlacedFixes, config: LocalizationConfig, memory_s: float) -> "Placed":
        """Return the posterior of the coefficients by fixes of the bodies."""
        share = config.gps_bias_sigma_m / config.fix_sigma_m
        apart = np.exp(-np.abs(fixes.time_s[:, None] - fixes.time_s) / memory_s)
        kernel = share**2 * apart + (1.0 - share**2) * np.eye(len(apart))
        information = np.eye(self.shifts.shape[2])
        gradient = np.zeros(len(information))
        off = fixes.position - self.bodies[fixes.photo, :3, 3]
        for axis in range(3):
            slope, sigma = self.shifts[fixes.photo, axis], fixes.sigma_m[:, axis]
            factor = cho_factor(kernel * sigma[:, None] * sigma)
            information += slope.T @ cho_solve(factor, slope)
            gradient += slope.T @ cho_solve(factor, off[:, axis])
        slope = self._tilt_slopes()
        information += slope.T @ slope
        gradient -= slope.T @ self.tilts()
        covariance = np.linalg.inv(information)
        return replace(self, mean=covariance @ gradient, covariance=0.5 * (covariance + covariance.T))

    def tilts(self) -> FloatArray:
        """Return the tilts (K,) of the cameras' horizontal axes over their standard deviation; 0 where one is not upright."""
        tilt = self.bodies[:, 2, :3] @ self.mount[:, 0]
        tilts: FloatArray = np.where(np.abs(tilt) < _SIDEWAYS, tilt, 0.0) / (_LEVEL_RAD * np.sqrt(len(tilt)))
        return tilts

    def _tilt_slopes(self) -> FloatArray:
        """Return the changes (K, m) of the tilts per coefficient."""
        axis = self.bodies[:, :3, :3] @ self.mount[:, 0]
        slope = np.cross(self.turns, axis[:, :, None], axis=1)[:, 2]
        upright = (np.abs(axis[:, 2]) < _SIDEWAYS)[:, None]
        slopes: FloatArray = np.where(upright, slope, 0.0) / (_LEVEL_RAD * np.sqrt(len(axis)))
        return slopes

    def spread(self, slopes: FloatArray) -> FloatArray:
        """Return covariances (N, d, d) of functions of the coefficients (N, d, m)."""
        assert self.covariance is not None
        found: FloatArray = np.einsum("nim,mk,njk->nij", slopes, self.covariance, slopes, optimize=True)
        return found


def similarity(
    structure: PlacedCameras, mount: FloatArray, lever_m: FloatArray, fixes: PlacedFixes
) -> Placed:
    """Fit scale, turn and shift to fixes of the bodies, of which some may be wrong, and to upright photographs."""
    eyes, turns = structure.poses[:, :3, 3], structure.poses[:, :3, :3]
    scale_0 = _spread(fixes.position) / max(_spread(eyes[fixes.photo]), 1e-12)
    middle = fixes.position.mean(axis=0)

    def placed(state: FloatArray) -> Placed:
        scale, turn = scale_0 * np.exp(state[0]), Rotation.from_rotvec(state[1:4]).as_matrix()
        centre = scale * turn @ eyes[fixes.photo].mean(axis=0)
        return Placed(structure, scale, turn, middle + state[4:] * scale_0 - centre, mount, lever_m)

    def errors(state: FloatArray) -> FloatArray:
        found = placed(state)
        off = (found.bodies[fixes.photo, :3, 3] - fixes.position) / fixes.sigma_m
        tilt = found.bodies[:, 2, :3] @ mount[:, 0]
        return np.concatenate(
            [off.ravel(), np.clip(tilt, -_SIDEWAYS, _SIDEWAYS) / (_LEVEL_RAD * np.sqrt(len(tilt)))]
        )

    starts = [
        np.r_[0.0, (Rotation.from_euler("z", yaw) * up).as_rotvec(), np.zeros(3)]
        for up in _uprights(turns)
        for yaw in np.arange(_N_YAWS) * 2.0 * np.pi / _N_YAWS
    ]
    starts.sort(key=lambda start: float(np.log1p(0.25 * errors(start) ** 2).sum()))
    found = [least_squares(errors, start, loss="cauchy", f_scale=2.0) for start in starts[:_N_TRIED]]
    return placed(min(found, key=lambda one: one.cost).x)


def _uprights(turns: FloatArray) -> list[Rotation]:
    """Return rotations that set cameras (K, 3, 3) upright: their horizontal axes level, seen level or from above."""
    level = np.linalg.svd(turns[:, :, 0])[2][2]
    found = []
    for up in (-turns[:, :, 1].mean(axis=0), -turns[:, :, 2].mean(axis=0), level, -level):
        length = float(np.linalg.norm(up))
        if length > 0.1:  # else the cameras look all ways
            found.append(Rotation.align_vectors([[0.0, 0.0, 1.0]], [up / length])[0])
    return found


def _spread(places: FloatArray) -> float:
    return float(np.sqrt(((places - places.mean(axis=0)) ** 2).sum(axis=1).mean()))


def georeferenced(structure: PlacedCameras, recording: Recording, config: LocalizationConfig) -> Localization:
    """Return path and landmarks of photographs in the CRS of the recording.

    Raises
    ------
    InputError
        Fewer than four of the placed photographs have a fix.
    """
    assert recording.camera is not None
    assert recording.frames is not None
    time_s = recording.frames.time_s[structure.image]
    ground = replace(recording.gps, position=recording.gps.position - [0.0, 0.0, recording.antenna_height_m])
    fixes = fixes_of(ground, time_s, fix_errors(ground, config))
    if len(fixes.photo) < _LEAST_FIXES:
        raise InputError(
            f"{len(fixes.photo)} of the {len(time_s)} photographs that could be placed have a fix within {_NEAR_S:g} s; "
            f"at least {_LEAST_FIXES} are needed; give more fixes, or photographs that overlap more."
        )
    spread_m = _spread(fixes.position[:, :2])
    if spread_m < _LEAST_SPREAD_M:
        raise InputError(
            f"the fixes of the photographs scatter by {spread_m:.1f} m about their middle, too little for a scale; at least "
            f"{_LEAST_SPREAD_M:g} m are needed, or a table wheels.csv."
        )
    mount = recording.camera.T_body_camera
    placed = similarity(structure, mount[:3, :3], mount[:3, 3], fixes)
    used, config, notes = _consistent(placed, fixes, config, is_stated=recording.gps.sigma_m is not None)
    is_set = "gps_correlation_time_s" in config.model_fields_set
    placed = placed.corrected(used, config, config.gps_correlation_time_s if is_set else UNKNOWN_MEMORY_S)
    path = _trajectory(placed, time_s, recording)
    return Localization(
        path,
        _landmarks(placed, recording, config),
        n_fixes=len(fixes.photo),
        n_fixes_refused=len(fixes.photo) - len(used.photo),
        notes=(*notes, _scale_note(placed)),
    )


def _scale_note(placed: Placed) -> str:
    """Return the standard deviation of the scale, which is that of the fixes."""
    assert placed.covariance is not None
    sigma = _UNKNOWN_SCALE * float(np.sqrt(placed.covariance[-7, -7]))
    return f"the scale of the photographs has a standard deviation of {100.0 * sigma:.1f} %"


def _consistent(
    placed: Placed, fixes: PlacedFixes, config: LocalizationConfig, *, is_stated: bool
) -> tuple[PlacedFixes, LocalizationConfig, tuple[str, ...]]:
    """Return the fixes that agree with the photographs, with errors as they scatter where none were stated, and notes."""
    notes: list[str] = []
    off = (placed.bodies[fixes.photo, :3, 3] - fixes.position) / fixes.sigma_m
    scatter = _NMAD * float(np.median(np.abs(off)))
    is_set = is_stated or {"gps_white_sigma_m", "gps_bias_sigma_m"} & config.model_fields_set
    if scatter > _SCATTERED and not is_set:
        notes.append(
            f"the fixes scatter by {scatter * config.fix_sigma_m:.1f} m (1 σ) about the photographs, {scatter:.1f} times what was "
            "assumed: this error was used; --set localization.gps_white_sigma_m states it"
        )
        fixes, off = fixes._replace(sigma_m=scatter * fixes.sigma_m), off / scatter
    agrees: BoolArray = np.all(np.abs(off) < _REFUSED, axis=1)
    if agrees.sum() < _LEAST_FIXES:
        agrees[:] = True
    if not agrees.all():
        notes.append(f"{int((~agrees).sum())} fixes contradict the photographs and were left out")
    return fixes.select(agrees), config, tuple(notes)


def _corrected_bodies(placed: Placed) -> FloatArray:
    """Return the poses T_world_body (K, 4, 4) after the correction by the fixes."""
    bodies = placed.bodies.copy()
    if placed.mean is not None:
        bodies[:, :3, 3] += placed.shifts @ placed.mean
        turn = Rotation.from_rotvec(placed.turns @ placed.mean).as_matrix()
        bodies[:, :3, :3] = turn @ bodies[:, :3, :3]
    return bodies


def _headings(bodies: FloatArray) -> FloatArray:
    """Return the headings (K,) of bodies [rad]; of one that looks down that of its upper side."""
    forward, up = bodies[:, :2, 0], bodies[:, :2, 2]
    looks_down = (np.linalg.norm(forward, axis=1) < np.linalg.norm(up, axis=1))[:, None]
    ahead = np.where(looks_down, np.sign(-bodies[:, 2, 0])[:, None] * up, forward)
    headings: FloatArray = np.arctan2(ahead[:, 1], ahead[:, 0])
    return headings


def _trajectory(placed: Placed, time_s: FloatArray, recording: Recording) -> Trajectory:
    """Return the poses with their covariances, and with the error that they share."""
    bodies = _corrected_bodies(placed)
    slopes = np.concatenate([placed.shifts, _in_axes(placed.turns, _headings(bodies))], axis=1)
    flat = slopes.reshape(-1, slopes.shape[2])
    covariance = flat @ placed.covariance @ flat.T + np.diag(np.tile(_FLOOR**2, len(bodies)))
    information = cho_solve(cho_factor(covariance), np.eye(len(covariance)))
    return Trajectory(
        time_s,
        bodies[:, :3, 3],
        Rotation.from_matrix(bodies[:, :3, :3]).as_quat(canonical=True),
        placed.spread(placed.shifts),
        recording.crs,
        error=PathError(time_s, sparse.csr_array(0.5 * (information + information.T)), POSE),
    )


def _in_axes(turns: FloatArray, heading_rad: FloatArray) -> FloatArray:
    """Return turns (K, 3, m) about the vertical, about the level axis to the left of a heading (K,), and about that ahead."""
    zero, one = np.zeros_like(heading_rad), np.ones_like(heading_rad)
    cosine, sine = np.cos(heading_rad), np.sin(heading_rad)
    axes = np.stack(
        [np.stack(row, axis=1) for row in ((zero, zero, one), (-sine, cosine, zero), (cosine, sine, zero))],
        axis=1,
    )
    return np.asarray(axes @ turns, dtype=np.float64)


def ray_information(structure: PlacedCameras, rays: FloatArray) -> FloatArray:
    """Return the information (N, 3, 3) of one view each about points at the ends of rays (N, 3), in the inverse unit of these squared."""
    distance = np.linalg.norm(rays, axis=1)
    ray = rays / distance[:, None]
    weight = (structure.camera.matrix[0, 0] / (_CORRELATED * structure.pixel_sigma * distance)) ** 2
    information: FloatArray = weight[:, None, None] * (np.eye(3) - ray[:, :, None] * ray[:, None])
    return information


class _Points(NamedTuple):
    """Points (J, 3) in world axes, covariance given the poses (J, 3, 3), movement by coefficient (J, 3, m), and nearest view (J,)."""

    place: FloatArray
    own: FloatArray
    moved: FloatArray
    nearest: IntArray


def _points(placed: Placed, chosen: IntArray) -> _Points:
    r"""Return points by the normal equations of their rays.

    .. math:: Λ = Σ_n (f / (σ d_n))^2 (I - r_n r_n^T), \qquad δX = Λ^{-1} Σ_n Λ_n δX_n

    where δX_n is the movement of a point that is fixed to camera n.
    """
    s = placed.structure
    seen = s.tracks.select(chosen)
    track = np.repeat(np.arange(len(chosen)), np.diff(seen.first))
    place = placed.scale * s.points[chosen] @ placed.turn.T + placed.shift
    eyes = placed.scale * s.poses[:, :3, 3] @ placed.turn.T + placed.shift
    distance = np.linalg.norm(place[track] - eyes[seen.keyframe], axis=1)
    parts = ray_information(s, place[track] - eyes[seen.keyframe])
    own = np.linalg.inv(np.add.reduceat(parts, seen.first[:-1], axis=0))
    pulls = np.add.reduceat(parts @ placed.moved(place[track], seen.keyframe), seen.first[:-1], axis=0)
    order = np.lexsort((distance, track))
    return _Points(place, own, own @ pulls, seen.keyframe[order[seen.first[:-1]]])


class _Landmarks(NamedTuple):
    """Points (J, 3), their own and complete covariances (J, 3, 3), and the nearest camera that saw each (J,)."""

    place: FloatArray
    own: FloatArray
    total: FloatArray
    nearest: IntArray


def _landmarks(placed: Placed, recording: Recording, config: LocalizationConfig) -> SurfacePoints:
    """Return the points that pass the gates, with covariances of features, photographs and fixes.

    A point counts as fixed to the nearest camera that saw it; what it moves by beside that is its own.
    """
    tracks = placed.structure.tracks
    views = np.flatnonzero(np.diff(tracks.first) >= _LEAST_VIEWS)
    parts = [
        _gated(placed, _points(placed, views[start : start + _AT_ONCE]), config)
        for start in range(0, len(views), _AT_ONCE)
    ]
    if not any(len(part.place) for part in parts):
        raise InputError(
            f"none of {len(views)} points that at least {_LEAST_VIEWS} photographs show passes the gate (1σ ≤ "
            f"{config.landmark_max_sigma_m} m); loosen localization.landmark_max_sigma_m (--set)."
        )
    nearest = np.concatenate([part.nearest for part in parts])
    place = np.concatenate([part.place for part in parts])
    bodies = _corrected_bodies(placed)
    eyes = bodies[:, :3, 3] + bodies[:, :3, :3] @ placed.lever_m
    return SurfacePoints(
        place,
        covariance=np.concatenate([part.total for part in parts]),
        origins=eyes[nearest],
        body=bodies[nearest, :3, 3],
        range_m=np.linalg.norm(place - eyes[nearest], axis=1),
        crs=recording.crs,
        vertical_datum=recording.vertical_datum,
        own_covariance=np.concatenate([part.own for part in parts]),
        keyframe=nearest.astype(np.float64),
        heading_rad=_headings(bodies)[nearest],
    )


def _gated(placed: Placed, points: _Points, config: LocalizationConfig) -> _Landmarks:
    """Return the points whose own covariance passes the gate."""
    assert placed.mean is not None
    apart = points.own + placed.spread(points.moved - placed.moved(points.place, points.nearest))
    keep = np.linalg.eigvalsh(apart)[:, -1] <= config.landmark_max_sigma_m**2
    moved = points.moved[keep]
    place = points.place[keep] + moved @ placed.mean
    return _Landmarks(place, apart[keep], points.own[keep] + placed.spread(moved), points.nearest[keep])
