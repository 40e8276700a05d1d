"""Checks of gyro, wheels and mounting against the motion that the images show.

`largest_turns` estimates turns between images by epipolar geometry. `refuse_other_gyro` compares them with the gyro, and
refuses exchanged axes, signs and units. `refuse_other_travel` compares the direction of travel with the mounting while the
wheels roll straight, and `mounting_note` the side on which the ground lies. Few or contradictory pairs of images give no result.
"""

from typing import Any, NamedTuple

import cv2
import numpy as np
from scipy.optimize import lsq_linear
from scipy.spatial.transform import Rotation

from survey import Camera, InputError
from survey.core import FloatArray
from survey.data.frames import Frames, Image
from survey.data.sensors.records import Inertial, Wheels
from vision_slam.config import VisualOdometryConfig
from vision_slam.odometry.tracks import ContrastEnhancer, detect, epipolar_motion, grey_of, track_corners

_LEAST_S, _MOST_S = 0.2, 1.5  # between two images; a faster camera turns too little from image to image
_PER_SIDE = 6  # pairs of images with the largest turns to either side about each axis
LEAST_CORNERS, LEAST_AGREE = 25, 0.5
"""Corners that must be tracked, and the share of them that must agree with one motion."""
_MOST_LINES = 300
# Cosine of the angle to the optical axis beyond which a corner has no place on the plane z = 1.
_LEAST_AHEAD = 0.2
_MOST_TRIALS = 300  # of RANSAC: images of noise shall cost little


class ImageTurns(NamedTuple):
    """Turns of the body between pairs of images.

    ``seconds`` (N,), ``by_images`` and ``by_gyro`` (N, 3) rotation vectors in axes of the body [rad].
    """

    seconds: FloatArray
    by_images: FloatArray
    by_gyro: FloatArray


def largest_turns(
    frames: Frames, camera: Camera, inertial: Inertial, config: VisualOdometryConfig
) -> ImageTurns:
    """Return the turns of the pairs of images between which the gyro turns most, about each axis to either side.

    Corners are tracked without any prediction; their epipolar geometry gives the turn. Pairs of the same image, and those
    of which too few corners agree, are left out.
    """
    mount = Rotation.from_matrix(camera.T_body_camera[:3, :3])
    rows = []
    for first, last, by_gyro in _chosen(_gyro_turns(frames.time_s, inertial)):
        rays = tracked_rays(camera, frames[first], frames[last], config)
        turn = None if rays is None else _turn_between(*rays, ray_error_rad(camera))
        if turn is not None:
            seconds = float(frames.time_s[last] - frames.time_s[first])
            rows.append((seconds, (mount * turn * mount.inv()).as_rotvec(), by_gyro))
    columns = list(zip(*rows, strict=True)) or [(), (), ()]
    return ImageTurns(np.array(columns[0]), *(np.array(part).reshape(-1, 3) for part in columns[1:]))


def tracked_rays(
    camera: Camera, before: Image, now: Image, config: VisualOdometryConfig
) -> tuple[FloatArray, FloatArray] | None:
    """Return the unit rays (N, 3) of corners that are tracked from one image to another without any prediction.

    Images of more than 300 lines are halved first: a check needs no more, and takes half of the time. None for the same image
    twice, and for fewer than 25 corners.
    """
    first, second = (grey_of(image, camera.width, camera.height) for image in (before, now))
    if np.array_equal(first, second):
        return None
    enhance = ContrastEnhancer(config.clahe_clip, config.clahe_tiles)
    factor = 1.0
    if camera.height > _MOST_LINES:
        factor = 2.0  # cv2.pyrDown keeps every other pixel where it is
        first, second = (np.asarray(cv2.pyrDown(image), dtype=np.uint8) for image in (first, second))
    first, second = enhance(first), enhance(second)
    pixels = detect(first, np.zeros((0, 2), np.float32), config.n_features, config)
    landed, came = track_corners(first, second, pixels, pixels.copy(), config)
    rays = [camera.rays(factor * at[came].astype(np.float64)) for at in (pixels, landed)]
    is_ahead = (rays[0][:, 2] > _LEAST_AHEAD) & (rays[1][:, 2] > _LEAST_AHEAD)
    return (rays[0][is_ahead], rays[1][is_ahead]) if is_ahead.sum() >= LEAST_CORNERS else None


def ray_error_rad(camera: Camera) -> float:
    """Return the angle of a pixel at the middle of the image [rad]."""
    return 2.0 / float(camera.matrix[0, 0] + camera.matrix[1, 1])


def image_pairs(time_s: FloatArray) -> list[tuple[int, int]]:
    """Return for each image the first one that is a fifth of a second or more later, where one is within 1.5 s."""
    ends = np.searchsorted(time_s, time_s + _LEAST_S - 1e-6).tolist()
    return [
        (first, end)
        for first, end in enumerate(ends)
        if end < len(time_s) and time_s[end] - time_s[first] <= _MOST_S
    ]


def _turn_between(before: FloatArray, now: FloatArray, angle: float) -> Rotation | None:
    """Return the turn of the camera by the epipolar geometry of rays (N, 3); None where too few agree.

    Of the two rotations that an essential matrix has, the other one includes half a turn.
    """
    first, second = (np.ascontiguousarray(rays[:, :2] / rays[:, 2:]) for rays in (before, now))
    cv2.setRNGSeed(0)  # RANSAC draws; the same images shall give the same result
    found: Any = cv2.findEssentialMat(first, second, np.eye(3), cv2.RANSAC, 0.999, angle, _MOST_TRIALS)
    if found[1] is None or found[1].sum() < max(LEAST_CORNERS, LEAST_AGREE * len(first)):
        return None
    both = [Rotation.from_matrix(turn.T) for turn in cv2.decomposeEssentialMat(found[0][:3])[:2]]
    return min(both, key=lambda turn: float(turn.magnitude()))


def _gyro_turns(time_s: FloatArray, inertial: Inertial) -> list[tuple[int, int, FloatArray]]:
    """Return pairs of images that the readings cover, and the integral of the gyro between them (3,) [rad].

    Each reading is the mean rate over the time before it. The integral has no full circles, which rates in degrees would make.
    """
    seconds = np.diff(inertial.time_s)[:, None]
    total = np.vstack([np.zeros(3), np.cumsum(inertial.gyro_rad_s[1:] * seconds, axis=0)])
    at = np.column_stack([np.interp(time_s, inertial.time_s, axis) for axis in total.T])
    is_covered = (time_s >= inertial.time_s[0]) & (time_s <= inertial.time_s[-1])
    return [
        (first, end, at[end] - at[first])
        for first, end in image_pairs(time_s)
        if is_covered[first] and is_covered[end]
    ]


def _chosen(pairs: list[tuple[int, int, FloatArray]]) -> list[tuple[int, int, FloatArray]]:
    """Return the pairs with the largest turns to either side about each axis, in the order of time."""
    if not pairs:
        return []
    order = np.argsort([turn for _, _, turn in pairs], axis=0, kind="stable")
    chosen = np.unique(np.r_[order[:_PER_SIDE], order[-_PER_SIDE:]])
    return [pairs[k] for k in chosen.tolist()]


_AXES = "xyz"
_LEAST_TURN_RAD, _LEAST_TURNS = np.radians(0.5), 8
# What does not count as a contradiction: scale and misalignment of the gyro, its bias.
_SCALE, _ASIDE, _BIAS_RAD_S = (0.7, 1.4), 0.3, np.radians(1.0)
# Shares of the turn by images that the gyro as stated must leave unexplained, and that another reading must explain.
_CONTRADICTED, _EXPLAINED_TURN = 0.5, 0.8
_GYRO_ROUNDS, _LEAST_RESIDUAL_RAD = 5, np.radians(0.02)


class _Reading(NamedTuple):
    """Another reading of the gyro: the axis that an axis of the body is, and the factor."""

    axis: int
    factor: float


def refuse_other_gyro(turns: ImageTurns) -> None:
    r"""Refuse a gyro with an axis reversed or exchanged, or in degrees per second, that the images contradict.

    About an axis j of the body, the turns by images v and those by gyro g of good records agree as

    .. math:: v_j = a g_j + c_k g_k + c_l g_l + b t

    with the scale a within 0.7 and 1.4, misalignments |c| below 0.3 and a bias |b| below 1 degree per second. The gyro is
    refused where the best of these leaves half of the turns unexplained, and the same with another axis, sign or unit
    explains 80 %. Without eight turns of half a degree about an axis nothing is said about it.

    >>> turn = np.radians(np.outer(np.linspace(-4.0, 4.0, 12), [0.0, 0.0, 1.0]))
    >>> refuse_other_gyro(ImageTurns(np.full(12, 0.25), turn, turn))
    >>> refuse_other_gyro(ImageTurns(np.full(12, 0.25), turn, -turn))
    Traceback (most recent call last):
    ...
    survey.core.errors.InputError: in 10 turns of up to 4.0° the images turn about z as the gyro does about -z; ...
    """
    found = {axis: reading for axis in range(3) if (reading := _other_reading(turns, axis)) is not None}
    if not found:
        return
    n = sum(bool(np.abs(turn[list(found)]).max() >= _LEAST_TURN_RAD) for turn in turns.by_images)
    most_deg = float(np.degrees(np.abs(turns.by_images[:, list(found)]).max()))
    where = f"in {n} turns of up to {most_deg:.1f}°"
    factor = next((reading.factor for reading in found.values() if abs(reading.factor) != 1.0), None)
    if factor is not None:
        raise InputError(
            f"{where} the images turn by {factor:.3g} of what the gyro does; its rates must be in radians per second: "
            f"multiply them by {factor:.6g}."
        )
    ours = ", ".join(_AXES[axis] for axis in found)
    theirs = ", ".join(("-" if other.factor < 0.0 else "") + _AXES[other.axis] for other in found.values())
    raise InputError(
        f"{where} the images turn about {ours} as the gyro does about {theirs}; turn the inertial readings into the axes of "
        "the body, x forward, y left, z up, or correct T_body_camera of the camera."
    )


def _other_reading(turns: ImageTurns, axis: int) -> _Reading | None:
    """Return the reading that explains the turns about an axis where the stated one does not; None without a contradiction."""
    is_turn = np.abs(turns.by_images[:, axis]) >= _LEAST_TURN_RAD
    if is_turn.sum() < _LEAST_TURNS:
        return None
    used = ImageTurns(*(part[is_turn] for part in turns))
    if _explained(used, axis, _Reading(axis, 1.0)) > _CONTRADICTED:
        return None
    others = [_Reading(axis, -1.0), _Reading(axis, np.pi / 180.0), _Reading(axis, 180.0 / np.pi)]
    others += [_Reading(other, sign) for other in range(3) if other != axis for sign in (1.0, -1.0)]
    shares = [_explained(used, axis, other) for other in others]
    best = int(np.argmax(shares))
    return others[best] if shares[best] >= _EXPLAINED_TURN else None


def _explained(turns: ImageTurns, axis: int, reading: _Reading) -> float:
    """Return the share of the turns by images about an axis that a reading of the gyro explains, in sums of absolute values."""
    by_images = turns.by_images[:, axis]
    design = np.column_stack([reading.factor * turns.by_gyro, turns.seconds])
    least, most = np.r_[np.full(3, -_ASIDE), -_BIAS_RAD_S], np.r_[np.full(3, _ASIDE), _BIAS_RAD_S]
    least[reading.axis], most[reading.axis] = _SCALE
    weight: FloatArray = np.ones(len(by_images))
    for _ in range(_GYRO_ROUNDS):  # the least sum of absolute residuals, by weights
        found = lsq_linear(weight[:, None] * design, weight * by_images, (least, most))
        residual = np.abs(design @ found.x - by_images)
        weight = np.maximum(residual, _LEAST_RESIDUAL_RAD) ** -0.5
    return float(1.0 - residual.sum() / np.abs(by_images).sum())


_MOST_STRAIGHT_PAIRS, _LEAST_STRAIGHT_PAIRS = 12, 8
_LEAST_M, _LEAST_SHARE = 0.05, 0.3  # between two images, also of the most between any two
_STRAIGHT = 0.1  # of the travel: the most that left and right differ by
# Cosines: pairs of images that agree with their median, how many must, and what a mounting may be off by.
_ALIKE, _MANY, _AHEAD = 0.8, 0.8, np.cos(np.radians(30.0))
_SIDES = (("ahead", "backward"), ("to the left", "to the right"), ("up", "down"))


def refuse_other_travel(frames: Frames, camera: Camera, wheels: Wheels, config: VisualOdometryConfig) -> None:
    """Refuse wheels and a mounting with which the images do not travel ahead while the wheels roll ahead.

    The direction of travel is that of the epipolar geometry of pairs of images between which the wheels roll straight. Fewer
    than eight such pairs, or pairs that do not agree with each other, say nothing.
    """
    found = _directions(frames, camera, wheels, config)
    if len(found) < _LEAST_STRAIGHT_PAIRS:
        return
    median = np.median(found, axis=0)
    median /= max(float(np.linalg.norm(median)), 1e-9)
    n = int((found @ median > _ALIKE).sum())
    if n < _MANY * len(found) or median[0] > _AHEAD:
        return
    axis = int(np.argmax(np.abs(median)))
    side = _SIDES[axis][int(median[axis] < 0.0)]
    angle_deg = float(np.degrees(np.arccos(median[0])))
    wheels_remedy = "change the sign of left_m and right_m, or " if median[0] < -_AHEAD else ""
    raise InputError(
        f"while the wheels roll ahead the images travel {angle_deg:.0f}° from ahead, {side}, in {n} of {len(found)} pairs of "
        f"images; {wheels_remedy}correct T_body_camera of the camera, which takes x right, y down, z forward of the camera "
        "to x forward, y left, z up of the body."
    )


def _directions(frames: Frames, camera: Camera, wheels: Wheels, config: VisualOdometryConfig) -> FloatArray:
    """Return the directions (N, 3) of travel in the body, for wheels that roll ahead."""
    found = []
    for first, last, sign in _straight_pairs(frames.time_s, wheels):
        rays = tracked_rays(camera, frames[first], frames[last], config)
        if rays is None:
            continue
        motion, agree = epipolar_motion(*rays, ray_error_rad(camera))
        if agree.sum() >= max(LEAST_CORNERS, LEAST_AGREE * len(agree)):
            found.append(sign * camera.T_body_camera[:3, :3] @ motion[:3, 3])
    return np.array(found).reshape(-1, 3)


def _straight_pairs(time_s: FloatArray, wheels: Wheels) -> list[tuple[int, int, float]]:
    """Return pairs of images between which the wheels roll straight, and the sign of their travel."""
    pairs = np.array(image_pairs(time_s), dtype=int).reshape(-1, 2)
    left, right = (np.interp(time_s, wheels.time_s, side) for side in (wheels.left_m, wheels.right_m))
    left, right = (side[pairs[:, 1]] - side[pairs[:, 0]] for side in (left, right))
    rolled = np.abs(0.5 * (left + right))
    least_m = max(_LEAST_M, _LEAST_SHARE * float(rolled.max(initial=0.0)))
    straight = np.flatnonzero((rolled >= least_m) & (np.abs(right - left) < _STRAIGHT * rolled))
    if len(straight) == 0:
        return []
    chosen = straight[np.unique(np.linspace(0, len(straight) - 1, _MOST_STRAIGHT_PAIRS).astype(int))]
    return [(*pairs[k].tolist(), float(np.sign(left[k] + right[k]))) for k in chosen]


_LEAST_LANDMARKS, _PLANE_ROUNDS = 200, 10
_EXPLAINED_BY_PLANE = 0.3  # share of the scatter of inverse distances that a plane must explain
_ACROSS, _OTHER_SIDE = (
    0.6,
    -0.5,
)  # share of the normal across the optical axis; cosine to where the ground is mounted
_HIGHEST = 0.15  # sine of the elevation of the optical axis above which a ceiling is looked at


def mounting_note(offset: FloatArray, T_body_camera: FloatArray) -> str | None:
    r"""Return a note where the plane of the landmarks lies above a camera that does not look up.

    Points x = r d of a plane have inverse distances that are linear in the direction d,

    .. math:: 1 / r = n \cdot d

    with n towards the plane. Of a camera that is mounted upside down n points up. Among walls no plane explains the distances,
    and nothing is said.

    `offset` (N, 3): landmarks relative to the camera, in axes of the body and in any unit. `T_body_camera`
    (4, 4): mounting.

    >>> rng = np.random.default_rng(1)
    >>> ground = np.column_stack([rng.uniform(2.0, 5.0, 300), rng.uniform(-2.0, 2.0, 300), np.full(300, -1.0)])
    >>> level = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 1], [0, 0, 0, 1]])
    >>> mounting_note(ground, level)
    >>> mounting_note(ground * [1.0, 1.0, -1.0], level)
    'the ground lies above the camera by 300 landmarks: ...'
    """
    axis = T_body_camera[:3, 2]
    if len(offset) < _LEAST_LANDMARKS or axis[2] > _HIGHEST:
        return None
    normal, explained = _fitted_plane(offset)
    across = normal - axis * (normal @ axis)
    down = np.array([0.0, 0.0, -1.0]) + axis * axis[2]
    size = float(np.linalg.norm(across))
    if explained < _EXPLAINED_BY_PLANE or size < _ACROSS * np.linalg.norm(normal):
        return None
    if across @ down > _OTHER_SIDE * size * np.linalg.norm(down):
        return None
    return (
        f"the ground lies above the camera by {len(offset)} landmarks: it seems to be mounted upside down, and T_body_camera "
        "says otherwise; correct it, or turn the images"
    )


def _fitted_plane(offset: FloatArray) -> tuple[FloatArray, float]:
    """Return the normal (3,) over the distance of the plane, and the share of inverse distances explained, of least absolute sums."""
    inverse = 1.0 / np.maximum(np.linalg.norm(offset, axis=1), 1e-12)
    direction = offset * inverse[:, None]
    weight = np.ones(len(inverse))
    for _ in range(_PLANE_ROUNDS):
        normal = np.linalg.lstsq(weight[:, None] * direction, weight * inverse, rcond=None)[0]
        residual = np.abs(direction @ normal - inverse)
        weight = np.maximum(residual, 1e-3 * np.median(inverse)) ** -0.5
    scatter = float(np.abs(inverse - np.median(inverse)).sum())
    return normal, 1.0 - float(residual.sum()) / max(scatter, 1e-12)
