"""Faults that a mission asks of a GPS receiver."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sim.config.faults import FaultConfig, faults_of
from sim.instruments.sensor import without_carried
from survey.core.arrays import FloatArray
from survey.core.streams import stream
from survey.data.sensors.aiding import GpsFixes


class GpsFaults:
    """Faults of the rover's receiver: off, frozen, jumped or delayed fixes.

    Parameters
    ----------
    faults : sequence of FaultConfig
        All faults of the mission.
    seed : int
        The mission's seed, for the direction of jumps.
    """

    def __init__(self, faults: Sequence[FaultConfig], seed: int) -> None:
        self._faults, self._seed = faults_of(faults, "gps"), seed
        self._carried = faults_of(faults, "rover")
        self._last: FloatArray | None = None
        self._recent: list[tuple[float, FloatArray]] = []

    def apply(self, fixes: GpsFixes) -> GpsFixes | None:
        """Return the fixes that the receiver reports, or None without any."""
        awake: GpsFixes | None = without_carried(fixes, self._carried)
        if awake is None or not self._faults:
            return awake
        reported = [self._fix(t, place) for t, place in zip(awake.time_s, awake.position, strict=True)]
        arrived = [fix for fix in reported if fix is not None]
        if not arrived:
            return None
        times, places = zip(*arrived, strict=True)
        return replace(awake, time_s=np.array(times), position=np.array(places))

    def _fix(self, time_s: float, place: FloatArray) -> tuple[float, FloatArray] | None:
        """Return one fix as reported, or None without one."""
        self._recent = [*self._recent, (time_s, place)][-600:]
        reported: FloatArray | None = place
        for k, fault in enumerate(fault for fault in self._faults if fault.is_on(time_s)):
            reported = self._faulty(reported, fault, time_s, k)
        if reported is None:
            return None
        self._last = reported
        return time_s, reported

    def _faulty(
        self, place: FloatArray | None, fault: FaultConfig, time_s: float, index: int
    ) -> FloatArray | None:
        match fault.failure:
            case "off":
                return None
            case "frozen":
                return self._last
            case "jump":
                away = stream(self._seed, "faults", "gps", index).standard_normal(3)
                return None if place is None else place + fault.size * away / np.linalg.norm(away)
            case _:
                old = [past for at, past in self._recent if at <= time_s - fault.size + 1e-9]
                return old[-1] if old else None
