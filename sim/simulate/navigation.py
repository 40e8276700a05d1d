"""Navigation of a simulated rover: the protocol of navigators, and paths that are chosen while driving.

A `Navigator` gets readings and returns the pose to steer by; `sim.simulate.navigator` holds the implementation.
`SteeredPath` grows the path of a pattern that is steered by slope, from the roll and pitch that the accelerometer gives
at the estimated pose.
"""

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from planners.steered_paths import WaypointSteering
from planners.steering import Attitude
from sim.vehicle.pursuit import PurePursuit
from survey.core.arrays import FloatArray
from survey.data.camera import Camera
from survey.data.recording import Readings
from vision_slam.odometry.odometer import VisualOdometry


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


_AVERAGED_S = 2.0
"""Time over which the accelerometer is averaged [s]: jolts and accelerations largely cancel."""


class SensedTilt:
    """Roll and pitch by the accelerometer, averaged over the last seconds; its bias stays in them.

    Examples
    --------
    >>> tilt = SensedTilt()
    >>> tilt.roll_and_pitch()  # nothing was sensed yet
    (0.0, 0.0)
    """

    def __init__(self) -> None:
        self._time_s, self._force = np.zeros(0), np.zeros((0, 3))

    def add(self, readings: Readings) -> None:
        """Add the readings since the last call."""
        if readings.inertial is None:
            return
        time_s = np.r_[self._time_s, readings.inertial.time_s]
        force = np.vstack([self._force, readings.inertial.specific_force_m_s2])
        recent = time_s > time_s[-1] - _AVERAGED_S
        self._time_s, self._force = time_s[recent], force[recent]

    def roll_and_pitch(self) -> tuple[float, float]:
        """Return roll and pitch [rad]; level before the first reading."""
        if not len(self._time_s):
            return 0.0, 0.0
        x, y, z = self._force.mean(axis=0)
        return float(np.arctan2(y, z)), float(np.arctan2(-x, np.hypot(y, z)))


class SteeredPath:
    """Grows the path of a pursuit where it ends near, by what the rover senses.

    Parameters
    ----------
    steering : WaypointSteering
        Chooses the waypoints.
    """

    def __init__(self, steering: WaypointSteering) -> None:
        self._steering, self._tilt = steering, SensedTilt()

    @property
    def start(self) -> FloatArray:
        """Start of the path (2,) [m]."""
        return self._steering.start

    def sense(self, readings: Readings) -> None:
        """Process the readings since the last call."""
        self._tilt.add(readings)

    def extend(self, pursuit: PurePursuit, estimate: PoseEstimate) -> None:
        """Append waypoints until the path reaches beyond the look-ahead, or mark it as complete."""
        roll, pitch = self._tilt.roll_and_pitch()
        attitude = Attitude(np.array([roll]), np.array([pitch]), np.array([estimate.heading_rad]))
        while pursuit.wants_more:
            stretch = self._steering.next_stretch(attitude)
            if stretch is None:
                pursuit.complete()
            else:
                pursuit.extend(stretch)
