"""Self-calibration of radial distortion and focal length over the tracks of a drive."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from survey import Camera
from survey.core import DataObject, FloatArray
from vision_slam.config import VisualOdometryConfig
from vision_slam.motion import RelativeMotion
from vision_slam.odometry.global_adjustment import (
    UNCHANGED,
    Adjusted,
    AdjustedPath,
    DriveTracks,
    Geometry,
    GlobalAdjustment,
    LensChange,
    MotionFactors,
    TrackPixels,
    triangulated,
)
from vision_slam.odometry.landmarks import EndedTrack
from vision_slam.odometry.tracks import Track

# Prior errors of the logarithm of the focal length, of k1 and of k2: of a calibration whose distortion is unknown,
# and of one whose focal length is too.
_CALIBRATED, _ANY_LENS = np.array([0.01, 0.2, 0.1]), np.array([0.2, 0.2, 0.1])
_HELD_OUT = 5  # every so manyth track judges the lens and is not adjusted
_LEAST_TURN_DEG = 20.0
_SIGNIFICANT = 7.81  # squared Mahalanobis distance from the given lens (χ² with 3 degrees, 95 %)
_LEAST_GAIN = 50.0  # decrease of the cost by another focal length; by chance it is 1
_LEAST_BORDER_PX = 1.0  # below, the given lens is good enough
_LEAST_UNSTATED_PX = 0.5  # the same where nothing states the distortion: the estimate is then the better one
_WELL_ABOVE = 0.5  # of the prior's error, below which that of the estimate must be
_N_PROBED = 5  # steps after which a focal length that is off shows
_LEAST_FOCAL = 0.05  # a smaller change of the focal length is less certain than a calibration
_LEAST_TRACKS = 50
# Drift of the logarithm of scale per radian of turn, measured under lenses with so much of unmodelled distortion at the
# border: 10 pixels of a focal length of 720.
_SCALE_PER_RAD, _UNMODELLED_RAD = 0.16, 10.0 / 720.0


@dataclass(frozen=True, eq=False, repr=False)
class LensEstimate(DataObject):
    """Lens estimated from the images of a drive.

    `camera`: the estimated calibration where it is accepted, else the given one. `is_accepted`: whether the
    images contradict the given lens and determine another. `lens` (3,): estimated logarithm of the factor of
    the focal length, and changes of k1 and k2. `sigma` (3,): their standard deviations; NaN where nothing was
    estimated. `border_px`: root mean square distance between estimated and given lens at the border of the
    image [pixels]. `turned_deg`: largest turn of the drive [deg].
    `scale_sigma`: relative drift of the scale that the lens may cause over the drive. `note`: the result in
    one sentence.
    """

    camera: Camera
    is_accepted: bool
    lens: FloatArray
    sigma: FloatArray
    border_px: float
    turned_deg: float
    scale_sigma: float
    note: str


def estimate_lens(
    camera: Camera,
    poses: FloatArray,
    tracks: Sequence[Track | EndedTrack],
    motions: Sequence[RelativeMotion],
    config: VisualOdometryConfig,
    *,
    used: LensChange = UNCHANGED,
) -> tuple[LensEstimate, AdjustedPath | None]:
    """Estimate the lens by global bundle adjustment of a drive; return it with the path adjusted under it.

    In a turn points cross the image, and unmodelled distortion changes their parallax: the scale
    drifts, by 24 to 28 % in turns of 90 degrees under a lens that is 10 pixels off at the border. The
    same turn makes the lens observable; straight motion along the optical axis does not. A
    lens is accepted where the drive turns by 20 degrees, where it differs significantly from the given one, and where
    every fifth track, which both adjustments leave out, fits better under it. The focal length has a prior error of 1 %,
    or of 20 % where the images demand a change of more than 5 %.

    `poses` (K, 4, 4): poses of the body at the keyframes. `motions` (K - 1,): motion by wheels and gyro between them.
    The path is None where corners are too few.
    """
    turned_deg = float(_turned_deg(poses).max())
    drive = DriveTracks.of(used.applied(camera), poses, tracks)
    if len(drive.points) < _LEAST_TRACKS:
        return unknown_lens(camera, poses, f"{len(drive.points)} corners have a known depth"), None
    factors, start = MotionFactors.of(poses, motions, config), drive.geometry(used)

    def adjustment(seen: TrackPixels, prior: FloatArray, pixel_sigma: float) -> GlobalAdjustment:
        return GlobalAdjustment(camera, seen, pixel_sigma, prior, factors)

    any_lens = adjustment(drive.seen, _ANY_LENS, config.pixel_sigma)
    if abs(used.log_focal) > _LEAST_FOCAL:
        prior, first = _ANY_LENS, any_lens.solve(start)
    else:
        near = adjustment(drive.seen, _CALIBRATED, config.pixel_sigma).solve(start)
        prior, first = _with_focal_length(near, any_lens)
    sigma = any_lens.pixel_error(first.geometry)
    final = adjustment(drive.seen, prior, sigma)
    adjusted = final.solve(first.geometry)
    path = AdjustedPath.of(final, adjusted.geometry, camera)
    if turned_deg < _LEAST_TURN_DEG:
        return unknown_lens(camera, poses, f"the drive turns by {turned_deg:.0f}°"), path
    gain = _held_out_gain(drive, start, adjusted.geometry, partial(adjustment, pixel_sigma=sigma), prior)
    return _judged(camera, poses, path, turned_deg, gain), path


def _with_focal_length(near: Adjusted, adjustment: GlobalAdjustment) -> tuple[FloatArray, Adjusted]:
    """Estimate any focal length; return prior and result, those near the given one where it differs by less than 5 %."""
    probe = adjustment.solve(near.geometry, _N_PROBED)
    if abs(probe.geometry.lens.log_focal) < 0.5 * _LEAST_FOCAL:
        return _CALIBRATED, near
    free = adjustment.solve(probe.geometry)
    is_other = abs(free.geometry.lens.log_focal) > _LEAST_FOCAL and near.cost - free.cost > _LEAST_GAIN
    return (_ANY_LENS, free) if is_other else (_CALIBRATED, near)


def _held_out_gain(
    drive: DriveTracks,
    start: Geometry,
    adjusted: Geometry,
    adjustment: Callable[[TrackPixels, FloatArray], GlobalAdjustment],
    prior: FloatArray,
) -> float:
    """Return by how much better the tracks that were left out fit under an estimated lens, over the standard error of that."""
    is_held = np.arange(len(drive.points)) % _HELD_OUT == _HELD_OUT // 2
    used, held = (drive.seen.select(np.flatnonzero(which)) for which in (~is_held, is_held))
    costs = []
    for near, errors in ((start, np.zeros(3)), (adjusted, prior)):
        fitted = adjustment(used, errors).solve(near._replace(points=near.points[~is_held])).geometry
        others = adjustment(held, errors)
        points = triangulated(fitted.poses, fitted.lens.applied(drive.camera).rays(held.pixel), held)
        costs.append(others.costs(others.with_points(fitted._replace(points=points))))
    gain = costs[0] - costs[1]
    return float(gain.sum() / max(gain.std() * len(gain) ** 0.5, 1e-9))


def unknown_lens(camera: Camera, poses: FloatArray, reason: str) -> LensEstimate:
    """Return the given lens, with the drift of scale that it may cause where its distortion was assumed."""
    assumed = "; its distortion was assumed to be zero" if camera.distortion_is_assumed else ""
    return LensEstimate(
        camera=camera,
        is_accepted=False,
        lens=np.zeros(3),
        sigma=np.full(3, np.nan),
        border_px=0.0,
        turned_deg=float(_turned_deg(poses).max()),
        scale_sigma=_scale_sigma(camera, poses),
        note=f"the lens could not be estimated: {reason}{assumed}",
    )


def _judged(
    camera: Camera, poses: FloatArray, path: AdjustedPath, turned_deg: float, gain: float
) -> LensEstimate:
    """Accept an estimate, or state why the given lens is used."""
    lens, covariance = path.lens, path.lens_covariance
    sigma = np.sqrt(np.diag(covariance))
    estimated = lens.applied(camera)
    if (sigma > _WELL_ABOVE * _ANY_LENS).any() or not _is_one_to_one(estimated):
        return unknown_lens(camera, poses, "its errors are hardly below those of the prior")
    off_px = border_px(camera, estimated)
    is_other = float(np.array(lens) @ np.linalg.solve(covariance, np.array(lens))) > _SIGNIFICANT
    if off_px > _LEAST_BORDER_PX and not (is_other or camera.distortion_is_assumed):
        reason = f"the images contradict it by {off_px:.1f} px at the border, which is not significant"
        return unknown_lens(camera, poses, reason)
    is_accepted = off_px > (_LEAST_UNSTATED_PX if camera.distortion_is_assumed else _LEAST_BORDER_PX)
    if is_accepted and gain <= 0.0:
        reason = f"corners that were left out fit no better under one that differs by {off_px:.1f} px at the border"
        return unknown_lens(camera, poses, reason)
    note = f"the images agree with the lens within {off_px:.1f} px at the border"
    if is_accepted:
        note = (
            f"the images contradict the lens by {off_px:.1f} px at the border and were used with "
            f"k1 changed by {lens.k1:.4f} ± {sigma[1]:.4f}, k2 by {lens.k2:.4f} ± {sigma[2]:.4f}, "
            f"the focal length by {100.0 * np.expm1(lens.log_focal):.1f} ± {100.0 * sigma[0]:.1f} %"
        )
    return LensEstimate(
        estimated if is_accepted else camera,
        is_accepted,
        np.array(lens),
        sigma,
        off_px,
        turned_deg,
        _remaining_sigma(camera, poses, lens, covariance),
        note,
    )


def _remaining_sigma(camera: Camera, poses: FloatArray, lens: LensChange, covariance: FloatArray) -> float:
    """Return the relative drift of scale that the error of an estimated distortion may cause over a drive."""
    estimated, sides = lens.applied(camera), np.linalg.cholesky(covariance[1:, 1:]).T
    off_px = [
        border_px(estimated, lens._replace(k1=lens.k1 + k1, k2=lens.k2 + k2).applied(camera))
        for k1, k2 in sides.tolist()
    ]
    focal_px = 0.5 * float(camera.matrix[0, 0] + camera.matrix[1, 1])
    return _scale_sigma(camera, poses) * float(np.linalg.norm(off_px)) / (_UNMODELLED_RAD * focal_px)


def _scale_sigma(camera: Camera, poses: FloatArray) -> float:
    """Return the relative drift of scale that a distortion assumed to be zero may cause over a drive."""
    if not camera.distortion_is_assumed:
        return 0.0
    return _SCALE_PER_RAD * float(np.radians(_turned_deg(poses).max()))


def _turned_deg(poses: FloatArray) -> FloatArray:
    """Return the turn of each pose (K,) since the first [deg]."""
    trace = np.einsum("ij,kij->k", poses[0, :3, :3], poses[:, :3, :3])
    angles: FloatArray = np.degrees(np.arccos(np.clip(0.5 * (trace - 1.0), -1.0, 1.0)))
    return angles


def border_px(given: Camera, estimated: Camera) -> float:
    """Return the root mean square distance of two lenses at the border of the image [pixels], where the first has rays."""
    border = _border(given)
    rays = given.rays(border)
    is_shown = np.isfinite(rays).all(axis=1)
    off = estimated.project(rays[is_shown]) - border[is_shown]
    return float(np.sqrt(np.mean((off**2).sum(axis=1))))


def _border(camera: Camera) -> FloatArray:
    """Return pixels (N, 2) along the border of an image."""
    column, row = np.linspace(0.0, camera.width - 1.0, 17), np.linspace(0.0, camera.height - 1.0, 17)
    sides = [np.column_stack([column, np.full(17, end)]) for end in (row[0], row[-1])]
    sides += [np.column_stack([np.full(17, end), row]) for end in (column[0], column[-1])]
    return np.concatenate(sides)


def _is_one_to_one(camera: Camera) -> bool:
    """Return whether pixels move outwards with the angle, along the diagonals, up to the corners of the image."""
    undistorted = replace(camera, distortion=np.zeros_like(camera.distortion))
    corners = np.array([[0.0, 0.0], [camera.width - 1.0, camera.height - 1.0]])
    for corner in undistorted.rays(corners):
        share = np.linspace(0.0, 1.0, 50)[:, None]
        line = np.column_stack([share * corner[:2] / corner[2], np.ones(50)])
        reach = np.linalg.norm(camera.project(line) - camera.matrix[:2, 2], axis=1)
        if (np.diff(reach) <= 0.0).any():
            return False
    return True
