"""Drive of 8 m over a textured tilted plane whose heights, poses and images are known."""

from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

from sim.config.sensors import LidarConfig
from sim.instruments.lidar import scans_along
from survey import Dem, Grid, Recording, SurfacePoints, Trajectory
from survey.data.camera import Camera
from survey.data.frames import Frames, FrameWriter
from survey.data.sensors.records import GpsFixes
from vision_slam.drive_estimate import wandering_error

CRS = "EPSG:32608"
WEST, SOUTH = 500_000.0, 6_700_000.0
SLOPE = np.array([0.02, 0.12])  # rises to the left of the way
TEXEL_M, N_IMAGES, EYE_M = 0.1, 17, 1.8
MOUNT = np.array([[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, EYE_M], [0.0, 0.0, 0.0, 1.0]])
CAMERA = Camera("pinhole", 320, 200, [[200.0, 0, 159.5], [0, 200.0, 60.0], [0, 0, 1]], np.zeros(5), MOUNT)


def height(xy):
    """Return the height of the plane at places (N, 2) [m]."""
    return (np.asarray(xy) - [WEST, SOUTH]) @ SLOPE


def tone(texture, xy):
    """Return the grey value of the plane at places (N, 2)."""
    texel = (np.asarray(xy) - [WEST - 10.0, SOUTH - 25.0]) / TEXEL_M
    return map_coordinates(texture, texel.T[::-1], order=1, mode="nearest")


@cache
def drive():
    """Return images along a way to the east, their path, and a map of the ground that is 0.4 m too low."""
    rng = np.random.default_rng(3)
    texture = sum(gaussian_filter(rng.standard_normal((500, 800)), s) * s for s in (1.0, 2.5, 6.0))
    texture = np.clip(128 + 60 * texture / texture.std(), 0, 255)
    time_s = np.arange(float(N_IMAGES))
    foot = np.column_stack([WEST + 0.5 * time_s, np.full(N_IMAGES, SOUTH), 0.5 * SLOPE[0] * time_s])
    images = [_image(place + [0.0, 0.0, EYE_M], texture) for place in foot]
    still = np.tile([0.0, 0.0, 0.0, 1.0], (N_IMAGES, 1))
    error = wandering_error(time_s, np.full((N_IMAGES, 3), 0.02), 100.0)
    path = Trajectory(time_s, foot, still, np.tile(4e-4 * np.eye(3), (N_IMAGES, 1, 1)), CRS, error=error)
    grid = Grid((WEST - 10.0, SOUTH - 24.0, WEST + 40.0, SOUTH + 24.0), 1.0, CRS)
    low = Dem.on(grid, (height(grid.xy) - 0.4).reshape(grid.shape))
    return SimpleNamespace(frames=Frames(time_s, images), path=path, low=low, texture=texture)


def _image(eye, texture):
    """Return the image of the plane from an eye that looks to the east."""
    column, row = np.meshgrid(np.arange(320.0), np.arange(200.0))
    ray = CAMERA.rays(np.column_stack([column.ravel(), row.ravel()])) @ MOUNT[:3, :3].T
    along = (height(eye[:2]) - eye[2]) / (ray[:, 2] - ray[:, :2] @ SLOPE)
    seen = (along > 0.0) & (along < 60.0)
    xy = eye[:2] + ray[:, :2] * np.where(seen, along, 1.0)[:, None]
    return np.where(seen, tone(texture, xy), 200.0).reshape(200, 320).astype(np.uint8)


def write_drive(folder: Path) -> None:
    """Write the recording ``drive`` with scans of 10 m range, and its localization ``localized``."""
    made = drive()
    path, rng = made.path, np.random.default_rng(4)
    real = Dem.on(made.low.grid(), made.low.elevation + 0.4)
    lidar = LidarConfig(
        beams=16,
        columns=180,
        elevation_deg=(-30.0, 2.0),
        range_m=10.0,
        height_m=EYE_M,
        spray_share=0.0,
        ghost_share=0.0,
    )
    with FrameWriter(folder / "drive" / "frames") as writer:
        for time_s, image in zip(path.time_s, made.frames.images, strict=True):
            writer.add(float(time_s), image)
    recording = Recording(
        CRS,
        path.position[0],
        GpsFixes(path.time_s, path.position),
        camera=CAMERA,
        frames=Frames.read(folder / "drive" / "frames"),
        lidar=scans_along(path, real, lidar, 1),
    )
    recording.write(folder / "drive")
    localized = folder / "localized"
    localized.mkdir()
    path.write(localized / "trajectory.csv")
    xy = rng.uniform([WEST, SOUTH - 3.0], [WEST + 8.0, SOUTH + 3.0], (40, 2))
    pose = np.minimum(((xy[:, 0] - WEST) / 0.5).astype(int), N_IMAGES - 1)
    own = np.tile(4e-4 * np.eye(3), (40, 1, 1))
    SurfacePoints(
        np.column_stack([xy, height(xy) + 0.02 * rng.standard_normal(40)]), covariance=own, origins=path.position[pose], crs=CRS,
        range_m=np.full(40, 3.0), own_covariance=own, keyframe=path.error.keyframe_at(path.time_s[pose]), heading_rad=np.zeros(40), body=path.position[pose],
    ).write(localized / "landmarks.gpkg")  # fmt: skip
