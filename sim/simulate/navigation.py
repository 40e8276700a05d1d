"""Navigation protocol: readings go in, pose estimates to steer by come out."""

from dataclasses import dataclass
from typing import NamedTuple, Protocol

from survey.core.arrays import FloatArray
from survey.data.camera.calibration import Camera
from survey.data.sensors.readings import Readings
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
