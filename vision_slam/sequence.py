"""A drive recorded by someone else's robot: images and whatever else came with them."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from survey.arrays import FloatArray, checked
from survey.camera import Camera, Frames
from survey.errors import InputError
from survey.sensors import Compass, Inertial, Wheels


class Sensed(Protocol):
    """What visual odometry looks at, of a recording or of a sequence."""

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
    """Images with their calibration, without any place in the world.

    ``reference_time_s`` (R,) and ``reference`` (R, 4, 4), body to the reference's own frame,
    are poses to judge by; localization does not look at them, except where `scaled_by_first`
    is asked to.
    """

    camera: Camera
    frames: Frames
    wheels: Wheels | None = None
    inertial: Inertial | None = None
    compass: Compass | None = None
    reference_time_s: FloatArray | None = None
    reference: FloatArray | None = None

    def __post_init__(self) -> None:
        if (self.reference is None) != (self.reference_time_s is None):
            raise InputError("reference poses and their times are needed together; give both or neither.")
        if self.reference is not None and self.reference_time_s is not None:
            poses = checked(self.reference, (None, 4, 4), "the reference poses")
            if len(poses) != len(self.reference_time_s):
                raise InputError(
                    f"there are {len(poses)} reference poses and {len(self.reference_time_s)} times; they must be as many."
                )


def scaled_by_first(sequence: ImageSequence, distance_m: float) -> ImageSequence:
    """Give a sequence without wheels the odometer of its first metres, read from the reference.

    After `distance_m` nothing of the reference is used: one camera knows no scale by itself,
    and this hands it one.

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
    return ImageSequence(
        sequence.camera,
        sequence.frames,
        odometer,
        sequence.inertial,
        sequence.compass,
        sequence.reference_time_s,
        sequence.reference,
    )
