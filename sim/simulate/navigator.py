"""Steers by estimate: visual odometry and GPS, weighed by particles, say where the rover is while it drives."""

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from sim.instruments.suite import Readings
from sim.simulate.navigation import PoseEstimate, Start
from survey.core.arrays import FloatArray
from survey.core.streams import stream
from survey.data.sensors import Inertial, Odometry
from vision_slam import LocalizationConfig
from vision_slam.fusion.hypotheses import GyroTurn
from vision_slam.fusion.particle_filter import ParticleFilter
from vision_slam.inertial.gyro import gyro_residual_rad
from vision_slam.odometry.onboard import OnboardOdometry, joined
from vision_slam.odometry.visual_slam import FramePose, VisualOdometry
from vision_slam.pipeline import image_config

_SURVEYED_DEG = 1.0
"""How well the heading at the start is known [deg]."""
LATE_FRAMES = 2
"""Frames by which the answer that is steered by is late, so that the next one can be taken in the meantime."""
_KEPT_S = 5.0
# Relative error of a way that wheels and gyro bridged, as visual odometry tells it afterwards.
_BRIDGED = 0.05


class Known(NamedTuple):
    """Where the rover was at the newest image that was looked at: ``time_s``, ``xy`` (2,) [m], ``heading_rad`` from east."""

    time_s: float
    xy: FloatArray
    heading_rad: float


class OnboardComputer:
    """Follows the rover by camera, wheels and gyro, and holds the path to the fixes by a particle filter.

    Parameters
    ----------
    start : Start
        Calibration, and place and heading at which the drive begins, as surveyed.
    config : LocalizationConfig
        What is assumed of odometry and receiver.
    antenna_height_m : float
        Of the GPS antenna above the ground [m].
    seed : int
        The mission's, of the particles.
    """

    def __init__(self, start: Start, config: LocalizationConfig, antenna_height_m: float, seed: int) -> None:
        self._antenna = np.array([0.0, 0.0, antenna_height_m])
        told = {"heading_sigma_deg": max(config.heading_sigma_deg, _SURVEYED_DEG)}
        assumed = image_config(config).model_copy(update=told)
        self._filter = ParticleFilter(assumed, stream(seed, "navigator"), start=start.position)
        self._odometry = OnboardOdometry(start.camera)
        self._fixes: list[tuple[float, FloatArray]] = []
        self._inertial: list[Inertial] = []
        self._pose: FloatArray | None = None
        self._blind_m = 0.0
        self._heading_rad = start.heading_rad
        self._known = Known(0.0, start.position[:2], start.heading_rad)

    def take(self, readings: Readings) -> Known:
        """Take the readings since the last call in, and say where the rover was at the newest image that is done."""
        self._sense(readings)
        for frame, pose in self._odometry.poses():
            self._known = self._moved_to(frame, pose)
        return self._known

    def finished(self, readings: Readings) -> VisualOdometry | None:
        """Take the last readings in, and return what all images gave; None of fewer than two."""
        self._sense(readings)
        return self._odometry.finished()

    def _sense(self, readings: Readings) -> None:
        self._odometry.sense(readings.wheels, readings.inertial, readings.compass)
        if readings.frame is not None:
            time_s, image = readings.frame
            self._odometry.look(image, time_s)
        if readings.gps is not None:
            self._fixes += zip(readings.gps.time_s.tolist(), readings.gps.position, strict=True)
        if readings.inertial is not None:
            self._inertial.append(readings.inertial)

    def _moved_to(self, frame: FramePose, pose: FloatArray) -> Known:
        """Move the particles by what an image and the gyro told, and weigh them by the fixes until then."""
        time_s = frame.time_s
        if self._pose is None:
            self._heading_rad -= _heading(pose)
        else:
            cosine, sine = np.cos(self._heading_rad), np.sin(self._heading_rad)
            east, north, up = pose[:3, 3] - self._pose[:3, 3]
            step = np.array([cosine * east - sine * north, sine * east + cosine * north, up])
            unseen_m = self._unseen_m(float(np.linalg.norm(step)), frame.health.is_visual)
            turn = self._turn_by_gyro(time_s, np.array([self._pose, pose]))
            self._filter.move(step, time_s - self._known.time_s, unseen_m, turn=turn)
        self._pose = pose
        while self._fixes and self._fixes[0][0] <= time_s:
            self._filter.correct(self._fixes.pop(0)[1] - self._antenna)
        found = self._filter.estimate()
        heading = self._heading_rad + _heading(pose) + found.heading_rad
        return Known(time_s, found.position[:2], heading)

    def _unseen_m(self, length_m: float, is_visual: bool) -> float:
        """Error of a step that wheels and gyro bridged [m]: a share of the whole way since images told the last."""
        before_m = self._blind_m
        self._blind_m = 0.0 if is_visual else before_m + length_m
        return _BRIDGED * float(np.sqrt(max(self._blind_m**2 - before_m**2, 0.0)))

    def _turn_by_gyro(self, time_s: float, poses: FloatArray) -> GyroTurn | None:
        """Return what the gyro turned beyond two poses (2, 4, 4), from the newest that is known to this moment."""
        while self._inertial and self._inertial[0].time_s[-1] < self._known.time_s - _KEPT_S:
            self._inertial.pop(0)
        recent = joined(self._inertial)
        if recent is None or time_s <= self._known.time_s:
            return None
        attitude = Rotation.from_matrix(poses[:, :3, :3]).as_euler("xyz")
        odometry = Odometry(np.array([self._known.time_s, time_s]), np.zeros((1, 3)), attitude)
        beyond_rad = float(gyro_residual_rad(recent, odometry)[0])
        turned_rad = float(np.angle(np.exp(1j * (attitude[1, 2] - attitude[0, 2]))))
        return GyroTurn(beyond_rad, turned_rad) if np.isfinite(beyond_rad) else None


class Aboard(Protocol):
    """An `OnboardComputer` here or elsewhere: what is asked first is answered first."""

    def ask(self, readings: Readings, /) -> None:
        """Hand readings over."""

    def answer(self) -> Known:
        """Wait for the answer to the oldest question that has none yet."""
        ...

    def finished(self, readings: Readings, /) -> VisualOdometry | None:
        """Hand the last readings over; wait for what all images gave."""
        ...


class VisualNavigator:
    """Asks the onboard computer, and bridges by wheels and gyro the time since the image that its answer is of.

    The answer is always that of `LATE_FRAMES` frames ago, whether it took long or not: the
    drive is the same wherever the computer is.

    Parameters
    ----------
    start : Start
        What is known before the drive.
    aboard : Aboard
        The onboard computer.
    """

    def __init__(self, start: Start, aboard: Aboard) -> None:
        self._aboard = aboard
        self._known = Known(0.0, start.position[:2], start.heading_rad)
        self._reckoning = DeadReckoning()
        self._n_asked = 0

    def step(self, readings: Readings) -> PoseEstimate:
        """Take the readings since the last call in, and say where the rover is."""
        self._aboard.ask(readings)
        self._reckoning.add(readings)
        self._n_asked += 1
        if self._n_asked > LATE_FRAMES:
            self._known = self._aboard.answer()
        return self._reckoning.since(self._known)

    def finish(self, readings: Readings) -> VisualOdometry | None:
        """Take the last readings in, and return what the images gave."""
        for _ in range(min(self._n_asked, LATE_FRAMES)):
            self._aboard.answer()
        return self._aboard.finished(readings)


class DeadReckoning:
    """Wheels and gyro of the last moments, the gyro less what it says while the rover rests at the start."""

    def __init__(self) -> None:
        self._wheels = np.zeros((1, 2))
        self._gyro = np.zeros((1, 2))
        self._bias, self._resting = 0.0, list[FloatArray]()

    def add(self, readings: Readings) -> None:
        """Take readings in."""
        if readings.wheels is not None:
            rolled = 0.5 * (readings.wheels.left_m + readings.wheels.right_m)
            self._wheels = np.vstack([self._wheels, np.column_stack([readings.wheels.time_s, rolled])])
        if readings.inertial is not None:
            rates = readings.inertial.gyro_rad_s[:, 2]
            if self._wheels[-1, 1] < 1e-3:
                self._resting.append(rates)
                self._bias = float(np.median(np.concatenate(self._resting)))
            gaps = np.diff(readings.inertial.time_s, prepend=self._gyro[-1, 0])
            turned = self._gyro[-1, 1] + np.cumsum((rates - self._bias) * gaps)
            self._gyro = np.vstack([self._gyro, np.column_stack([readings.inertial.time_s, turned])])

    def since(self, known: Known) -> PoseEstimate:
        """Return where wheels and gyro have carried the rover since it was known to be somewhere."""
        self._wheels = _from(self._wheels, known.time_s - _KEPT_S)
        self._gyro = _from(self._gyro, known.time_s - _KEPT_S)
        later = self._wheels[:, 0] > known.time_s
        times = np.r_[known.time_s, self._wheels[later, 0]]
        rolled = np.diff(np.interp(times, *self._wheels.T))
        headings = known.heading_rad - np.interp(known.time_s, *self._gyro.T) + self._gyro[:, 1]
        along = np.interp(0.5 * (times[1:] + times[:-1]), self._gyro[:, 0], headings)
        moved = np.array([rolled @ np.cos(along), rolled @ np.sin(along)])
        return PoseEstimate(known.xy + moved, float(headings[-1]))


def _from(records: FloatArray, time_s: float) -> FloatArray:
    """Return the rows from the last one before a time on."""
    return records[max(int(np.searchsorted(records[:, 0], time_s)) - 1, 0) :]


def _heading(pose: FloatArray) -> float:
    return float(np.arctan2(pose[1, 0], pose[0, 0]))


Navigate = Callable[[Start], VisualNavigator]
