"""Self-calibration of radial distortion and focal length over the tracks of a drive."""

from dataclasses import dataclass, replace

import numpy as np

from survey import Camera
from survey.core import BoolArray, DataObject, FloatArray, IntArray
from vision_slam.config import VisualOdometryConfig
from vision_slam.odometry.bundle_adjustment import (
    Adjusted,
    BundleAdjustment,
    Geometry,
    LensChange,
    PixelObservations,
    Travel,
)
from vision_slam.odometry.landmarks import intersected
from vision_slam.odometry.tracks import Track

# Prior errors of the logarithm of the focal length, of k1 and of k2: of a calibration whose distortion is unknown,
# and of one whose focal length is too.
_CALIBRATED, _ANY_LENS = np.array([0.01, 0.2, 0.1]), np.array([0.2, 0.2, 0.1])
# Corners creep together, which independent pixel errors do not describe: the lenses of two drives with
# cameras of one make differ by so many of their formal standard deviations.
_CORRELATED = 5.0
_LEAST_TURN_DEG = 20.0
_SIGNIFICANT = 7.81  # squared Mahalanobis distance from the given lens (χ² with 3 degrees, 95 %)
_LEAST_GAIN = 50.0  # decrease of the cost by another focal length; by chance it is 1
_N_NEAR = 25  # steps, after which the lens hardly changes
_LEAST_BORDER_PX = 1.0  # below, the given lens is good enough
_LEAST_UNSTATED_PX = 0.5  # the same where nothing states the distortion: the estimate is then the better one
_WELL_ABOVE = 0.5  # of the prior's error, below which that of the estimate must be
_N_PROBED = 5  # steps after which a focal length that is off shows
_LEAST_FOCAL = 0.05  # a smaller change of the focal length is less certain than a calibration
_UNCHANGED = LensChange()
_MOST_KEYFRAMES, _MOST_OBSERVATIONS = 240, 150  # of the part of the drive that is used; of one keyframe
_LEAST_SIGHTS, _LEAST_TRACKS = 3, 50
_FIRST_GATE_PX, _FIRST_DEPTH_SIGMA = 8.0, 0.3
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
    image [pixels]. `turned_deg`: largest turn within the part of the drive that was used [deg].
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
    tracks: list[Track],
    rolled_m: FloatArray,
    config: VisualOdometryConfig,
    *,
    used: LensChange = _UNCHANGED,
) -> LensEstimate:
    """Estimate the lens by bundle adjustment over the keyframes of a drive.

    In a turn points cross the image, and unmodelled distortion changes their parallax: the scale
    drifts, by 24 to 28 % in turns of 90 degrees under a lens that is 10 pixels off at the border. The
    same turn makes the lens observable; straight motion along the optical axis does not. A
    lens is accepted where the drive turns by 20 degrees, where its errors fall well below
    those of the prior, and where it differs significantly from the given one. The focal length has a prior error of 1 %, or
    of 20 % where the images demand a change of more than 5 %.

    `poses` (K, 4, 4): poses of the body at the keyframes. `rolled_m` (K - 1,): travel by wheels between
    keyframes [m], NaN where unknown.
    """
    part = _most_turning(poses)
    turned_deg = float(_turned_deg(poses[part]).max())
    if turned_deg < _LEAST_TURN_DEG:
        return unknown_lens(camera, poses, f"the drive turns by {turned_deg:.0f}°")
    seen, start = _prepared(used.applied(camera), poses[part], tracks, part.start)
    start = start._replace(lens=used)
    if len(start.points) < _LEAST_TRACKS:
        return unknown_lens(camera, poses, f"{len(start.points)} corners have a known depth")
    rolled = np.abs(rolled_m[part.start : part.stop - 1])
    travel = Travel(rolled, config.wheel_sigma * rolled + 0.002)

    def adjustment(prior: FloatArray) -> BundleAdjustment:
        return BundleAdjustment(camera, seen, config.pixel_sigma, prior / _CORRELATED, travel)

    if abs(used.log_focal) > _LEAST_FOCAL:
        return _judged(camera, poses, adjustment(_ANY_LENS).solve(start), turned_deg)
    near = adjustment(_CALIBRATED).solve(start, _N_NEAR)
    return _judged(camera, poses, _with_focal_length(near, adjustment(_ANY_LENS)), turned_deg)


def _with_focal_length(near: Adjusted, adjustment: BundleAdjustment) -> Adjusted:
    """Estimate any focal length; return the lens near the given one where it differs by less than 5 %."""
    probe = adjustment.solve(near.geometry, _N_PROBED)
    if abs(probe.geometry.lens.log_focal) < 0.5 * _LEAST_FOCAL:
        return near
    free = adjustment.solve(probe.geometry)
    is_other = abs(free.geometry.lens.log_focal) > _LEAST_FOCAL and near.cost - free.cost > _LEAST_GAIN
    return free if is_other else near


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


def _judged(camera: Camera, poses: FloatArray, found: Adjusted, turned_deg: float) -> LensEstimate:
    """Accept an estimate, or state why the given lens is used."""
    lens = found.geometry.lens
    covariance = _CORRELATED**2 * found.covariance
    sigma = np.sqrt(np.diag(covariance))
    estimated = lens.applied(camera)
    if (sigma > _WELL_ABOVE * _ANY_LENS).any() or not _is_one_to_one(estimated):
        return unknown_lens(camera, poses, "its errors are hardly below those of the prior")
    border_px = _border_px(camera, estimated)
    is_other = float(np.array(lens) @ np.linalg.solve(covariance, np.array(lens))) > _SIGNIFICANT
    if border_px > _LEAST_BORDER_PX and not (is_other or camera.distortion_is_assumed):
        reason = f"the images contradict it by {border_px:.1f} px at the border, which is not significant"
        return unknown_lens(camera, poses, reason)
    is_accepted = border_px > (_LEAST_UNSTATED_PX if camera.distortion_is_assumed else _LEAST_BORDER_PX)
    note = f"the images agree with the lens within {border_px:.1f} px at the border"
    if is_accepted:
        note = (
            f"the images contradict the lens by {border_px:.1f} px at the border and were used with "
            f"k1 changed by {lens.k1:.4f} ± {sigma[1]:.4f}, k2 by {lens.k2:.4f} ± {sigma[2]:.4f}, "
            f"the focal length by {100.0 * np.expm1(lens.log_focal):.1f} ± {100.0 * sigma[0]:.1f} %"
        )
    return LensEstimate(
        estimated if is_accepted else camera,
        is_accepted,
        np.array(lens),
        sigma,
        border_px,
        turned_deg,
        _remaining_sigma(camera, poses, lens, covariance),
        note,
    )


def _remaining_sigma(camera: Camera, poses: FloatArray, lens: LensChange, covariance: FloatArray) -> float:
    """Return the relative drift of scale that the error of an estimated distortion may cause over a drive."""
    estimated, sides = lens.applied(camera), np.linalg.cholesky(covariance[1:, 1:]).T
    off_px = [
        _border_px(estimated, lens._replace(k1=lens.k1 + k1, k2=lens.k2 + k2).applied(camera))
        for k1, k2 in sides.tolist()
    ]
    focal_px = 0.5 * float(camera.matrix[0, 0] + camera.matrix[1, 1])
    return _scale_sigma(camera, poses) * float(np.linalg.norm(off_px)) / (_UNMODELLED_RAD * focal_px)


def _scale_sigma(camera: Camera, poses: FloatArray) -> float:
    """Return the relative drift of scale that a distortion assumed to be zero may cause over a drive."""
    if not camera.distortion_is_assumed:
        return 0.0
    return _SCALE_PER_RAD * float(np.radians(_turned_deg(poses).max()))


def _most_turning(poses: FloatArray) -> slice:
    """Return the part of the drive with the largest turn."""
    n = len(poses)
    starts = list(range(0, max(n - _MOST_KEYFRAMES, 0) + 1, _MOST_KEYFRAMES // 8))
    turns = [_turned_deg(poses[first : first + _MOST_KEYFRAMES]).max() for first in starts]
    first = starts[int(np.argmax(turns))]
    return slice(first, min(first + _MOST_KEYFRAMES, n))


def _turned_deg(poses: FloatArray) -> FloatArray:
    """Return the turn of each pose (K,) since the first [deg]."""
    trace = np.einsum("ij,kij->k", poses[0, :3, :3], poses[:, :3, :3])
    angles: FloatArray = np.degrees(np.arccos(np.clip(0.5 * (trace - 1.0), -1.0, 1.0)))
    return angles


def _prepared(
    camera: Camera, poses: FloatArray, tracks: list[Track], first: int
) -> tuple[PixelObservations, Geometry]:
    """Return the observations of triangulated tracks by keyframes from the `first` on, and the initial geometry."""
    eyes = poses @ camera.T_body_camera
    cut = [_cut(track, first, len(poses)) for track in tracks]
    sights = [(keyframes, rays) for keyframes, rays in cut if len(keyframes) >= _LEAST_SIGHTS]
    points, is_good = _triangulated(eyes, sights, 0.5 * float(camera.matrix[0, 0] + camera.matrix[1, 1]))
    chosen = _longest([keyframes for keyframes, _ in sights], is_good, len(eyes))
    none = (np.zeros(0, dtype=np.int64), np.zeros((0, 3)))
    used = [sights[index] for index in chosen.tolist()]
    keyframe, rays = (np.concatenate(part) for part in zip(none, *used, strict=True))
    point = np.repeat(np.arange(len(used)), [len(keyframes) for keyframes, _ in used])
    return PixelObservations(keyframe, point, camera.project(rays)), Geometry(
        eyes, points[chosen], LensChange()
    )


def _cut(track: Track, first: int, n: int) -> tuple[IntArray, FloatArray]:
    """Return keyframes, counted from the `first`, and rays of a track within `n` keyframes."""
    keyframes = np.array(track.keyframes, dtype=np.int64) - first
    inside = (keyframes >= 0) & (keyframes < n)
    return keyframes[inside], np.array(track.rays).reshape(-1, 3)[inside]


def _triangulated(
    eyes: FloatArray, sights: list[tuple[IntArray, FloatArray]], focal_px: float
) -> tuple[FloatArray, BoolArray]:
    """Return the points (T, 3) of tracks, and which of them have a known depth."""
    shape = len(sights), max((len(keyframes) for keyframes, _ in sights), default=0)
    rays, places, there = np.zeros((*shape, 3)), np.zeros((*shape, 3)), np.zeros(shape, dtype=np.bool_)
    rays[..., 2] = 1.0
    for row, (keyframes, seen) in enumerate(sights):
        n = len(keyframes)
        rays[row, :n] = np.einsum("nij,nj->ni", eyes[keyframes, :3, :3], seen)
        places[row, :n], there[row, :n] = eyes[keyframes, :3, 3], True
    if not sights:
        return np.zeros((0, 3)), np.zeros(0, dtype=np.bool_)
    points, information, error, is_good = intersected(rays, places, there)
    depth_sigma_m = 1.0 / np.sqrt(np.maximum(np.linalg.eigvalsh(information)[:, 0], 1e-12)) / focal_px
    range_m = np.linalg.norm(points - places[:, 0], axis=1)
    known = (error < _FIRST_GATE_PX / focal_px) & (depth_sigma_m < _FIRST_DEPTH_SIGMA * range_m)
    return points, is_good & known


def _longest(keyframes: list[IntArray], is_good: BoolArray, n_keyframes: int) -> IntArray:
    """Return the longest tracks, until most of their keyframes have enough observations."""
    count, chosen = np.zeros(n_keyframes), []
    for index in sorted(np.flatnonzero(is_good).tolist(), key=lambda index: -len(keyframes[index])):
        seen_by = keyframes[index]
        if (count[seen_by] < _MOST_OBSERVATIONS).mean() > 0.5:
            count[seen_by] += 1
            chosen.append(index)
    return np.array(sorted(chosen), dtype=np.int64)


def _border_px(given: Camera, estimated: Camera) -> float:
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
