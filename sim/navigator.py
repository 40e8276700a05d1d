"""Steers by estimate: visual odometry and GPS, weighed by particles, say where the rover is while it drives."""

import numpy as np
from scipy.spatial.transform import Rotation

from sim.drive import Belief, Start
from sim.instruments import Readings
from survey.arrays import FloatArray
from survey.camera import Image
from survey.sensors import Inertial, Wheels
from vision_slam import LocalizationConfig
from vision_slam.motion import Motion
from vision_slam.particle_filter import ParticleFilter
from vision_slam.pipeline import for_images
from vision_slam.visual_slam import VisualSlam

_SURVEYED_DEG = 1.0
"""How well the heading at the start is known [deg]."""
_GATHERED_S = 0.6
"""Time at rest in which gravity and the gyro's bias are found, before the first image counts [s]."""


class VisualNavigator:
    """Follows the rover by camera, wheels and gyro, and holds the path to the fixes by a particle filter.

    Parameters
    ----------
    start : Start
        Calibration, and place and heading at which the drive begins, as surveyed.
    config : LocalizationConfig
        What is assumed of odometry and receiver.
    antenna_height_m : float
        Of the GPS antenna above the ground [m].
    rng : numpy.random.Generator
        Of the particles.

    Notes
    -----
    The rover has to rest for the first second. Frames that never arrive leave a gap, over
    which wheels and gyro alone tell the motion.
    """

    def __init__(
        self, start: Start, config: LocalizationConfig, antenna_height_m: float, rng: np.random.Generator
    ) -> None:
        self._start, self._antenna_m = start, antenna_height_m
        told = {"heading_sigma_deg": max(config.heading_sigma_deg, _SURVEYED_DEG)}
        assumed = for_images(config).model_copy(update=told)
        self._filter = ParticleFilter(assumed, rng, start=start.position)
        self._slam: VisualSlam | None = None
        self._pose = np.eye(4)
        self._at_rest: list[Inertial] = []
        self._bias = np.zeros(3)
        self._turn, self._rolled_m, self._travelled_m = Rotation.identity(), 0.0, 0.0
        self._gyro_at_s = self._frame_at_s = 0.0

    def step(self, readings: Readings) -> Belief:
        """Take the readings since the last call in, and say where the rover is."""
        self._roll(readings.wheels)
        self._rotate(readings.inertial)
        if readings.frame is not None:
            self._look(*readings.frame)
        if readings.gps is not None and self._slam is not None:
            for fix in readings.gps.position:
                self._filter.correct(fix - [0.0, 0.0, self._antenna_m])
        found = self._filter.estimate()
        seen = self._start.heading_rad if self._slam is None else _heading(self._pose)
        return Belief(found.position[:2], seen + found.heading_rad)

    def _roll(self, wheels: Wheels | None) -> None:
        if wheels is not None:
            rolled = 0.5 * float(wheels.left_m[-1] + wheels.right_m[-1])
            self._travelled_m += rolled - self._rolled_m
            self._rolled_m = rolled

    def _rotate(self, inertial: Inertial | None) -> None:
        """Add the gyro's readings to the turn since the last frame; at rest keep them."""
        if inertial is None:
            return
        if self._slam is None:
            self._at_rest.append(inertial)
        gaps = np.diff(inertial.time_s, prepend=self._gyro_at_s)
        for part in Rotation.from_rotvec((inertial.gyro_rad_s - self._bias) * gaps[:, None]):
            self._turn = self._turn * part
        self._gyro_at_s = float(inertial.time_s[-1])

    def _look(self, time_s: float, image: Image) -> None:
        """Let the image correct the motion since the last one, and move the particles by it."""
        if self._slam is None:
            if time_s < _GATHERED_S:
                return
            self._slam = VisualSlam(self._start.camera, start=self._level_start())
            motion = None
        else:
            motion = Motion(time_s - self._frame_at_s, self._turn.as_matrix(), self._travelled_m)
        frame = self._slam.step(image, time_s, motion)
        pose = self._slam.pose(frame)
        if motion is not None:
            self._filter.move(pose[:3, 3] - self._pose[:3, 3], motion.seconds)
        self._pose, self._frame_at_s = pose, time_s
        self._turn, self._travelled_m = Rotation.identity(), 0.0

    def _level_start(self) -> FloatArray:
        """Return the pose (4, 4) at the start, upright by gravity; take the gyro's bias from the same rest."""
        self._bias = np.median(np.vstack([part.gyro_rad_s for part in self._at_rest]), axis=0)
        up = np.vstack([part.specific_force_m_s2 for part in self._at_rest]).mean(axis=0)
        pitch = np.arctan2(-up[0], np.hypot(up[1], up[2]))
        roll = np.arctan2(up[1], up[2])
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_euler("xyz", [roll, pitch, self._start.heading_rad]).as_matrix()
        self._pose = pose
        return pose


def _heading(pose: FloatArray) -> float:
    return float(np.arctan2(pose[1, 0], pose[0, 0]))
