"""Faults of camera, calibration, start, tracks and scenery; those of sensors are in `sim.instruments`."""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from sim.config.faults import FaultConfig, faults_of
from sim.config.scene import AppearanceConfig
from sim.vehicle.physics import Physics
from survey.core.arrays import FloatArray
from survey.core.streams import stream
from survey.data.camera.calibration import Camera
from survey.data.camera.frames import Image

_NOISE_LEVELS = 1.3
"""Standard deviation of the noise of a blank image [grey levels]."""


class Faults:
    """Faults of one drive, except those of sensor records.

    Parameters
    ----------
    faults : sequence of FaultConfig
        In the order in which they are applied.
    seed : int
        The mission's seed, for the place of drops and the direction of a kidnapping.

    Examples
    --------
    >>> white = Faults([FaultConfig(component="camera", failure="whiteout", until_s=2.0)], seed=1)
    >>> image = np.zeros((4, 6), np.uint8)
    >>> bool(white.image(1.0, 4, image).min() > 200), bool(white.image(2.0, 8, image).max() == 0)
    (True, True)
    """

    def __init__(self, faults: Sequence[FaultConfig], seed: int) -> None:
        self._faults, self._seed = faults, seed
        self._last_image: Image | None = None

    def _active(self, component: str, time_s: float) -> list[FaultConfig]:
        return [fault for fault in faults_of(self._faults, component) if fault.is_on(time_s)]

    def appearance(self, look: AppearanceConfig) -> AppearanceConfig:
        """Return the appearance of the site, without mountains where they are hidden."""
        hidden = faults_of(self._faults, "scenery")
        return look.model_copy(update={"ridges_deg": 0.0}) if hidden else look

    def calibration(self, camera: Camera) -> Camera:
        """Return the calibration that the recording states, with errors of focal length and pitch."""
        for fault in faults_of(self._faults, "calibration"):
            if fault.failure == "focal-length":
                matrix = camera.matrix.copy()
                matrix[[0, 1], [0, 1]] *= 1.0 + fault.size
                camera = replace(camera, matrix=matrix)
            elif fault.failure == "pitch":
                pose = camera.T_body_camera.copy()
                pose[:3, :3] = Rotation.from_euler("y", fault.size, degrees=True).as_matrix() @ pose[:3, :3]
                camera = replace(camera, T_body_camera=pose)
        return camera

    def start(self, start: FloatArray) -> FloatArray:
        """Return the start that the recording states; that of a kidnapped rover is wrong."""
        for k, fault in enumerate(faults_of(self._faults, "start")):
            bearing = stream(self._seed, "faults", "start", k).uniform(0.0, 2.0 * np.pi)
            start = start + fault.size * np.array([np.cos(bearing), np.sin(bearing), 0.0])
        return start

    def drive(self, physics: Physics, time_s: float) -> None:
        """Set the tracks' drive shares and the ground's friction share of the physics."""
        left = right = friction = 1.0
        for fault in self._active("tracks", time_s):
            match fault.failure:
                case "stuck-left":
                    left = fault.size
                case "stuck-right":
                    right = fault.size
                case "stopped":
                    left = right = fault.size
                case _:
                    friction = fault.size
        physics.drive_share, physics.friction_share = (left, right), friction

    def image(self, time_s: float, index: int, image: Image) -> Image | None:
        """Return the image as recorded, or None where it is lost."""
        arrived: Image | None = None if self._active("rover", time_s) else image
        for fault in self._active("camera", time_s):
            if arrived is not None:
                arrived = self._faulty(arrived, fault, index)
        if arrived is not None:
            self._last_image = arrived
        return arrived

    def _faulty(self, image: Image, fault: FaultConfig, index: int) -> Image | None:
        size, grey = fault.size, image.astype(np.float64)
        match fault.failure:
            case "dropped":
                return None
            case "frozen":
                return image if self._last_image is None else self._last_image
            case "glare":
                return _with_glare(grey, size)
            case "lens-drop":
                return self._with_drop(grey, size * image.shape[1])
            case "whiteout":
                grey = np.full_like(grey, size)
            case "dark":
                grey = grey * size
            case _:
                grey = np.asarray(cv2.GaussianBlur(grey, (0, 0), max(size, 1e-3)), dtype=np.float64)
        return self._noisy(grey, index)

    def _noisy(self, grey: FloatArray, index: int) -> Image:
        rng = stream(self._seed, "faults", "noise", index)
        return _grey(grey + _NOISE_LEVELS * rng.standard_normal(grey.shape))

    def _with_drop(self, grey: FloatArray, radius: float) -> Image:
        """Blur the image behind a drop on the lens; its place is fixed for the drive."""
        height, width = grey.shape[:2]
        u, v = stream(self._seed, "faults", "drop").uniform(0.25, 0.75, 2) * (width, height)
        distance = np.hypot(np.arange(width)[None] - u, np.arange(height)[:, None] - v)
        share = np.clip((radius - distance) / 4.0, 0.0, 1.0).reshape(height, width, *[1] * (grey.ndim - 2))
        blurred = cv2.GaussianBlur(grey, (0, 0), max(0.25 * radius, 1.0))
        return _grey(grey * (1.0 - share) + blurred * share)


def _with_glare(grey: FloatArray, share: float) -> Image:
    """Overexpose a band of columns in the middle, `share` of the width wide."""
    u = np.arange(grey.shape[1]) / grey.shape[1]
    band = np.exp(-0.5 * ((u - 0.5) / (0.5 * max(share, 1e-3))) ** 4)
    return _grey(grey + 255.0 * band.reshape(1, -1, *[1] * (grey.ndim - 2)))


def _grey(levels: FloatArray) -> Image:
    return np.clip(np.rint(levels), 0.0, 255.0).astype(np.uint8)
