"""Ground with a texture at many scales, and photographs of it that are traced exactly."""

from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.spatial.transform import Rotation

from survey import Camera
from survey.core import FloatArray, stream

LENS = Camera(
    "pinhole", 360, 270, [[320.0, 0.0, 179.5], [0.0, 320.0, 134.5], [0.0, 0.0, 1.0]], np.zeros(5), np.eye(4)
)
_SIDE_M, _CELL_M = 160.0, 0.16


def height_m(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the elevation of the ground, which has relief of some metres."""
    height: FloatArray = 3.0 * np.sin(x / 17.0) * np.cos(y / 23.0) + 1.5 * np.sin((x + 2.0 * y) / 9.0)
    return height


def texture(seed: int) -> FloatArray:
    """Return a texture (1000, 1000) of mean 128 that repeats after 160 m, rough at all scales from 0.5 to 6 m."""
    draw, n = stream(seed, "texture"), round(_SIDE_M / _CELL_M)
    octaves = [
        gaussian_filter(draw.standard_normal((n, n)), width, mode="wrap") * width for width in (1.5, 4, 12)
    ]
    total = sum(octave / octave.std() for octave in octaves)
    return np.clip(128.0 + 30.0 * total, 0.0, 255.0)


def photograph(pose: FloatArray, camera: Camera, ground: FloatArray) -> FloatArray:
    """Trace a photograph (H, W) from a pose T_world_camera above ground with a texture."""
    columns, rows = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    rays = camera.rays(np.column_stack([columns.ravel(), rows.ravel()])) @ pose[:3, :3].T
    eye = pose[:3, 3]
    distance = -eye[2] / rays[:, 2]
    for _ in range(20):
        x, y = (eye[axis] + distance * rays[:, axis] for axis in (0, 1))
        distance = 0.5 * distance + 0.5 * (height_m(x, y) - eye[2]) / rays[:, 2]
    place = np.array([eye[axis] + distance * rays[:, axis] for axis in (0, 1)]) / _CELL_M
    shade = map_coordinates(ground, place, order=1, mode="grid-wrap")
    return np.round(shade).astype(np.uint8).reshape(camera.height, camera.width)


def looking(eye: FloatArray, heading_deg: float, down_deg: float) -> FloatArray:
    """Return the pose T_world_camera (4, 4) that looks to a heading, counter-clockwise from east, and down."""
    pose = np.eye(4)
    turn = Rotation.from_euler("z", heading_deg, degrees=True) * Rotation.from_euler(
        "y", down_deg, degrees=True
    )
    pose[:3, :3] = turn.as_matrix() @ np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    pose[:3, 3] = eye
    return pose


def flight(
    seed: int, n_lines: int, n_along: int, spacing_m: float, above_m: float, down_deg: float
) -> FloatArray:
    """Return the poses (N, 4, 4) of photographs along lines to and fro, each turned and shaken a little."""
    draw, poses = stream(seed, "flight"), []
    for line in range(n_lines):
        for k in range(n_along):
            along = k if line % 2 == 0 else n_along - 1 - k
            eye = np.array([spacing_m * along, 1.3 * spacing_m * line, above_m]) + draw.standard_normal(3)
            heading = (0.0 if line % 2 == 0 else 180.0) + 3.0 * draw.standard_normal()
            poses.append(looking(eye, heading, down_deg + 2.0 * draw.standard_normal()))
    return np.array(poses)


def with_distortion(camera: Camera, k1: float, focal: float = 1.0) -> Camera:
    """Return a camera with another focal length and radial distortion."""
    matrix = camera.matrix * np.array([[focal], [focal], [1.0]])
    matrix[:2, 2] = camera.matrix[:2, 2]
    return replace(camera, matrix=matrix, distortion=np.array([k1, 0.0, 0.0, 0.0, 0.0]))
