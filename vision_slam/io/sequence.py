"""Image sequences with calibration, and georeferencing by fixes."""

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from pyproj import CRS

from survey.core.arrays import FloatArray, checked
from survey.core.errors import InputError
from survey.data.camera.calibration import Camera
from survey.data.camera.frames import Frames
from survey.data.recording import Recording
from survey.data.sensors.aiding import (
    Compass,
    Inertial,
    Wheels,
)
from vision_slam.io.gps_log import GpsLog

_DATED_S = 1e8  # times of images beyond this count from 1970


class VisionRecords(Protocol):
    """Records that visual odometry uses, of a recording or of an image sequence."""

    @property
    def camera(self) -> Camera | None:
        """Calibration and mounting."""

    @property
    def frames(self) -> Frames | None:
        """Images."""

    @property
    def wheels(self) -> Wheels | None:
        """Encoders."""

    @property
    def inertial(self) -> Inertial | None:
        """Gyro and accelerometer."""

    @property
    def compass(self) -> Compass | None:
        """Heading."""


@dataclass(frozen=True)
class ImageSequence:
    """Images with their calibration and the other records of the drive.

    Parameters
    ----------
    camera : Camera
        Calibration and mounting.
    frames : Frames
        Images with times.
    wheels, inertial, compass : optional
        Other sensors.
    reference_time_s, reference : (R,) and (R, 4, 4) ndarray, optional
        Reference poses, body to the frame of the reference. Localization does not use them,
        except in `scale_by_reference`.
    gps : GpsLog, optional
        Fixes of the same recording.
    notes : tuple of str
        What the reader did or assumed, one sentence each.
    """

    camera: Camera
    frames: Frames
    wheels: Wheels | None = None
    inertial: Inertial | None = None
    compass: Compass | None = None
    reference_time_s: FloatArray | None = None
    reference: FloatArray | None = None
    gps: GpsLog | None = None
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if (self.reference is None) != (self.reference_time_s is None):
            raise InputError("reference poses and their times are needed together; give both or neither.")
        if self.reference is not None and self.reference_time_s is not None:
            poses = checked(self.reference, (None, 4, 4), "the reference poses")
            if len(poses) != len(self.reference_time_s):
                raise InputError(
                    f"there are {len(poses)} reference poses and {len(self.reference_time_s)} times; they must be as many."
                )


def scale_by_reference(sequence: ImageSequence, distance_m: float) -> ImageSequence:
    """Take the wheels of the first metres from the reference, to give a monocular sequence a scale.

    After `distance_m` the reference is not used.

    Parameters
    ----------
    sequence : ImageSequence
        With reference poses.
    distance_m : float
        Travel over which the reference is used [m].

    Returns
    -------
    ImageSequence
        With wheels over the first metres.

    Raises
    ------
    InputError
        The sequence has no reference, or it ends within that distance.
    """
    if sequence.reference is None or sequence.reference_time_s is None:
        raise InputError("the sequence has no reference poses to take the first metres from; add wheels.csv.")
    steps = np.linalg.norm(np.diff(sequence.reference[:, :3, 3], axis=0), axis=1)
    travel = np.r_[0.0, np.cumsum(steps)]
    n = int(np.searchsorted(travel, distance_m)) + 1
    if n > len(travel) or n < 2:
        raise InputError(
            f"the reference is {travel[-1]:.1f} m long; its first {distance_m:g} m cannot give the scale."
        )
    odometer = Wheels(sequence.reference_time_s[:n], travel[:n], travel[:n])
    return replace(sequence, wheels=odometer)


def georeference(
    sequence: ImageSequence, log: GpsLog, crs: CRS | str | None = None, shift_s: float = 0.0
) -> Recording:
    """Combine an image sequence and fixes to a recording in a CRS.

    The start is the first fix, and counts as not surveyed.

    Parameters
    ----------
    sequence : ImageSequence
        Images and what came with them.
    log : GpsLog
        The fixes.
    crs : str or pyproj.CRS, optional
        Projected CRS to work in; the UTM zone of the first fix unless given.
    shift_s : float
        Added to the times of the fixes [s].

    Returns
    -------
    Recording
        With fixes, images and the other sensors.

    Raises
    ------
    InputError
        Fewer than two fixes fall into the time of the images.
    """
    fixes, working = log.fixes(crs)
    fixes = replace(fixes, time_s=fixes.time_s + shift_s)
    times = sequence.frames.time_s
    inside = (fixes.time_s >= times[0]) & (fixes.time_s <= times[-1])
    if inside.sum() < 2:
        raise InputError(
            f"{inside.sum()} of {len(fixes)} fixes ({_span(fixes.time_s)}) fall into the time of the images ({_span(times)}); "
            f"name with --gps-shift the seconds to add to the times of the fixes{_guess(log, times)}."
        )
    start = [np.interp(times[0], fixes.time_s, axis) for axis in fixes.position.T]
    return Recording(
        crs=working,
        start=np.array(start),
        gps=fixes,
        camera=sequence.camera,
        frames=sequence.frames,
        wheels=sequence.wheels,
        inertial=sequence.inertial,
        compass=sequence.compass,
        vertical_datum=log.vertical_datum,
        start_is_surveyed=False,
    )


def _span(time_s: FloatArray) -> str:
    return f"{time_s[0]:.1f} to {time_s[-1]:.1f} s"


def _guess(log: GpsLog, times: FloatArray) -> str:
    """Return the midnight before the first image, where the images are dated and the fixes have the time of day."""
    if log.is_dated or times[0] < _DATED_S:
        return ""
    return f", such as {times[0] - times[0] % 86400.0:.0f} for times of day"
