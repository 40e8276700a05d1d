"""Puts a mission's faults into what the rover is, drives on, and senses."""

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import TypeVar

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from sim.config.faults import Component, FaultConfig
from sim.config.scene import AppearanceConfig
from sim.vehicle.physics import Physics
from survey.core.arrays import FloatArray
from survey.core.streams import stream
from survey.data.camera import Camera, Image
from survey.data.sensors import GpsFixes, SensorRecords, Wheels

Records = TypeVar("Records", bound=SensorRecords)

_NOISE_LEVELS = 1.3
"""Standard deviation of what a blank image still shows [grey levels]."""


class Faults:
    """The faults of one drive.

    Parameters
    ----------
    faults : sequence of FaultConfig
        In the order in which they are applied.
    seed : int
        The mission's: where drops fall, which way jumps go.

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
        self._last_fix: FloatArray | None = None
        self._waiting: list[tuple[float, FloatArray]] = []
        self._counted = np.zeros(2)
        self._uncounted = np.zeros(2)

    def _of(self, component: Component, time_s: float = 0.0, *, always: bool = False) -> list[FaultConfig]:
        return [f for f in self._faults if f.component == component and (always or f.is_on(time_s))]

    def appearance(self, look: AppearanceConfig) -> AppearanceConfig:
        """Return what the site looks like: hidden mountains are not there."""
        hidden = self._of("scenery", always=True)
        return look.model_copy(update={"ridges_deg": 0.0}) if hidden else look

    def calibration(self, camera: Camera) -> Camera:
        """Return the calibration that the recording states, wrong in focal length or in pitch."""
        for fault in self._of("calibration", always=True):
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
        """Return the start that the recording states; a kidnapped rover is told another one."""
        for k, fault in enumerate(self._of("start", always=True)):
            bearing = stream(self._seed, "faults", "start", k).uniform(0.0, 2.0 * np.pi)
            start = start + fault.size * np.array([np.cos(bearing), np.sin(bearing), 0.0])
        return start

    def drive(self, physics: Physics, time_s: float) -> None:
        """Let tracks stick and ground be slippery."""
        left = right = friction = 1.0
        for fault in self._of("tracks", time_s):
            match fault.failure:
                case "stuck-left":
                    left = fault.size
                case "stuck-right":
                    right = fault.size
                case _:
                    friction = fault.size
        physics.drive_share, physics.friction_share = (left, right), friction

    def awake(self, records: Records | None) -> Records | None:
        """Return the records of an instrument but for the time that the rover is carried; None of none."""
        if records is None or not self._of("rover", always=True):
            return records
        kept = np.array([not self._of("rover", time_s) for time_s in records.time_s], dtype=bool)
        if not kept.any():
            return None
        return type(records)(*(getattr(records, field.name)[kept] for field in fields(records)))

    def counts(self, wheels: Wheels | None) -> Wheels | None:
        """Return what the encoders say they counted; carried wheels do not turn."""
        if wheels is None:
            return None
        share = 1.0 + sum(f.size for f in self._of("calibration", always=True) if f.failure == "wheels")
        if share == 1.0 and not self._of("rover", always=True):
            return wheels
        told = []
        for time_s, *count in np.column_stack([wheels.time_s, wheels.left_m, wheels.right_m]):
            if self._of("rover", time_s):
                self._uncounted = self._uncounted + count - self._counted
            self._counted = np.array(count)
            told.append(share * (self._counted - self._uncounted))
        left, right = np.array(told).T
        return self.awake(replace(wheels, left_m=left, right_m=right))

    def fixes(self, fixes: GpsFixes | None) -> GpsFixes | None:
        """Return what the receiver says of some fixes; None of nothing."""
        fixes = self.awake(fixes)
        if fixes is None or not any(fault.component == "gps" for fault in self._faults):
            return fixes
        kept = [self._fix(time, place) for time, place in zip(fixes.time_s, fixes.position, strict=True)]
        told = [fix for fix in kept if fix is not None]
        if not told:
            return None
        return replace(fixes, time_s=np.array([t for t, _ in told]), position=np.array([p for _, p in told]))

    def _fix(self, time_s: float, place: FloatArray) -> tuple[float, FloatArray] | None:
        """Return one fix as told; None when there is none."""
        self._waiting = [*self._waiting, (time_s, place)][-600:]
        told: FloatArray | None = place
        for k, fault in enumerate(self._of("gps", time_s)):
            match fault.failure:
                case "off":
                    told = None
                case "frozen":
                    told = self._last_fix
                case "jump":
                    away = stream(self._seed, "faults", "gps", k).standard_normal(3)
                    told = None if told is None else told + fault.size * away / np.linalg.norm(away)
                case _:
                    old = [past for at, past in self._waiting if at <= time_s - fault.size + 1e-9]
                    told = old[-1] if old else None
        if told is None:
            return None
        self._last_fix = told
        return time_s, told

    def image(self, time_s: float, index: int, image: Image) -> Image | None:
        """Return the image that arrives, or None when none does."""
        arrived: Image | None = None if self._of("rover", time_s) else image
        for fault in self._of("camera", time_s):
            if arrived is not None:
                arrived = self._spoiled(arrived, fault, index)
        if arrived is not None:
            self._last_image = arrived
        return arrived

    def _spoiled(self, image: Image, fault: FaultConfig, index: int) -> Image | None:
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
        """Blur what lies behind a drop on the lens, which stays where it fell."""
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
