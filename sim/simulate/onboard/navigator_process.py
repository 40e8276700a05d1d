"""Onboard computer in a process of its own or in this one, with the same results."""

import multiprocessing
import queue
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from typing import Any

import cv2
from threadpoolctl import threadpool_limits

from sim.simulate.navigation import Start
from sim.simulate.onboard.navigator import LATE_FRAMES, Navigate, OnboardComputer, TimedPose, VisualNavigator
from survey.core.errors import InputError
from survey.core.executors import FAILED_TO_START, UNGUARDED, settled
from survey.data.sensors.readings import Readings
from vision_slam import LocalizationConfig
from vision_slam.odometry.odometer import VisualOdometry

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
    """Connection to an onboard computer in a new process, through a queue that holds a few images.

    Raises
    ------
    InputError
        From any method: an error of the computer, or the end of its process.
    """

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
    settled()
    cv2.setNumThreads(1)
    with threadpool_limits(limits=1):
        try:
            computer, is_last = make(), False
            while not is_last:
                is_last, readings = requests.get()
                results.put(computer.finish(readings) if is_last else computer.process(readings))
        except Exception as error:
            results.put(error)


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
