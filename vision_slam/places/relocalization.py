"""A rover that was lost finds itself again: by fixes, or by ground that it has seen before.

Wheels and gyro bridge what images do not see. Where they have a hole too, because the rover
was carried or switched off, the path is torn: what follows keeps its shape, and its place is
anybody's guess. Each piece is then laid where its fixes say, or onto the ground that it shares
with what came before; a piece that neither can place is lost, and says so.

All this is done after the drive. On board, `recognition` finds the last view again where the rover is still in
front of it. The ground of the whole way could be recognised too, from the images of the last 5 m; but every metre
of it is then compared with each of the 40 m after the tear, which takes the longer the longer the way was. What the
filter on board has to go by is fixes.
"""

from dataclasses import dataclass, replace

import numpy as np

from survey.core.arrays import FloatArray, IntArray
from survey.data.recording import Recording
from survey.data.sensors import Odometry
from vision_slam.inertial.attitude import heading_correction
from vision_slam.inertial.dead_reckoning import dead_reckoning
from vision_slam.io.sequence import VisionRecords
from vision_slam.odometry.visual_odometry import VisualOdometry
from vision_slam.places.ground_view import GroundMosaics
from vision_slam.places.overlay import Overlay, match_overlay
from vision_slam.rotation import rotations

_HOLE_S = 1.5
_FORGOTTEN_S = 5.0
_FREE_M, _FREE_RAD = 300.0, np.pi
_FIX_M = 2.0
_LEAST_FIXES = 5
_LONG_ENOUGH_M = 10.0
_LEAST_AGREE = 40
_KEY_SPACING_M = 1.0
_SEARCHED_M = 40.0
_OVERLAY_RAD = np.radians(3.0)


def segment_starts(recording: VisionRecords, found: VisualOdometry) -> IntArray:
    """Return the frames that no sensor constraints to the one before.

    Neither wheels nor images know what happened in between: the wheels have a hole of more
    than 1.5 s, and the images found nothing that they had seen before, or cannot have.
    """
    times = found.odometry.time_s
    gap = np.diff(times)
    counted = np.zeros(0) if recording.wheels is None else recording.wheels.time_s
    torn = []
    for k in (np.flatnonzero(gap > _HOLE_S) + 1).tolist():
        inside = counted[(counted > times[k - 1]) & (counted < times[k])]
        hole = float(np.diff(np.concatenate([times[k - 1 : k], inside, times[k : k + 1]])).max())
        health = found.health[k]
        is_forgotten = gap[k - 1] > _FORGOTTEN_S and not health.is_recognised
        if hole > _HOLE_S and (is_forgotten or not health.is_visual):
            torn.append(k)
    return np.array(torn, dtype=np.int64)


def relocalize_segments(recording: Recording, found: VisualOdometry) -> VisualOdometry:
    """Return the odometry in one piece: what came after each tear is laid where it belongs.

    The step over a tear keeps an error of 300 m, so that fixes and closures are not counted
    twice; what could not be laid has any heading, too, and counts as lost.
    """
    tears = segment_starts(recording, found)
    odometry, is_lost = found.odometry, found.is_lost.copy()
    if len(tears) == 0:
        return found
    n = len(odometry.time_s)
    told = odometry.step_sigma_m
    step_sigma, turn_sigma = np.zeros(n - 1) if told is None else told.copy(), np.zeros(n - 1)
    ends = [*tears[1:].tolist(), n]
    odometry = _turned(odometry, 0, _first_turn(recording, odometry, int(tears[0])))
    for first, end in zip(tears.tolist(), ends, strict=True):
        laid = _by_fixes(recording, odometry, first, end)
        if laid is None:
            laid = _by_ground(recording, odometry, found, first, end)
        if laid is None:
            is_lost[first:end] = True
            step_sigma[first - 1], turn_sigma[first - 1] = _FREE_M, _FREE_RAD
            continue
        odometry = _laid(odometry, recording.start, first, laid)
        step_sigma[first - 1], turn_sigma[first - 1] = _FREE_M, laid.sigma_rad
    odometry = replace(odometry, step_sigma_m=step_sigma, turn_sigma_rad=turn_sigma)
    return replace(found, odometry=odometry, is_lost=is_lost)


@dataclass(frozen=True)
class _Laid:
    """Where a piece begins, (3,) [m] in the world, by how much it is to be turned, and that turn's error."""

    place: FloatArray
    turn_rad: float
    sigma_rad: float


def _first_turn(recording: Recording, odometry: Odometry, end: int) -> float:
    first = Odometry(odometry.time_s[:end], odometry.step[: end - 1], odometry.attitude_rad[:end])
    return heading_correction(dead_reckoning(first, recording.start), first.time_s, recording.gps)


def _by_fixes(recording: Recording, odometry: Odometry, first: int, end: int) -> _Laid | None:
    """Lay a piece on its fixes by turn and shift; None where they are too few or too near one another."""
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
    return _Laid(place, turn, min(_FIX_M / reach, 1.0))


def _by_ground(
    recording: Recording, odometry: Odometry, found: VisualOdometry, first: int, end: int
) -> _Laid | None:
    """Lay a piece on the ground that it shares with what came before it; None where nothing is recognised."""
    if recording.frames is None or recording.camera is None:
        return None
    path = dead_reckoning(odometry, recording.start)
    mosaics = GroundMosaics(recording.frames, recording.camera, path, odometry, found.sightings)
    met = match_ground(mosaics, np.arange(first), np.arange(first, end))
    if met is None:
        return None
    earlier, later, overlay = met
    level = mosaics.level(earlier)
    heading = np.arctan2(level[1, 0], level[0, 0]) + overlay.turn_rad
    turn = float(heading - odometry.attitude_rad[later, 2])
    arm = _about_up(turn) @ (path[first] - path[later])
    return _Laid(path[earlier] + level @ overlay.shift + arm, turn, _OVERLAY_RAD)


def match_ground(
    mosaics: GroundMosaics, known: IntArray, unknown: IntArray
) -> tuple[int, int, Overlay] | None:
    """Find which of the known poses stood on ground that one of the unknown poses sees; None rather than a guess.

    Nothing is assumed of where the unknown ones are: each of the first 40 m is compared with
    all known ones, a metre apart, of whose views one at a time is held. At least 40 features
    have to agree with one turn and shift of known scale on level ground, which chance
    never reached on ground that is known.
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
    """Poses a metre of travel apart."""
    metre = (mosaics.travel_m[poses] / _KEY_SPACING_M).astype(int)
    spaced: list[int] = poses[np.unique(metre, return_index=True)[1]].tolist()
    return spaced


def _laid(odometry: Odometry, start: FloatArray, first: int, laid: _Laid) -> Odometry:
    """Begin a piece at its place, turned."""
    odometry = _turned(odometry, first, laid.turn_rad)
    before = dead_reckoning(odometry, start)[first - 1]
    step = odometry.step.copy()
    step[first - 1] = rotations(odometry.attitude_rad[first - 1 : first])[0].T @ (laid.place - before)
    return replace(odometry, step=step)


def _turned(odometry: Odometry, first: int, turn_rad: float) -> Odometry:
    """Turn everything from a frame on about the vertical."""
    attitude = odometry.attitude_rad.copy()
    attitude[first:, 2] += turn_rad
    return replace(odometry, attitude_rad=attitude)


def _about_up(angle_rad: float) -> FloatArray:
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
