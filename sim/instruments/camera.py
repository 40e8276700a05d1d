"""The rover's camera: where it sits, and the frames that it takes while the rover moves."""

from collections.abc import Callable
from typing import Protocol

import numpy as np

from sim.config.scene import ImagingConfig
from sim.rendering import Renderer, RoverBox
from survey.core.arrays import FloatArray
from survey.data.camera.calibration import Camera
from survey.data.camera.frames import Image


class PoseAt(Protocol):
    """Gives the body's pose T_world_body (4, 4) at a time [s]."""

    def __call__(self, time_s: float, /) -> FloatArray:
        """Return the pose."""


def rover_camera(config: ImagingConfig) -> Camera:
    """Return the camera that a configuration describes.

    Examples
    --------
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

    Parameters
    ----------
    renderer : Renderer
        The scene, seen by the rover's camera.
    exposure_s : float
        Time that a row is exposed; 0 for no motion blur [s].
    box : callable, optional
        Gives, for a pose of the body, the box that throws the rover's shadow.
    """

    def __init__(
        self,
        renderer: Renderer,
        *,
        exposure_s: float = 0.0,
        box: Callable[[FloatArray], RoverBox] | None = None,
    ) -> None:
        self._renderer, self._exposure_s, self._box = renderer, exposure_s, box

    def frame(self, pose_at: PoseAt, time_s: float, frame_index: int) -> Image:
        """Return the image whose first row is exposed around `time_s`."""
        camera, half = self._renderer.camera, 0.5 * self._exposure_s
        readout_s = camera.row_readout_s * (camera.height - 1)

        def view(at_s: float) -> FloatArray:
            pose: FloatArray = pose_at(at_s) @ camera.T_body_camera
            return pose

        return self._renderer.render(
            view(time_s - half),
            time_s,
            frame_index,
            T_world_camera_last_row=view(time_s - half + readout_s) if readout_s > 0.0 else None,
            T_world_camera_exposed=view(time_s + half) if half > 0.0 else None,
            rover_box=self._box(pose_at(time_s)) if self._box else None,
        )
