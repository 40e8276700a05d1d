"""Wheels that count no travel over a complete drive."""

import numpy as np

from vision_slam.io.sequence import VisionRecords

IDLE_WHEELS = (
    "the wheels count no travel while the images move, and were left out, so that lengths are metres with fixes only; "
    "check the encoder or its table"
)
_IDLE_M = 2e-3


class WithoutWheels:
    """Records of a drive without those of its wheels."""

    def __init__(self, records: VisionRecords) -> None:
        self.camera, self.frames = records.camera, records.frames
        self.wheels = None
        self.inertial, self.compass = records.inertial, records.compass


def wheels_are_idle(records: VisionRecords) -> bool:
    """Return whether there are wheels and they count less than 2 mm over the complete drive."""
    wheels = records.wheels
    return wheels is not None and bool(max(np.ptp(wheels.left_m), np.ptp(wheels.right_m)) < _IDLE_M)
