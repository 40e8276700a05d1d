"""Onboard computer: visual odometry and GPS fixes in a particle filter, with dead reckoning in between.

A `Navigator` gets the readings of the rover and returns the pose to steer by; `VisualNavigator` is the one of missions.
`OnboardComputer` estimates the pose of the newest processed image. `VisualNavigator` steers by it: the estimate is two
frames late, and wheels and gyro bridge the time since. The computer runs in this process (`InProcess`) or in one of its
own (`Subprocess`), with the same results; this module imports nothing of simulator and planners, which that process
does not need.
"""

import multiprocessing
import queue
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple, Protocol

import cv2
import numpy as np
from scipy.spatial.transform import Rotation
from threadpoolctl import threadpool_limits

from survey import Camera, InputError
from survey.core import FloatArray, stream
from survey.core.executors import FAILED_TO_START, UNGUARDED, settle_worker
from survey.data.recording import Readings
from survey.data.sensors.odometry import Odometry
from survey.data.sensors.records import Inertial, Wheels
from vision_slam import LocalizationConfig
from vision_slam.fusion.particle_filter import GyroTurn, ParticleFilter
from vision_slam.motion import gyro_residual_rad
from vision_slam.odometry.odometer import VisualOdometry
from vision_slam.odometry.onboard import OnboardOdometry, joined
from vision_slam.odometry.visual_slam import FramePose

_SURVEYED_DEG = 1.0
"""Standard deviation of the heading at the start [deg]."""
LATE_FRAMES = 2
"""Delay of the estimate in frames, during which the onboard computer processes the next ones.

The delay is fixed, so that the drive does not depend on the load of the machine.
"""
_MEMORY_S = 5.0
# Relative error of distances without vision, which wheels and gyro bridge.
_BRIDGED_ERROR = 0.05


class PoseEstimate(NamedTuple):
    """Estimated pose of the rover: ``xy`` (2,) [m] and ``heading_rad`` counter-clockwise from east."""

    xy: FloatArray
    heading_rad: float


class Navigator(Protocol):
    """Estimates the pose to steer by, from readings alone."""

    def step(self, readings: Readings, /) -> PoseEstimate:
        """Process the readings since the last call, with the newest frame, and return the estimated pose."""
        ...

    def finish(self, readings: Readings, /) -> VisualOdometry | None:
        """Process the readings after the last frame; return the visual odometry, if there is one."""
        ...


@dataclass(frozen=True)
class Start:
    """Calibration and start pose, as given to a navigator before the drive.

    ``position`` (3,) [m] and ``heading_rad`` from east are those of the recording: a
    kidnapped rover is given wrong ones.
    """

    camera: Camera
    position: FloatArray
    heading_rad: float


class TimedPose(NamedTuple):
    """Estimated pose at the newest processed image: ``time_s``, ``xy`` (2,) [m], ``heading_rad`` from east."""

    time_s: float
    xy: FloatArray
    heading_rad: float


class OnboardComputer:
    """Estimates the pose from camera, wheels, gyro and GPS fixes by a particle filter.

    `start`: calibration, and surveyed pose at the start. `config`: assumed errors of odometry and receiver.
    `antenna_height_m`: height of the GPS antenna above the ground [m]. `seed`: the mission's seed, for the
    particles.
    """

    def __init__(self, start: Start, config: LocalizationConfig, antenna_height_m: float, seed: int) -> None:
        self._antenna = np.array([0.0, 0.0, antenna_height_m])
        at_start = {"heading_sigma_deg": max(config.heading_sigma_deg, _SURVEYED_DEG)}
        assumed = config.with_image_errors().model_copy(update=at_start)
        self._filter = ParticleFilter(assumed, stream(seed, "navigator"), start=start.position)
        self._odometry = OnboardOdometry(start.camera)
        self._fixes: list[tuple[float, FloatArray]] = []
        self._inertial: list[Inertial] = []
        self._pose: FloatArray | None = None
        self._blind_m = 0.0
        self._heading_rad = start.heading_rad
        self._newest = TimedPose(0.0, start.position[:2], start.heading_rad)

    def process(self, readings: Readings) -> TimedPose:
        """Process the readings since the last call; return the pose at the newest finished image."""
        self._sense(readings)
        for frame, pose in self._odometry.poses():
            self._newest = self._moved_to(frame, pose)
        return self._newest

    def finish(self, readings: Readings) -> VisualOdometry | None:
        """Process the last readings; return the visual odometry of all images, or None of fewer than two."""
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

    def _moved_to(self, frame: FramePose, pose: FloatArray) -> TimedPose:
        """Move the particles by visual odometry and gyro to a frame, and weight them by the fixes until then."""
        time_s = frame.time_s
        if self._pose is None:
            self._heading_rad -= _heading(pose)
        else:
            cosine, sine = np.cos(self._heading_rad), np.sin(self._heading_rad)
            east, north, up = pose[:3, 3] - self._pose[:3, 3]
            step = np.array([cosine * east - sine * north, sine * east + cosine * north, up])
            unseen_m = self._unseen_m(float(np.linalg.norm(step)), frame.health.is_visual)
            turn = self._turn_by_gyro(time_s, np.array([self._pose, pose]))
            self._filter.move(step, time_s - self._newest.time_s, unseen_m, turn=turn)
        self._pose = pose
        while self._fixes and self._fixes[0][0] <= time_s:
            self._filter.correct(self._fixes.pop(0)[1] - self._antenna)
        found = self._filter.estimate()
        heading = self._heading_rad + _heading(pose) + found.heading_rad
        return TimedPose(time_s, found.position[:2], heading)

    def _unseen_m(self, length_m: float, is_visual: bool) -> float:
        """Return the error of a step that wheels and gyro bridged [m]: a share of the distance without vision."""
        before_m = self._blind_m
        self._blind_m = 0.0 if is_visual else before_m + length_m
        return _BRIDGED_ERROR * float(np.sqrt(max(self._blind_m**2 - before_m**2, 0.0)))

    def _turn_by_gyro(self, time_s: float, poses: FloatArray) -> GyroTurn | None:
        """Return the gyro's turn beyond that of two poses (2, 4, 4), from the newest estimate to this time."""
        while self._inertial and self._inertial[0].time_s[-1] < self._newest.time_s - _MEMORY_S:
            self._inertial.pop(0)
        recent = joined(self._inertial)
        if recent is None or time_s <= self._newest.time_s:
            return None
        attitude = Rotation.from_matrix(poses[:, :3, :3]).as_euler("xyz")
        odometry = Odometry(np.array([self._newest.time_s, time_s]), np.zeros((1, 3)), attitude)
        beyond_rad = float(gyro_residual_rad(recent, odometry)[0])
        turned_rad = float(np.angle(np.exp(1j * (attitude[1, 2] - attitude[0, 2]))))
        return GyroTurn(beyond_rad, turned_rad) if np.isfinite(beyond_rad) else None


class ComputerConnection(Protocol):
    """Connection to an `OnboardComputer` in this or another process; results come in the order of the readings."""

    def send(self, readings: Readings, /) -> None:
        """Send readings."""

    def receive(self) -> TimedPose:
        """Wait for the pose of the oldest readings that have none yet."""
        ...

    def finish(self, readings: Readings, /) -> VisualOdometry | None:
        """Send the last readings; wait for the visual odometry of all images."""
        ...


class VisualNavigator:
    """Navigator that steers by an onboard computer, with dead reckoning since its newest processed image.

    The pose received is always that of `LATE_FRAMES` frames ago, however long it took: the
    drive is the same wherever the computer runs.

    `start`: calibration and start pose. `computer`: the onboard computer.
    """

    def __init__(self, start: Start, computer: ComputerConnection) -> None:
        self._computer = computer
        self._newest = TimedPose(0.0, start.position[:2], start.heading_rad)
        self._reckoning = DeadReckoning()
        self._n_sent = 0

    def step(self, readings: Readings) -> PoseEstimate:
        """Process the readings since the last call, and return the estimated pose."""
        self._computer.send(readings)
        self._reckoning.add(readings)
        self._n_sent += 1
        if self._n_sent > LATE_FRAMES:
            self._newest = self._computer.receive()
        return self._reckoning.since(self._newest)

    def finish(self, readings: Readings) -> VisualOdometry | None:
        """Process the last readings, and return the visual odometry."""
        for _ in range(min(self._n_sent, LATE_FRAMES)):
            self._computer.receive()
        return self._computer.finish(readings)


class DeadReckoning:
    """Dead reckoning by wheels and gyro; the gyro's bias is its mean while the rover rests at the start."""

    def __init__(self) -> None:
        self._wheels = np.zeros((1, 2))
        self._gyro = np.zeros((1, 2))
        self._bias, self._resting = 0.0, list[FloatArray]()

    def add(self, readings: Readings) -> None:
        """Add readings."""
        if readings.wheels is not None:
            rolled = 0.5 * (readings.wheels.left_m + readings.wheels.right_m)
            self._wheels = np.vstack([self._wheels, np.column_stack([readings.wheels.time_s, rolled])])
        if readings.inertial is not None:
            rates = readings.inertial.gyro_rad_s[:, 2]
            # Before it has rolled a millimetre the rover stands still, and all that the gyro shows is its bias.
            if self._wheels[-1, 1] < 1e-3:
                self._resting.append(rates)
                self._bias = float(np.median(np.concatenate(self._resting)))
            gaps = np.diff(readings.inertial.time_s, prepend=self._gyro[-1, 0])
            turned = self._gyro[-1, 1] + np.cumsum((rates - self._bias) * gaps)
            self._gyro = np.vstack([self._gyro, np.column_stack([readings.inertial.time_s, turned])])

    def since(self, known: TimedPose) -> PoseEstimate:
        """Return the pose after the motion of wheels and gyro since a known pose."""
        self._wheels = _from(self._wheels, known.time_s - _MEMORY_S)
        self._gyro = _from(self._gyro, known.time_s - _MEMORY_S)
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


_MOST_WAITING = LATE_FRAMES + 1
"""Largest number of readings, with an image each, that wait for the computer; it bounds the memory."""
_POLL_S = 1.0

Make = Callable[[], OnboardComputer]


class InProcess:
    """Connection to an onboard computer in this process."""

    def __init__(self, make: Make) -> None:
        self._computer = make()
        self._answers: deque[TimedPose] = deque()

    def send(self, readings: Readings) -> None:
        """Process the readings at once."""
        self._answers.append(self._computer.process(readings))

    def receive(self) -> TimedPose:
        """Return the oldest pose."""
        return self._answers.popleft()

    def finish(self, readings: Readings) -> VisualOdometry | None:
        """Return the visual odometry of all images."""
        return self._computer.finish(readings)


class Subprocess:
    """Connection to an onboard computer in a new process, through a queue that holds a few images."""

    def __init__(self, make: Make) -> None:
        context = multiprocessing.get_context("spawn")
        self._requests: Any = context.Queue(_MOST_WAITING)
        self._results: Any = context.Queue()
        self._process = context.Process(
            target=_serve, args=(make, self._requests, self._results), daemon=True
        )
        self._n, self._has_answered = 0, False

    def __enter__(self) -> "Subprocess":
        self._process.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.join()
        for line in (self._requests, self._results):
            line.cancel_join_thread()
            line.close()

    def send(self, readings: Readings) -> None:
        """Send readings; wait while the queue is full."""
        self._n += readings.frame is not None
        self._send(readings, is_last=False)

    def receive(self) -> TimedPose:
        """Wait for the oldest pose."""
        pose: TimedPose = self._next()
        return pose

    def finish(self, readings: Readings) -> VisualOdometry | None:
        """Wait for the visual odometry of all images."""
        self._send(readings, is_last=True)
        found: VisualOdometry | None = self._next()
        return found

    def _send(self, readings: Readings, *, is_last: bool) -> None:
        while True:
            try:
                self._requests.put((is_last, readings), timeout=_POLL_S)
            except queue.Full:
                self._refuse_dead()
            else:
                return

    def _next(self) -> Any:
        while True:
            try:
                result = self._results.get(timeout=_POLL_S)
            except queue.Empty:
                self._refuse_dead()
            else:
                self._has_answered = True
                if isinstance(result, BaseException):
                    raise result
                return result

    def _refuse_dead(self) -> None:
        if not self._process.is_alive() and self._results.empty():
            if self._process.exitcode == FAILED_TO_START and not self._has_answered:
                raise InputError(f"the process of the onboard computer {UNGUARDED}")
            raise InputError(
                f"the process of the onboard computer ended with code {self._process.exitcode} after about {self._n} images; "
                "it may have lacked memory: run again, with --workers 1 to do without it."
            )


def _serve(make: Make, requests: Any, results: Any) -> None:
    """Process requests until the last one."""
    settle_worker()
    cv2.setNumThreads(1)
    with threadpool_limits(limits=1):
        try:
            drive_over_texture()
            computer, is_last = make(), False
            while not is_last:
                is_last, readings = requests.get()
                results.put(computer.finish(readings) if is_last else computer.process(readings))
        except Exception as error:
            results.put(error)


def drive_over_texture() -> VisualOdometry | None:
    """Return the visual odometry of a level drive of 0.75 m over random texture, in four images of a camera that looks down.

    This compiles all loops of visual odometry, or loads them, while the simulator still compiles those that render the
    first images of the real drive.
    """
    n_images, width, focal_px, step_px = 4, 160, 100.0, 25
    matrix = np.array([[focal_px, 0.0, 0.5 * width], [0.0, focal_px, 0.5 * width], [0.0, 0.0, 1.0]])
    T_body_camera = np.eye(4)[[1, 0, 2, 3]] * [-1.0, -1.0, -1.0, 1.0]
    T_body_camera[2, 3] = 1.0
    odometry = OnboardOdometry(Camera("pinhole", width, width, matrix, np.zeros(5), T_body_camera))
    time_s = np.linspace(0.0, n_images, 40 * n_images + 1)
    rolled_m = step_px / focal_px * time_s
    still, gravity = np.zeros((len(time_s), 3)), np.tile([0.0, 0.0, 9.81], (len(time_s), 1))
    odometry.sense(Wheels(time_s, rolled_m, rolled_m), Inertial(time_s, still, gravity), None)
    noise = stream(0, "texture").integers(0, 256, (width + step_px * n_images, width), dtype=np.uint8)
    texture = cv2.GaussianBlur(noise, (0, 0), 2.0)
    for k in range(n_images):
        top = step_px * (n_images - k)
        odometry.look(np.asarray(texture[top : top + width], dtype=np.uint8), float(k))
    return odometry.finished()


@contextmanager
def navigating(
    assumed: LocalizationConfig, antenna_height_m: float, seed: int, workers: int
) -> Iterator[Navigate]:
    """Yield a function that builds the navigator of a drive; with two workers its computer has its own process."""
    with ExitStack() as stack:

        def navigate(start: Start) -> VisualNavigator:
            make = partial(OnboardComputer, start, assumed, antenna_height_m, seed)
            return VisualNavigator(
                start, stack.enter_context(Subprocess(make)) if workers > 1 else InProcess(make)
            )

        yield navigate
