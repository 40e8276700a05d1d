"""Wheel encoders of both tracks: ticks, scale errors, and faults."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sim.config.faults import FaultConfig, faults_of
from sim.config.sensors import WheelConfig
from sim.instruments.errors import Clock
from sim.vehicle.motion import RoverMotion
from survey.data.sensors.aiding import Wheels


class WheelEncoders:
    """Encoders that count the distance rolled by each track in ticks, with scale errors.

    Slip is part of the motion: a track that spins on the spot counts on.
    """

    def __init__(self, config: WheelConfig, seed: int) -> None:
        self._config = config
        self._clock = Clock(config, seed, "wheels")

    def sense(self, motion: RoverMotion) -> Wheels | None:
        """Return the counts during a stretch."""
        at_s, shown_s = self._clock.due(float(motion.time_s[-1]))
        if not len(at_s):
            return None
        config = self._config
        scale = 1.0 + config.scale_error + 0.5 * config.scale_difference * np.array([1.0, -1.0])
        ticks = np.floor(motion.rolled_at(at_s) * scale / config.tick_m)
        return Wheels(shown_s, *(ticks * config.tick_m).T)


class WheelFaults:
    """Faults of the encoders: a wrong calibration, and tracks that stand still while the rover is carried.

    Parameters
    ----------
    faults : sequence of FaultConfig
        All faults of the mission.
    seed : int
        The mission's seed; these faults draw nothing.
    """

    def __init__(self, faults: Sequence[FaultConfig], seed: int) -> None:
        del seed
        scales = [fault.size for fault in faults_of(faults, "calibration") if fault.failure == "wheels"]
        self._share = 1.0 + sum(scales)
        self._carried = faults_of(faults, "rover")
        self._counted = np.zeros(2)
        self._uncounted = np.zeros(2)

    def apply(self, wheels: Wheels) -> Wheels:
        """Return the counts that the encoders report."""
        if self._share == 1.0 and not self._carried:
            return wheels
        reported = []
        for time_s, *count in np.column_stack([wheels.time_s, wheels.left_m, wheels.right_m]):
            if any(fault.is_on(time_s) for fault in self._carried):
                self._uncounted = self._uncounted + count - self._counted
            self._counted = np.array(count)
            reported.append(self._share * (self._counted - self._uncounted))
        left, right = np.array(reported).T
        return replace(wheels, left_m=left, right_m=right)
