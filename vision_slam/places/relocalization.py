"""Alignment of visual odometry with the fixes, and relocalization of segments after a gap that no sensor bridges.

`align_heading` rotates odometry without gaps to the heading of the fixes.

Wheels and gyro bridge a loss of vision. Where they have a gap too, because the rover was
carried or switched off, the odometry is interrupted: the segment after the gap has the right
shape, and its position and heading are unobservable. Each segment is aligned with its fixes, or with
ground that it shares with earlier segments. A segment that neither can place is marked lost.

This needs the complete drive. On board, `vision_slam.odometry.resection` finds the last view
where the rover still stands in front of it; otherwise the filter depends on fixes.
"""

from dataclasses import dataclass, replace

import numpy as np

from survey.core import FloatArray, IntArray
from survey.data.recording import OdometryRecording, Recording
from survey.data.sensors.odometry import Odometry
from vision_slam.attitude import heading_correction, rotations
from vision_slam.motion import dead_reckoning
from vision_slam.odometry.odometer import VisualOdometry
from vision_slam.places.ground_view import GroundMosaics, Overlay, match_overlay
from vision_slam.readers.sequence import VisionRecords

_HOLE_S = 1.5  # longer gaps of images that wheels and gyro do not bridge interrupt the odometry
_FORGOTTEN_S = 5.0
_FREE_M, _FREE_RAD = 300.0, np.pi  # errors of the step and turn over a gap, which nothing measured
_FIX_M = 2.0  # error of fixes; over their extent it is the error of the heading
_LEAST_FIXES = 5
_LONG_ENOUGH_M = 10.0
_LEAST_AGREE = 40
_KEY_SPACING_M = 1.0
_SEARCHED_M = 40.0
_OVERLAY_RAD = np.radians(3.0)


def segment_starts(recording: VisionRecords, visual: VisualOdometry) -> IntArray:
    """Return the indices of the frames after a gap that no sensor bridges.

    The wheels have a gap of more than 1.5 s, and the images recognized no earlier view, or
    cannot have.
    """
    times = visual.odometry.time_s
    gap = np.diff(times)
    counted = np.zeros(0) if recording.wheels is None else recording.wheels.time_s
    starts = []
    for k in (np.flatnonzero(gap > _HOLE_S) + 1).tolist():
        inside = counted[(counted > times[k - 1]) & (counted < times[k])]
        hole = float(np.diff(np.concatenate([times[k - 1 : k], inside, times[k : k + 1]])).max())
        health = visual.health[k]
        is_too_long = gap[k - 1] > _FORGOTTEN_S and not health.is_recognized
        if hole > _HOLE_S and (is_too_long or not health.is_visual):
            starts.append(k)
    return np.array(starts, dtype=np.int64)


def align_heading(recording: Recording, visual: VisualOdometry) -> tuple[OdometryRecording, VisualOdometry]:
    """Rotate visual odometry to the heading of the fixes; place the segments of an interrupted one."""
    if len(segment_starts(recording, visual)):
        visual = relocalize_segments(recording, visual)
    else:
        odometry = visual.odometry
        path = dead_reckoning(odometry, recording.start)
        turn_rad = heading_correction(path, odometry.time_s, recording.gps)
        attitude_rad = odometry.attitude_rad + [0.0, 0.0, turn_rad]
        visual = replace(visual, odometry=replace(odometry, attitude_rad=attitude_rad))
    return recording.with_odometry(visual.odometry, visual.sightings), visual


def relocalize_segments(recording: Recording, visual: VisualOdometry) -> VisualOdometry:
    """Align every segment with its fixes or with ground seen before; return one odometry.

    The step over a gap has a standard deviation of 300 m, so that fixes and loop closures are
    not used twice. A segment that could not be placed has an unknown heading and is lost.
    """
    starts = segment_starts(recording, visual)
    odometry, is_lost = visual.odometry, visual.is_lost.copy()
    if len(starts) == 0:
        return visual
    n = len(odometry.time_s)
    step_sigma, turn_sigma = (
        np.zeros(n - 1) if sigma is None else sigma.copy()
        for sigma in (odometry.step_sigma_m, odometry.turn_sigma_rad)
    )
    ends = [*starts[1:].tolist(), n]
    odometry = _rotated(odometry, 0, _first_turn(recording, odometry, int(starts[0])))
    for first, end in zip(starts.tolist(), ends, strict=True):
        alignment = _align_with_fixes(recording, odometry, first, end)
        if alignment is None:
            alignment = _align_with_ground(recording, odometry, visual, first, end)
        if alignment is None:
            is_lost[first:end] = True
            step_sigma[first - 1], turn_sigma[first - 1] = _FREE_M, _FREE_RAD
            continue
        odometry = _moved(odometry, recording.start, first, alignment)
        step_sigma[first - 1], turn_sigma[first - 1] = _FREE_M, alignment.sigma_rad
    odometry = replace(odometry, step_sigma_m=step_sigma, turn_sigma_rad=turn_sigma)
    return replace(visual, odometry=odometry, is_lost=is_lost)


@dataclass(frozen=True)
class _Alignment:
    """Position of the start of a segment (3,) [m] in the world, its rotation, and the error of that."""

    place: FloatArray
    turn_rad: float
    sigma_rad: float


def _first_turn(recording: Recording, odometry: Odometry, end: int) -> float:
    """Return the rotation of the first segment that its fixes ask for; none for a single pose, which has no heading."""
    if end < 2:
        return 0.0
    first = Odometry(odometry.time_s[:end], odometry.step[: end - 1], odometry.attitude_rad[:end])
    turn = heading_correction(dead_reckoning(first, recording.start), first.time_s, recording.gps)
    alignment = None if turn else _align_with_fixes(recording, odometry, 0, end)
    return turn if alignment is None else alignment.turn_rad


def _align_with_fixes(recording: Recording, odometry: Odometry, first: int, end: int) -> _Alignment | None:
    """Align a segment with its fixes by rotation and shift; None for too few fixes or too short a segment."""
    times, gps = odometry.time_s[first:end], recording.gps
    inside = (gps.time_s >= times[0]) & (gps.time_s <= times[-1])
    if inside.sum() < _LEAST_FIXES:
        return None
    path = dead_reckoning(odometry, np.zeros(3))[first:end]
    path = path - path[0]
    moved = np.column_stack([np.interp(gps.time_s[inside], times, axis) for axis in path.T])
    fixed = gps.position[inside] - [0.0, 0.0, recording.antenna_height_m]
    z, g = (place[:, 0] + 1j * place[:, 1] for place in (moved, fixed))
    reach = float(np.abs(z - z.mean()).max())
    if reach < 0.5 * _LONG_ENOUGH_M:
        return None
    turn = float(np.angle(((g - g.mean()) * (z - z.mean()).conj()).sum()))
    corner = g.mean() - np.exp(1j * turn) * z.mean()
    place = np.array([corner.real, corner.imag, float(np.mean(fixed[:, 2] - moved[:, 2]))])
    return _Alignment(place, turn, min(_FIX_M / reach, 1.0))


def _align_with_ground(
    recording: Recording, odometry: Odometry, visual: VisualOdometry, first: int, end: int
) -> _Alignment | None:
    """Align a segment with ground seen before it; None where nothing is recognized."""
    if recording.frames is None or recording.camera is None:
        return None
    path = dead_reckoning(odometry, recording.start)
    mosaics = GroundMosaics(recording.frames, recording.camera, path, odometry, visual.sightings)
    met = match_ground(mosaics, np.arange(first), np.arange(first, end))
    if met is None:
        return None
    earlier, later, overlay = met
    level = mosaics.level(earlier)
    heading = np.arctan2(level[1, 0], level[0, 0]) + overlay.turn_rad
    turn = float(heading - odometry.attitude_rad[later, 2])
    arm = _about_up(turn) @ (path[first] - path[later])
    return _Alignment(path[earlier] + level @ overlay.shift + arm, turn, _OVERLAY_RAD)


def match_ground(
    mosaics: GroundMosaics, known: IntArray, unknown: IntArray
) -> tuple[int, int, Overlay] | None:
    """Match the ground seen from the unknown poses with that of the known poses.

    The position of the unknown poses is not used: each of the first 40 m is compared with all
    known ones, a metre apart. At least 40 features must agree with one rotation and shift on
    level ground, a number that chance never reached on development drives. None where fewer do.
    """
    unknown = unknown[mosaics.travel_m[unknown] - mosaics.travel_m[unknown[0]] < _SEARCHED_M]
    views = [mosaics.around(pose) for pose in _spaced(mosaics, unknown)]
    best: tuple[int, int, Overlay] | None = None
    for pose in _spaced(mosaics, known):
        earlier = mosaics.around(pose)
        for view in views:
            overlay = match_overlay(earlier, view)
            if overlay is not None and overlay.n_agree >= (best[2].n_agree + 1 if best else _LEAST_AGREE):
                best = pose, view.pose, overlay
    return best


def _spaced(mosaics: GroundMosaics, poses: IntArray) -> list[int]:
    """Return the poses a metre of travel apart."""
    metre = (mosaics.travel_m[poses] / _KEY_SPACING_M).astype(int)
    spaced: list[int] = poses[np.unique(metre, return_index=True)[1]].tolist()
    return spaced


def _moved(odometry: Odometry, start: FloatArray, first: int, alignment: _Alignment) -> Odometry:
    """Move and rotate a segment to its aligned start."""
    odometry = _rotated(odometry, first, alignment.turn_rad)
    before = dead_reckoning(odometry, start)[first - 1]
    step = odometry.step.copy()
    step[first - 1] = rotations(odometry.attitude_rad[first - 1 : first])[0].T @ (alignment.place - before)
    return replace(odometry, step=step)


def _rotated(odometry: Odometry, first: int, turn_rad: float) -> Odometry:
    """Rotate everything from a frame on about the vertical."""
    attitude = odometry.attitude_rad.copy()
    attitude[first:, 2] += turn_rad
    return replace(odometry, attitude_rad=attitude)


def _about_up(angle_rad: float) -> FloatArray:
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
