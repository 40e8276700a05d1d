"""Results of the readers: fixes of a receiver and image sequences, and their georeferencing.

`ReceiverFixes` are the fixes of one file, `usable` selects those with a finite place and increasing times, and `GpsLog`
transforms them to a projected CRS. `ImageSequence` holds images with their calibration and the other records of a
drive. `georeference` combines both to a `Recording`, in the UTM zone of the first fixes (polar stereographic near the poles) unless
a CRS is given.
"""

import logging
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import numpy as np
from pyproj import CRS

from survey import Camera, ConfigError, InputError, Recording
from survey.core import UNSTATED, BoolArray, FloatArray, IntArray, checked, projected_crs
from survey.core.time_units import refuse_other_unit
from survey.core.transformation import chosen_crs, transformed
from survey.data.frames import Frames
from survey.data.sensors.records import Compass, GpsFixes, Inertial, Wheels

_RADIUS_OF_68_PERCENT = 1.51


class ReceiverFixes(NamedTuple):
    """Fixes of one file.

    ``time_s`` (N,) is Unix time when `is_dated`; ``place`` (N, 3) holds longitude, latitude
    [deg] and height [m], or easting, northing and height [m] where not `is_geodetic`;
    ``sigma_m`` (N,) is the horizontal standard deviation in each axis, ``sigma_z_m`` (N,) that of the height.
    """

    time_s: FloatArray
    place: FloatArray
    sigma_m: FloatArray | None = None
    is_geodetic: bool = True
    is_dated: bool = True
    n_without_fix: int = 0
    vertical_datum: str = UNSTATED
    notes: tuple[str, ...] = ()
    sigma_z_m: FloatArray | None = None


def axis_sigma_m(radius_m: FloatArray) -> FloatArray:
    """Return the standard deviation in each axis of a radius that holds 68 % of the positions.

    >>> axis_sigma_m(np.array([3.02])).round(2).tolist()
    [2.0]
    """
    sigma_m: FloatArray = np.asarray(radius_m, dtype=np.float64) / _RADIUS_OF_68_PERCENT
    return sigma_m


def usable(
    time_s: FloatArray, place: FloatArray, sigma_m: FloatArray | None, where: str
) -> tuple[BoolArray, tuple[str, ...]]:
    """Return which fixes (N,) of a file can be used, and notes of those that are left out.

    `time_s`, `place`: times (N,) [s] and places (N, 3). `sigma_m` (N,): standard deviations [m].

    >>> usable(np.array([0.0, 1.0]), np.array([[8.0, 46.0, np.nan], [8.0, 46.0, 5.0]]), None, "a.csv")[0].tolist()
    [False, True]
    """
    bad = np.flatnonzero(~np.isfinite(time_s))
    if len(bad):
        raise InputError(f"{where}: the time of fix {bad[0] + 1} is no finite number; correct or remove it.")
    refuse_other_unit(time_s, f"{where}: the times of the fixes")
    values = place if sigma_m is None else np.column_stack([place, sigma_m])
    stays: BoolArray = np.asarray(np.isfinite(values).all(axis=1), dtype=np.bool_)
    n_not_finite = int((~stays).sum())
    if not stays.any():
        raise InputError(f"{where} holds no fix with a finite place and error; record again, or correct it.")
    numbers = np.flatnonzero(stays)
    is_same = (np.diff(np.column_stack([time_s, place])[numbers], axis=0) == 0.0).all(axis=1)
    stays[numbers[1:][is_same]] = False
    _refuse_disorder(time_s, np.flatnonzero(stays), where)
    counted = (
        (n_not_finite, "fixes whose place or error is no finite number are left out"),
        (int(is_same.sum()), "fixes that repeat time and place of the one before are left out"),
    )
    return stays, tuple(f"{n} {words}" for n, words in counted if n)


def _refuse_disorder(time_s: FloatArray, numbers: IntArray, where: str) -> None:
    """Refuse times that do not increase, by the first fix whose time does not."""
    late = np.flatnonzero(np.diff(time_s[numbers]) <= 0.0)
    if not len(late):
        return
    before, after = numbers[late[0]], numbers[late[0] + 1]
    raise InputError(
        f"{where}: the times of the fixes do not increase: fix {after + 1} at {time_s[after]:.3f} s follows one at "
        f"{time_s[before]:.3f} s; sort them, or remove those of a second receiver."
    )


WGS84 = CRS.from_epsg(4326)
logger = logging.getLogger(__name__)
ZERO_HEIGHTS = (
    "all heights of the fixes are 0, as those write who know none: heights of path and map count from there"
)
"""Note of a log whose heights are no heights."""
_NEAR_RAD = 0.015  # 100 km over the radius of the Earth


@dataclass(frozen=True)
class GpsLog:
    """Fixes of a receiver as its file has them.

    `time_s` (N,): times of the fixes [s]: Unix time when `is_dated`, else as the file counts. `place` (N, 3):
    longitude, latitude [deg] and height [m] where `is_geodetic`, else easting, northing and height [m] in a
    CRS that the file does not name. `is_geodetic`, `is_dated`: see above. `n_without_fix`: records that the
    receiver itself marked as no fix; they are left out. `vertical_datum`: what heights count from; ``""``
    when the file does not state it. `sigma_m` (N,): horizontal standard deviation of each fix [m], where the
    file states it or its quality; `sigma_z_m` (N,): that of its height [m]. `notes`: what the reader chose or left out, one sentence each.
    """

    time_s: FloatArray
    place: FloatArray
    is_geodetic: bool = True
    is_dated: bool = False
    n_without_fix: int = 0
    vertical_datum: str = UNSTATED
    sigma_m: FloatArray | None = None
    notes: tuple[str, ...] = ()
    sigma_z_m: FloatArray | None = None

    @property
    def utm(self) -> CRS | None:
        """The UTM zone of the first fix near the others, polar stereographic near the poles; None where the file has metres."""
        if not self.is_geodetic:
            return None
        longitude, latitude = self.place[_first_near(self.place)][:2, None]
        return chosen_crs(longitude, latitude)

    def fixes(self, crs: CRS | str | None = None) -> tuple[GpsFixes, CRS]:
        """Return the fixes in a projected CRS, and which one that is: the UTM zone of the first fix unless named.

        Returns `fixes`: positions in the CRS [m].

        >>> log = GpsLog(np.array([0.0, 1.0]), np.array([[-135.0, 58.4, 5.0], [-135.0, 58.5, 5.0]]))
        >>> log.fixes()[1].to_epsg()
        32608
        """
        if crs is None and self.utm is None:
            raise ConfigError("the fixes are in metres, and the file names no CRS; name one with --crs.")
        target = projected_crs(self.utm if crs is None else crs, "the fixes")
        if not self.is_geodetic:
            return GpsFixes(self.time_s, self.place, self.sigma_m, self.sigma_z_m), target
        xy = transformed(self.place[:, :2], WGS84, target, "the fixes")
        position = np.column_stack([xy, self.place[:, 2]])
        return GpsFixes(self.time_s, position, self.sigma_m, self.sigma_z_m), target

    def select(self, which: BoolArray) -> "GpsLog":
        """Return the fixes of a mask (N,)."""
        sigmas = (None if sigma is None else sigma[which] for sigma in (self.sigma_m, self.sigma_z_m))
        sigma_m, sigma_z_m = sigmas
        return replace(
            self,
            time_s=self.time_s[which],
            place=self.place[which],
            sigma_m=sigma_m,
            sigma_z_m=sigma_z_m,
        )

    def without_zero_places(self, where: str) -> "GpsLog":
        """Leave out fixes at longitude and latitude 0, or at a height of 0 among others, which stand for none; note how many.

        Returns: the same log where no fix is at exactly 0, 0, nor at a height of 0 between fixes beyond 10 m.

        >>> log = GpsLog(np.arange(3.0), np.array([[0.0, 0.0, 0.0], [8.1, 46.5, 5.0], [8.2, 46.5, 5.0]]))
        >>> len(log.without_zero_places("log.csv").time_s)
        2
        """
        is_zero = self.is_geodetic & (self.place[:, :2] == 0.0).all(axis=1)
        n = int(is_zero.sum())
        if n == 0:
            return self._without_zero_heights(where)
        if n == len(is_zero):
            raise InputError(
                f"{where} holds {n} fixes, all at longitude and latitude 0, as receivers write them before they have a fix; "
                "record again once there is one."
            )
        return self._without(
            is_zero, f"{n} fixes at longitude and latitude 0 are left out", where
        )._without_zero_heights(where)

    def _without_zero_heights(self, where: str) -> "GpsLog":
        is_zero = _stands_for_none(self.place[:, 2])
        if is_zero.any():
            note = f"{int(is_zero.sum())} fixes at a height of 0 m among others beyond {_FAR_FROM_ZERO_M:g} m are left out"
            return self._without(is_zero, note, where)
        if self.is_geodetic and not self.place[:, 2].any():
            return replace(self, notes=(*self.notes, ZERO_HEIGHTS))
        return self

    def _without(self, is_left_out: BoolArray, note: str, where: str) -> "GpsLog":
        logger.info("%s: %s", where, note)
        return replace(self.select(~is_left_out), notes=(*self.notes, note))


_FAR_FROM_ZERO_M = 10.0


def _stands_for_none(height_m: FloatArray) -> BoolArray:
    """Return which heights (N,) are exactly 0 though the ones before and after that are not 0 lie far from it."""
    is_zero: BoolArray = height_m == 0.0
    others = np.flatnonzero(~is_zero)
    if not len(others):
        return ~is_zero
    after = np.searchsorted(others, np.arange(len(height_m)))
    nearest = [others[np.clip(after - k, 0, len(others) - 1)] for k in (0, 1)]
    far: BoolArray = np.min([np.abs(height_m[near]) for near in nearest], axis=0) > _FAR_FROM_ZERO_M
    return is_zero & far


def _first_near(place: FloatArray) -> int:
    """Return the number of the first fix within 100 km of the median of all; 0 where none is."""
    longitude, latitude = np.radians(place[:, 0]), np.radians(place[:, 1])
    flat = np.cos(latitude)
    upward = np.column_stack([flat * np.cos(longitude), flat * np.sin(longitude), np.sin(latitude)])
    return int(np.argmax(np.linalg.norm(upward - np.median(upward, axis=0), axis=1) < _NEAR_RAD))


DATED_S = 1e8  # times of images beyond this count from 1970


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

    `camera`: calibration and mounting. `frames`: images with times. `wheels`, `inertial`, `compass`: other
    sensors. `reference_time_s`, `reference` (R,) and (R, 4, 4): reference poses, body to the frame of the
    reference. Localization does not use them, except in `scale_by_reference`. `gps`: fixes of the same
    recording. `notes`: what the reader did or assumed, one sentence each. `scale_is_of_reference`: whether
    `wheels` are the first metres of the reference.
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
    scale_is_of_reference: bool = False

    @property
    def time_s(self) -> FloatArray:
        """Times of the images [s]."""
        return self.frames.time_s

    def __post_init__(self) -> None:
        if (self.reference is None) != (self.reference_time_s is None):
            raise InputError("reference poses and their times are needed together; give both or neither.")
        if self.reference is not None and self.reference_time_s is not None:
            poses = checked(self.reference, (None, 4, 4), "the reference poses")
            if len(poses) != len(self.reference_time_s):
                raise InputError(
                    f"there are {len(poses)} reference poses and {len(self.reference_time_s)} times; they must be as many."
                )


@dataclass(frozen=True)
class MotionRecords:
    """Records of a drive without images.

    `wheels`, `inertial`: sensors of motion. `gps`: fixes. `notes`: what the reader did or assumed, one sentence each.
    """

    wheels: Wheels | None = None
    inertial: Inertial | None = None
    gps: GpsLog | None = None
    notes: tuple[str, ...] = ()
    camera: None = None
    frames: None = None
    compass: None = None

    @property
    def time_s(self) -> FloatArray:
        """Times of the wheels, or of the fixes without wheels [s]."""
        if self.wheels is not None:
            return self.wheels.time_s
        return np.zeros(0) if self.gps is None else self.gps.time_s


def scale_by_reference(sequence: ImageSequence, distance_m: float) -> ImageSequence:
    """Take the wheels of the first metres from the reference, to give a monocular sequence a scale.

    After `distance_m` the reference is not used.

    `distance_m`: travel over which the reference is used [m].
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
    ahead = np.einsum(
        "nij,ni->nj", sequence.reference[:-1, :3, :3], np.diff(sequence.reference[:, :3, 3], axis=0)
    )
    rolled = np.r_[0.0, np.cumsum(np.copysign(steps, ahead[:, 0]))][
        :n
    ]  # wheels count back where a body reverses
    odometer = Wheels(sequence.reference_time_s[:n], rolled, rolled)
    return replace(sequence, wheels=odometer, scale_is_of_reference=True)


def georeference(
    sequence: ImageSequence | MotionRecords, log: GpsLog, crs: CRS | str | None = None, shift_s: float = 0.0
) -> Recording:
    """Combine an image sequence, or the records of a drive without images, and fixes to a recording in a CRS.

    The start is the first fix, and counts as not surveyed.

    `shift_s`: added to the times of the fixes [s].
    """
    fixes, working = log.fixes(crs)
    fixes = replace(fixes, time_s=fixes.time_s + shift_s)
    times, sensor = sequence.time_s, "wheels" if sequence.frames is None else "images"
    inside = (fixes.time_s >= times[0]) & (fixes.time_s <= times[-1])
    if inside.sum() < 2:
        raise InputError(
            f"{inside.sum()} of {len(fixes)} fixes ({_span(fixes.time_s)}) fall into the time of the {sensor} ({_span(times)}); "
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
    if log.is_dated or times[0] < DATED_S:
        return ""
    return f", such as {times[0] - times[0] % 86400.0:.0f} for times of day"
