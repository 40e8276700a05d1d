"""The onboard computer beside the simulation: in a process of its own, or in this one, with the same answers."""

import multiprocessing
import queue
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from typing import Any

import cv2
from threadpoolctl import threadpool_limits

from sim.config.mission import MissionConfig
from sim.executors import settled
from sim.instruments.suite import Readings
from sim.simulate.navigation import Start
from sim.simulate.navigator import LATE_FRAMES, Known, Navigate, OnboardComputer, VisualNavigator
from survey.core.errors import InputError
from vision_slam.odometry.visual_slam import VisualOdometry

_MOST_WAITING = LATE_FRAMES + 1
"""Readings, with an image each, that may wait for the computer: what bounds the memory."""
_PATIENCE_S = 1.0

Make = Callable[[], OnboardComputer]


class InProcess:
    """The computer in this process."""

    def __init__(self, make: Make) -> None:
        self._computer = make()
        self._answers: deque[Known] = deque()

    def ask(self, readings: Readings) -> None:
        """Let it think at once."""
        self._answers.append(self._computer.take(readings))

    def answer(self) -> Known:
        """Return the oldest answer."""
        return self._answers.popleft()

    def finished(self, readings: Readings) -> VisualOdometry | None:
        """Return what all images gave."""
        return self._computer.finished(readings)


class Subprocess:
    """The computer in a process that is started anew, fed by a queue that holds a few images.

    Raises
    ------
    InputError
        From any method: what the computer refuses, or that its process died.
    """

    def __init__(self, make: Make) -> None:
        context = multiprocessing.get_context("spawn")
        self._asked: Any = context.Queue(_MOST_WAITING)
        self._told: Any = context.Queue()
        self._process = context.Process(target=_serve, args=(make, self._asked, self._told), daemon=True)
        self._n = 0

    def __enter__(self) -> "Subprocess":
        self._process.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.join()
        for line in (self._asked, self._told):
            line.cancel_join_thread()
            line.close()

    def ask(self, readings: Readings) -> None:
        """Hand readings over; wait while too many are not taken yet."""
        self._n += readings.frame is not None
        self._hand_over(readings, is_last=False)

    def answer(self) -> Known:
        """Wait for the oldest answer."""
        answered: Known = self._next()
        return answered

    def finished(self, readings: Readings) -> VisualOdometry | None:
        """Wait for what all images gave."""
        self._hand_over(readings, is_last=True)
        found: VisualOdometry | None = self._next()
        return found

    def _hand_over(self, readings: Readings, *, is_last: bool) -> None:
        while True:
            try:
                self._asked.put((is_last, readings), timeout=_PATIENCE_S)
            except queue.Full:
                self._refuse_dead()
            else:
                return

    def _next(self) -> Any:
        while True:
            try:
                told = self._told.get(timeout=_PATIENCE_S)
            except queue.Empty:
                self._refuse_dead()
            else:
                if isinstance(told, BaseException):
                    raise told
                return told

    def _refuse_dead(self) -> None:
        if not self._process.is_alive() and self._told.empty():
            raise InputError(
                f"the process of the onboard computer ended with code {self._process.exitcode} after about {self._n} images; "
                "it may have lacked memory: run again, with --workers 1 to do without it."
            )


def _serve(make: Make, asked: Any, told: Any) -> None:
    """Answer what is asked, until the end is asked for."""
    settled()
    cv2.setNumThreads(1)
    with threadpool_limits(limits=1):
        try:
            computer, is_last = make(), False
            while not is_last:
                is_last, readings = asked.get()
                told.put(computer.finished(readings) if is_last else computer.take(readings))
        except Exception as error:
            told.put(error)


@contextmanager
def navigating(mission: MissionConfig, workers: int) -> Iterator[Navigate]:
    """Give what makes a mission's navigator; its computer has a process of its own where there may be two."""
    with ExitStack() as stack:

        def navigate(start: Start) -> VisualNavigator:
            height_m, seed = mission.rover.antenna_height_m, mission.seed
            make = partial(OnboardComputer, start, mission.assumed, height_m, seed)
            return VisualNavigator(
                start, stack.enter_context(Subprocess(make)) if workers > 1 else InProcess(make)
            )

        yield navigate
