"""Reduction of a recording on moving ice to one epoch."""

from dataclasses import replace

import numpy as np

from survey.core.arrays import FloatArray
from survey.data.ice.motion import IceMotion
from survey.data.recording import Recording
from survey.data.sensors.aiding import Barometer, GpsFixes
from survey.data.sensors.stakes import Stakes
from survey.reconstruction.motion.stakes import mean_stakes


def in_ice_frame(recording: Recording, motion: IceMotion) -> Recording:
    """Return a recording in coordinates that move with the ice, equal to those of the survey at the epoch.

    Odometry, images, sightings and loop closures measure relative to the ice and stay as they are. Fixes, the start, the
    heights of the barometer and stakes are moved to the epoch. The unknowns of the motion become unknowns of
    localization: `vision_slam.localize` of the result estimates path, landmarks and motion together, and a map of these
    landmarks is that of the epoch. `vision_slam.localize_on_ice` does both.

    Parameters
    ----------
    recording : Recording
        In fixed coordinates; a base station stands on rock.
    motion : IceMotion
        Prior of the motion, with repeated surveys of stakes in it (`motion_with_stakes`).

    Returns
    -------
    Recording
        With `ice_motion`.

    Notes
    -----
    Strain turns and stretches steps of the odometry by some 0.1 % a day, which is left to its errors of scale and
    heading.
    """
    stakes = recording.stakes if recording.stake_surveys is None else mean_stakes(recording.stake_surveys)
    begin_s = recording.gps.time_s[:1] if recording.odometry is None else recording.odometry.time_s[:1]
    start = motion.at_epoch(recording.start[None], begin_s)[0]
    gps = _moved_fixes(recording.gps, motion)
    return replace(
        recording,
        start=start,
        gps=gps,
        base=_beside(recording.base, start - recording.start),
        barometer=_moved_heights(recording.barometer, gps, motion),
        stakes=_moved_stakes(stakes, motion),
        ice_motion=motion,
    )


def _moved_fixes(gps: GpsFixes, motion: IceMotion) -> GpsFixes:
    return replace(gps, position=motion.at_epoch(gps.position, gps.time_s))


def _beside(base: GpsFixes | None, shift: FloatArray) -> GpsFixes | None:
    """Return the fixes of a base station that stands at the start, moved with the start: only their errors matter."""
    return None if base is None else replace(base, position=base.position + shift)


def _moved_heights(barometer: Barometer | None, gps: GpsFixes, motion: IceMotion) -> Barometer | None:
    """Return the heights of a barometer at the epoch; its place is that of the fixes."""
    if barometer is None:
        return None
    xy = np.column_stack([np.interp(barometer.time_s, gps.time_s, axis) for axis in gps.position[:, :2].T])
    risen = motion.displacement(xy, barometer.time_s)[:, 2]
    return replace(barometer, height_m=barometer.height_m - risen)


def _moved_stakes(stakes: Stakes | None, motion: IceMotion) -> Stakes | None:
    """Return stakes at the epoch; those without a time of survey are taken to be of the epoch."""
    if stakes is None or stakes.time_s is None:
        return stakes
    return replace(stakes, position=motion.at_epoch(stakes.position, stakes.time_s))
