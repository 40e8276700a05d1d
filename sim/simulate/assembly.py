"""Rover, camera and stakes of a drive in images, and their faults.

`RoverCamera` takes the frames while the rover moves. `rover_physics`, `camera_on_rover` and `stakes_beside` make the
parts of a drive from the settings of a mission. `Faults` applies those of camera, calibration, start, tracks and
scenery; the faults of sensors are in `sim.instruments`.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from sim.config.mission import MissionConfig
from sim.config.sensors import FaultConfig, faults_of
from sim.config.world import AppearanceConfig, ImagingConfig
from sim.rendering import Renderer, RoverBox, Ruts
from sim.vehicle.motion import HeightField, KinematicRover, Physics, RoverState
from sim.vehicle.pursuit import PurePursuit
from sim.vehicle.rigid_bodies import ContactRover
from sim.world.fine_terrain import FineTerrain
from sim.world.surroundings import mission_surroundings
from survey import Camera
from survey.core import FloatArray, stream
from survey.data.frames import Image


class PoseAt(Protocol):
    """Gives the body's pose T_world_body (4, 4) at a time [s]."""

    def __call__(self, time_s: float, /) -> FloatArray:
        """Return the pose."""


def rover_camera(config: ImagingConfig) -> Camera:
    """Return the camera that a configuration describes.

    >>> camera = rover_camera(ImagingConfig(pitch_down_deg=0.0))
    >>> camera.T_body_camera[:3, 2].round(6).tolist()  # the optical axis looks ahead
    [1.0, 0.0, 0.0]
    >>> camera.T_body_camera[:3, 3].tolist()
    [0.2, 0.0, 0.7]
    """
    focal = 0.5 * config.width / np.radians(0.5 * config.field_of_view_deg)
    matrix = np.array(
        [[focal, 0.0, 0.5 * (config.width - 1)], [0.0, focal, 0.5 * (config.height - 1)], [0.0, 0.0, 1.0]]
    )
    cos, sin = np.cos(np.radians(config.pitch_down_deg)), np.sin(np.radians(config.pitch_down_deg))
    T_body_camera = np.eye(4)
    T_body_camera[:3, :3] = [[0.0, -sin, cos], [-1.0, 0.0, 0.0], [0.0, -cos, -sin]]
    T_body_camera[:3, 3] = config.forward_m, 0.0, config.height_m
    return Camera(
        "fisheye",
        config.width,
        config.height,
        matrix,
        np.array(config.distortion),
        T_body_camera,
        config.row_readout_s,
    )


class RoverCamera:
    """Takes frames along a motion, with rolling shutter and motion blur if the camera has them.

    `renderer`: the scene, seen by the rover's camera. `exposure_s`: time that a row is exposed; 0 for no
    motion blur [s]. `box`: gives, for a pose of the body, the box that throws the rover's shadow. `ruts`: those of the
    renderer, if they are shown.
    """

    def __init__(
        self,
        renderer: Renderer,
        *,
        exposure_s: float = 0.0,
        box: Callable[[FloatArray], RoverBox] | None = None,
        ruts: Ruts | None = None,
    ) -> None:
        self.renderer, self.ruts = renderer, ruts
        self._exposure_s, self._box = exposure_s, box

    def drive_over(self, state: RoverState) -> None:
        """Press the tracks into the ground at a state of the rover, where ruts are shown."""
        if self.ruts is not None:
            place = np.array(state.position[:2]) - self.renderer.terrain.origin
            self.ruts.press(float(place[0]), float(place[1]), state.heading_rad)

    def frame(self, pose_at: PoseAt, time_s: float, frame_index: int) -> Image:
        """Return the image whose first row is exposed around `time_s`."""
        camera, half = self.renderer.camera, 0.5 * self._exposure_s
        readout_s = camera.row_readout_s * (camera.height - 1)

        def view(at_s: float) -> FloatArray:
            pose: FloatArray = pose_at(at_s) @ camera.T_body_camera
            return pose

        return self.renderer.render(
            view(time_s - half),
            time_s,
            frame_index,
            T_world_camera_last_row=view(time_s - half + readout_s) if readout_s > 0.0 else None,
            T_world_camera_exposed=view(time_s + half) if half > 0.0 else None,
            rover_box=self._box(pose_at(time_s)) if self._box else None,
        )


def rover_physics(ground: HeightField, path: FloatArray, mission: MissionConfig) -> Physics:
    """Return the physics of a rover at the start of a path, heading along it."""
    kind = KinematicRover if mission.physics.engine == "kinematic" else ContactRover
    ahead = path[1] - path[0]
    return kind(ground, mission.physics, mission.rover, path[0], float(np.arctan2(ahead[1], ahead[0])))


_TRACK_WIDTH_M = 0.15
_RUT_DEPTH_M = {"snow": 0.025, "bare ice": 0.003, "debris": 0.008}


def _ruts_on(ground: FineTerrain, gauge_m: float) -> Ruts:
    """Return the ruts of a rover before it drives."""
    size_m = np.array(ground.height.shape[::-1]) * ground.step_m
    return Ruts(
        size_m,
        gauge_m=gauge_m,
        width_m=_TRACK_WIDTH_M,
        depth_m=_RUT_DEPTH_M[ground.surface],
        smooth=0.5 if ground.surface == "snow" else 0.0,
    )


def camera_on_rover(
    ground: FineTerrain, look: AppearanceConfig, camera: Camera, mission: MissionConfig
) -> RoverCamera:
    """Return the rover's camera; the rover casts a shadow in its images, and leaves ruts if they are wanted."""
    physics = mission.physics
    gauge_m = physics.track_gauge_m
    ruts = _ruts_on(ground, gauge_m) if look.ruts else None
    renderer = Renderer(
        ground,
        look,
        camera,
        mission.site_seed,
        noise_seed=mission.seed,
        imaging=mission.imaging,
        wind_from_deg=mission.scenery.wind_from_deg,
        surroundings=None if look.horizon is None else mission_surroundings(mission, ground, look.horizon),
        ruts=ruts,
    )
    length = physics.track_length_m + 2.0 * physics.wheel_radius_m
    size = length, gauge_m + physics.wheel_radius_m, 0.3

    def box(T_world_body: FloatArray) -> RoverBox:
        T_body_box = np.eye(4)
        T_body_box[2, 3] = 0.5 * size[2] + 0.05
        return RoverBox(size, T_world_body @ T_body_box)

    return RoverCamera(renderer, exposure_s=mission.imaging.exposure_s, box=box, ruts=ruts)


def stakes_beside(ground: HeightField, pursuit: PurePursuit, mission: MissionConfig) -> FloatArray:
    """Return places (K, 3) of stakes beside the route, left and right in turn; those beyond the map are left out."""
    config = mission.instruments.stakes
    along = (np.arange(config.count) + 0.5) * pursuit.length_m / max(config.count, 1)
    xy, heading = pursuit.at(along)
    side = config.beside_m * np.where(np.arange(config.count) % 2, -1.0, 1.0)[:, None]
    feet = xy + side * np.column_stack([-np.sin(heading), np.cos(heading)])
    place: FloatArray = np.column_stack([feet, ground.elevation(feet)])
    known: FloatArray = place[np.isfinite(place[:, 2])]
    return known


_NOISE_LEVELS = 1.3
"""Standard deviation of the noise of a blank image [grey levels]."""


class Faults:
    """Faults of one drive, except those of sensor records.

    `faults`: in the order in which they are applied. `seed`: the mission's seed, for the place of drops and
    the direction of a kidnapping.

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
        return look.model_copy(update={"ridges_deg": 0.0, "horizon": None}) if hidden else look

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
