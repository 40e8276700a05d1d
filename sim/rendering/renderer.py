"""Renderer: images of the fine terrain from a calibrated camera, exact depth, and optical flow."""

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from sim.config.scene import AppearanceConfig, ImagingConfig
from sim.rendering.compiled import Doubles, Floats, share_out
from sim.rendering.light import Light
from sim.rendering.rows import render_rows
from sim.rendering.scene import edge_rays, lens_of, scene_of
from sim.rendering.sensor import ImageSensor
from sim.rendering.sweep import row_slopes, sample_ranges, sweep, view_of
from sim.world.appearance import sun_direction
from sim.world.fine_terrain import FineTerrain
from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.camera.calibration import Camera
from survey.data.camera.frames import Image

_MOST_TAPS = 6
_BLUR_SAMPLES = 5


@dataclass(frozen=True)
class RoverBox:
    """Box, fixed to the rover, that casts a shadow on the ground.

    Parameters
    ----------
    size_m : (3,) tuple of float
        Length, width and height [m].
    T_world_box : (4, 4) array_like
        Takes coordinates about the box's middle to the world's.
    """

    size_m: tuple[float, float, float]
    T_world_box: FloatArray


class Renderer:
    """Renderer of a fine terrain for a calibrated camera.

    One sweep of the terrain per azimuth gives nearly the range of every ray, one Newton step
    on the bilinear surface makes it exact, and rays beside an edge walk the surface cell by
    cell. The same arguments give the same bytes, whatever the number of threads.

    Parameters
    ----------
    terrain : FineTerrain
        Ground and what it is made of.
    appearance : AppearanceConfig
        Sun, air, surface.
    camera : survey.Camera
        Any lens; the world within 143° to the sides of the viewing direction is fast, the
        rest correct but slow.
    seed : int
        Of texture, mountains and noise.
    imaging : ImagingConfig
        Exposure and sensor; its lens and mounting are not used (they are the camera's).
    wind_from_deg : float
        Wind that shaped the finest sastrugi, clockwise from north [deg].
    noise_seed : int, optional
        Of the noise, where it has a seed of its own.

    Notes
    -----
    The images are grey. Snow is matt (no forward scattering), mountains have the one
    distance of the backdrop, and edges against the sky are smoothed by the lens's blur alone.

    Examples
    --------
    >>> from sim.instruments.camera import rover_camera
    >>> from sim.world.scenery import fine_terrain
    >>> from sim.config.scene import SceneryConfig
    >>> from survey.data.dem import Dem
    >>> from survey.data.grid import Grid
    >>> site = Dem.on(Grid((0.0, 0.0, 40.0, 40.0), 1.0), np.zeros((41, 41)))
    >>> camera = rover_camera(ImagingConfig(width=80, height=60))
    >>> renderer = Renderer(fine_terrain(site, SceneryConfig(), 1), AppearanceConfig(), camera, seed=1)
    >>> T_world_body = np.eye(4)
    >>> T_world_body[:2, 3] = 20.0, 20.0
    >>> image = renderer.render(T_world_body @ camera.T_body_camera, time_s=0.0, frame_index=0)
    >>> image.shape, image.dtype
    ((60, 80), dtype('uint8'))
    """

    def __init__(
        self,
        terrain: FineTerrain,
        appearance: AppearanceConfig,
        camera: Camera,
        seed: int,
        *,
        imaging: ImagingConfig | None = None,
        wind_from_deg: float = 235.0,
        noise_seed: int | None = None,
    ) -> None:
        self.terrain, self.camera = terrain, camera
        self._appearance = appearance
        self._datum = float(terrain.height.mean(dtype=np.float64))
        self._lens = lens_of(camera)
        self._edges = edge_rays(self._lens)
        self.scene = scene_of(terrain, self._datum, appearance, wind_from_deg, seed)
        self._sensor = ImageSensor(
            imaging or ImagingConfig(), camera, seed if noise_seed is None else noise_seed
        )
        self._table = np.zeros((max(256, camera.width), max(256, int(2.4 * camera.height))), np.float32)
        self._radiance, self._depth = (np.zeros(self._lens.x.shape, np.float32) for _ in range(2))
        self._ranges = sample_ranges(float(np.hypot(*terrain.height.shape)) * terrain.step_m)

    def render(
        self,
        T_world_camera: FloatArray,
        time_s: float = 0.0,
        frame_index: int = 0,
        *,
        T_world_camera_last_row: FloatArray | None = None,
        T_world_camera_exposed: FloatArray | None = None,
        rover_box: RoverBox | None = None,
    ) -> Image:
        """Return the image (H, W) of one frame.

        Parameters
        ----------
        T_world_camera : (4, 4) array_like
            Pose at the first row: takes camera coordinates to easting, northing, elevation.
        time_s : float
            Time of the frame; the still world does not depend on it [s].
        frame_index : int
            Number of the frame: it alone chooses the sensor's noise.
        T_world_camera_last_row : (4, 4) array_like, optional
            Pose at the last row, for a rolling shutter.
        T_world_camera_exposed : (4, 4) array_like, optional
            Pose of the first row at the end of its exposure, for motion blur.
        rover_box : RoverBox, optional
            What throws the rover's shadow.

        Raises
        ------
        InputError
            The camera is below ground or outside the terrain, or a pose is none.
        """
        del time_s
        radiance, depth = self.trace(T_world_camera, T_world_camera_last_row, rover_box, shaded=True)
        if T_world_camera_exposed is not None:
            moved = self._flow(depth, T_world_camera, T_world_camera_exposed)
            radiance = _smeared(radiance, moved)
        return self._sensor.image(radiance, frame_index)

    def depth(self, T_world_camera: FloatArray, T_world_camera_last_row: FloatArray | None = None) -> Floats:
        """Return the distance along each pixel's ray (H, W) [m]; infinite for sky and mountains."""
        _, depth = self.trace(T_world_camera, T_world_camera_last_row, None, shaded=False)
        return np.where(depth < 0.0, np.float32(np.inf), depth)

    def flow(self, T_world_camera: FloatArray, T_world_camera_next: FloatArray) -> FloatArray:
        """Return where each pixel's place on the ground moves to (H, W, 2) [pixels]; NaN when it leaves the view.

        The backdrop moves as things at its distance do. Whether the place is hidden in the
        next image is not asked: see `visible`.
        """
        depth = self.depth(T_world_camera)
        return self._flow(
            np.where(np.isinf(depth), np.float32(-1), depth), T_world_camera, T_world_camera_next
        )

    def visible(
        self, T_world_camera: FloatArray, T_world_camera_next: FloatArray, tolerance_m: float = 0.05
    ) -> npt.NDArray[np.bool_]:
        """Return which pixels' places on the ground (H, W) are visible in the next view too."""
        depth = self.depth(T_world_camera)
        points = self._points(np.where(np.isinf(depth), np.float32(1e6), depth), T_world_camera)
        there = np.linalg.inv(T_world_camera_next)
        seen = points @ there[:3, :3].T + there[:3, 3]
        pixels = self.camera.project(seen.reshape(-1, 3)).reshape(*seen.shape[:2], 2).astype(np.float32)
        there_depth = np.nan_to_num(self.depth(T_world_camera_next), posinf=1e6)
        found = cv2.remap(there_depth, pixels[..., 0], pixels[..., 1], cv2.INTER_NEAREST, borderValue=-1.0)
        distance = np.linalg.norm(seen, axis=-1)
        return np.isfinite(depth) & (np.abs(found - distance) < tolerance_m + 0.05 * distance)

    def _points(self, depth: Floats, T_world_camera: FloatArray) -> FloatArray:
        rays = np.stack([self._lens.x, self._lens.y, self._lens.z], axis=-1).astype(np.float64)
        pose = np.asarray(T_world_camera, dtype=np.float64)
        points: FloatArray = (rays * depth[..., None]) @ pose[:3, :3].T + pose[:3, 3]
        return points

    def _flow(self, depth: Floats, T_world_camera: FloatArray, T_world_camera_next: FloatArray) -> FloatArray:
        far = np.float32(self._appearance.ridges_distance_m)
        points = self._points(np.where(depth < 0.0, far, depth), T_world_camera)
        there = np.linalg.inv(T_world_camera_next)
        seen = points.reshape(-1, 3) @ there[:3, :3].T + there[:3, 3]
        v, u = np.mgrid[0 : self.camera.height, 0 : self.camera.width]
        moved: FloatArray = self.camera.project(seen).reshape(*depth.shape, 2) - np.stack([u, v], axis=-1)
        return moved

    def trace(
        self, first: FloatArray, last: FloatArray | None, box: RoverBox | None, *, shaded: bool
    ) -> tuple[Floats, Floats]:
        """Return radiance before the sensor, and depth (-1 for the backdrop), of every pixel: valid until the next call."""
        poses = [self._local(pose) for pose in ([first] if last is None else [first, last])]
        rotations, origins = _row_poses(poses, self.camera.height)
        middle = self.camera.height // 2
        directions = np.vstack([self._edges @ rotations[0].T, self._edges @ rotations[-1].T])
        view = view_of(directions, rotations[middle][:, 2], *self._table.shape)
        slopes = row_slopes(view, self._table.shape[1])
        share_out(sweep, self.scene.surface, origins[middle], view, self._ranges, slopes, self._table)
        radiance, depth = self._radiance, self._depth  # fresh pages would cost a millisecond
        share_out(
            render_rows,
            self._lens,
            rotations,
            origins,
            view,
            self._table,
            self.scene,
            self._light(box),
            _MOST_TAPS,
            shaded,
            radiance,
            depth,
        )
        return radiance, depth

    def _local(self, pose: FloatArray) -> Doubles:
        """Return a pose relative to the terrain's south-western node and datum; refuse one off the terrain or below it."""
        matrix = np.array(pose, dtype=np.float64)
        if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
            raise InputError("the camera's pose holds no 4 × 4 finite numbers; give T_world_camera.")
        place = matrix[:3, 3]
        ground = float(self.terrain.elevation(place[None, :2])[0])
        where = f"({place[0]:.1f}, {place[1]:.1f}, {place[2]:.2f})"
        if np.isnan(ground):
            raise InputError(
                f"the camera at {where} is outside the terrain {self.terrain.bounds}; keep it on the map."
            )
        if place[2] <= ground:
            raise InputError(
                f"the camera at {where} is {ground - place[2]:.2f} m below the ground; raise it above {ground:.2f} m."
            )
        matrix[:2, 3] -= self.terrain.origin
        matrix[2, 3] -= self._datum
        return matrix

    def _light(self, box: RoverBox | None) -> Light:
        half, rotation, centre = np.zeros(3), np.eye(3), np.zeros(3)
        if box is not None:
            pose = np.asarray(box.T_world_box, dtype=np.float64)
            half, rotation = (
                0.5 * np.asarray(box.size_m, dtype=np.float64),
                np.ascontiguousarray(pose[:3, :3]),
            )
            centre = pose[:3, 3] - np.append(self.terrain.origin, self._datum)
        look = self._appearance
        in_shade = 0.3 + 0.7 * look.stones
        return Light(sun_direction(look), look.sky_share, in_shade, look.haze_m, half, rotation, centre)


def _row_poses(poses: list[Doubles], n_rows: int) -> tuple[Doubles, Doubles]:
    """Return rotation and position of each row, along the shortest turn from the first pose to the last."""
    first, last = poses[0], poses[-1]
    turn = cv2.Rodrigues(first[:3, :3].T @ last[:3, :3])[0].ravel()
    share = np.linspace(0.0, 1.0, n_rows)
    origins = first[:3, 3] + share[:, None] * (last[:3, 3] - first[:3, 3])
    if not turn.any():
        return np.repeat(first[None, :3, :3], n_rows, axis=0), origins
    rotations = np.stack([first[:3, :3] @ cv2.Rodrigues(turn * s)[0] for s in share])
    return rotations, origins


def _smeared(radiance: Floats, moved: FloatArray) -> Floats:
    """Average the radiance along each pixel's motion during the exposure."""
    v, u = np.mgrid[0 : radiance.shape[0], 0 : radiance.shape[1]].astype(np.float32)
    path = np.nan_to_num(moved).astype(np.float32)
    total = np.zeros_like(radiance)
    for share in np.linspace(0.0, 1.0, _BLUR_SAMPLES, dtype=np.float32):
        x, y = u - share * path[..., 0], v - share * path[..., 1]
        total += cv2.remap(radiance, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return total / np.float32(_BLUR_SAMPLES)
