"""A small textured plane, seen by a pinhole on a rover: images with known motion, drawn at once."""

import cv2
import numpy as np
import pytest

from survey.core.arrays import FloatArray
from survey.data.camera import Camera
from survey.data.frames import Image

PITCH_DEG = 25.0


def mounted(pitch_deg: float = PITCH_DEG) -> FloatArray:
    """T_body_camera of a camera 0.7 m above the ground that looks forward and down."""
    sine, cosine = np.sin(np.radians(pitch_deg)), np.cos(np.radians(pitch_deg))
    pose = np.eye(4)
    pose[:3, :3] = [[0.0, -sine, cosine], [-1.0, 0.0, 0.0], [0.0, -cosine, -sine]]
    pose[2, 3] = 0.7
    return pose


@pytest.fixture(scope="session")
def camera() -> Camera:
    return Camera(
        "pinhole",
        320,
        240,
        np.array([[240.0, 0, 159.5], [0, 240.0, 119.5], [0, 0, 1]]),
        np.zeros(5),
        mounted(),
    )


class PlaneWorld:
    """Speckled ground z = 0, of which any pose of the body gives the exact image."""

    PER_M = 60.0

    def __init__(self, camera: Camera, seed: int = 4) -> None:
        rng = np.random.default_rng(seed)
        coarse = cv2.GaussianBlur(rng.normal(size=(1200, 1500)).astype(np.float32), (0, 0), 3.0)
        fine = cv2.GaussianBlur(rng.normal(size=(1200, 1500)).astype(np.float32), (0, 0), 1.2)
        self._texture = (128 + 25 * coarse / coarse.std() + 15 * fine / fine.std()).clip(0, 255)
        self._camera = camera

    def image(self, body: FloatArray) -> Image:
        """Draw what the camera sees from a pose of the body; the sky is grey."""
        eye = body @ self._camera.T_body_camera
        columns, rows = np.meshgrid(np.arange(self._camera.width), np.arange(self._camera.height))
        pixels = np.column_stack([columns.ravel(), rows.ravel()]).astype(np.float64)
        rays = self._camera.rays(pixels) @ eye[:3, :3].T
        below = rays[:, 2] < -0.02
        reach = np.where(below, -eye[2, 3] / np.where(below, rays[:, 2], -1.0), 0.0)
        ground = eye[:3, 3] + reach[:, None] * rays
        at = ((ground[:, :2] + [2.0, 10.0]) * self.PER_M).astype(np.float32).reshape(*columns.shape, 2)
        drawn = cv2.remap(
            self._texture, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT
        )
        drawn[~below.reshape(columns.shape)] = 200.0
        image: Image = np.round(drawn).astype(np.uint8)
        return image


@pytest.fixture(scope="session")
def plane_world(camera: Camera) -> PlaneWorld:
    return PlaneWorld(camera)
