"""Path of a rover that steers by the slope it stands on: sensed roll and pitch at the estimated pose."""

import numpy as np

from planners.steering.attitude import Attitude
from planners.steering.waypoints import WaypointSteering
from sim.simulate.navigation import PoseEstimate
from sim.vehicle.pursuit import PurePursuit
from survey.core.arrays import FloatArray
from survey.data.sensors.readings import Readings

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
