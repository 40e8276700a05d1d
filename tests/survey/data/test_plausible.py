"""Camera matrices and mountings that no camera has."""

from typing import Literal

import numpy as np
import pytest

from survey.core.errors import InputError
from survey.data.camera import Camera

MATRIX = np.array([[700.0, 0.0, 610.0], [0.0, 710.0, 180.0], [0.0, 0.0, 1.0]])


def _camera(
    matrix: np.ndarray, pose: np.ndarray | None = None, model: Literal["pinhole", "fisheye"] = "pinhole"
) -> Camera:
    return Camera(
        model,
        1241,
        376,
        matrix,
        np.zeros(5 if model == "pinhole" else 4),
        np.eye(4) if pose is None else pose,
    )


def _with(row: int, column: int, value: float) -> np.ndarray:
    matrix = MATRIX.copy()
    matrix[row, column] = value
    return matrix


@pytest.mark.parametrize(
    ("matrix", "words"),
    [
        (MATRIX.T, "as MATLAB writes it; transpose it"),
        (_with(2, 2, 2.0), "last row 0 0 2 .* write fx 0 cx"),
        (_with(1, 0, 5.0), "and 5 below fx"),
        (_with(0, 2, 1300.0), "principal point at 1300, 180, outside of the image of 1241 × 376"),
        (_with(1, 2, 610.0), "principal point at 610, 610, outside"),
        (_with(0, 2, -20.0), "principal point at -20, 180, outside"),
        (MATRIX * [[1e-3], [1e-3], [1.0]], "focal length of 0.7 pixels .* write it in pixels"),
        (_with(1, 1, 350.0), "differ by more than a factor of 1.3"),
        (_with(0, 1, 20.0), "a skew of 20 pixels"),
        (_with(0, 0, -700.0), "all must be above 0"),
    ],
)
def test_a_matrix_that_no_camera_has_is_refused_with_what_to_do(matrix: np.ndarray, words: str) -> None:
    with pytest.raises(InputError, match=words):
        _camera(matrix)


def test_a_mounting_that_is_none_is_refused_with_what_to_do() -> None:
    shifted = np.eye(4)
    shifted[:3, 3] = [0.5, 0.0, 1.2]
    assert _camera(MATRIX, shifted).T_body_camera[2, 3] == 1.2
    for pose, words in (
        (shifted.T, "bottom row 0.5 0 1.2 1; 0 0 0 1 was expected, transpose it"),
        (np.diag([1.0, 1.0, 1.0, 2.0]), "bottom row 0 0 0 2; 0 0 0 1 was expected, correct it"),
        (np.diag([1.0, 1.0, -1.0, 1.0]), "holds no rotation"),
        (
            shifted * np.where(np.arange(4) == 3, [[1e3], [1e3], [1e3], [1.0]], 1.0),
            "1300 m .* column in metres",
        ),
    ):
        with pytest.raises(InputError, match=words):
            _camera(MATRIX, pose)


def test_wide_lenses_and_small_skews_remain() -> None:
    wide = np.array([[395.0, 0.0, 620.0], [0.0, 395.0, 187.0], [0.0, 0.0, 1.0]])
    assert _camera(wide, model="fisheye").model == "fisheye"
    assert _camera(_with(0, 1, 0.01)).matrix[0, 1] == 0.01
