"""Detection of corners in the cells of a grid that have too few."""

import numpy as np

from survey.core.arrays import FloatArray
from survey.data.camera import Camera
from survey.data.frames import Image
from tests.vision_slam.odometry.poses import pose_at
from vision_slam.config import VisualOdometryConfig
from vision_slam.odometry.tracks import CornerDetector, detect

CONFIG = VisualOdometryConfig()
NONE = np.zeros((0, 2), np.float32)


def _near(one: FloatArray, other: FloatArray, within_px: float) -> FloatArray:
    apart = np.linalg.norm(one[:, None] - other[None], axis=2)
    return np.asarray(apart.min(axis=1) < within_px)


def test_cells_searched_one_by_one_give_the_corners_of_the_image(plane_world: object, camera: Camera) -> None:
    image: Image = plane_world.image(pose_at(0.0))  # type: ignore[attr-defined]
    complete = detect(image, NONE, 290, CONFIG)
    parts = []
    for index in range(48):
        searched = np.zeros(48, dtype=bool)
        searched[index] = True
        parts.append(detect(image, NONE, 290, CONFIG, searched.reshape(8, 6)))
    apart = np.concatenate(parts)
    assert len(complete) > 100
    assert len(apart) == len(complete)
    assert _near(apart, complete, 1e-3).all()


def test_new_corners_keep_their_distance_from_those_taken(plane_world: object, camera: Camera) -> None:
    image: Image = plane_world.image(pose_at(0.0))  # type: ignore[attr-defined]
    taken = detect(image, NONE, 60, CONFIG)
    fresh = detect(image, taken, 290, CONFIG)
    assert not _near(fresh, taken, CONFIG.corner_spacing_px - 6.0).any()


def test_a_part_of_the_image_that_was_empty_is_searched_again(plane_world: object, camera: Camera) -> None:
    image: Image = plane_world.image(pose_at(0.0))  # type: ignore[attr-defined]
    half = image.copy()
    half[:, : camera.width // 2] = 128
    find = CornerDetector(CONFIG)
    found = [find(half, NONE, 290), *(find(image, NONE, 290) for _ in range(5))]
    to_the_left = [int((pixels[:, 0] < camera.width // 2 - 45).sum()) for pixels in found]
    assert to_the_left[:5] == [0] * 5
    assert to_the_left[5] > 20
