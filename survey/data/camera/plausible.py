"""Checks of camera matrix and mounting: numbers that no camera has are refused, with what to do."""

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import InputError

_LEAST_FOCAL = 0.1  # focal length over the width of the image; a fisheye lens of 180° has 0.3
_MOST_UNEQUAL = 1.3
_MOST_SKEW_PX = 1.0
_FARTHEST_M = 50.0
_TOLERANCE = 1e-6


def refuse_impossible_matrix(matrix: FloatArray, width: int, height: int) -> None:
    """Refuse a camera matrix (3, 3) that describes no lens in front of such an image.

    Parameters
    ----------
    matrix : (3, 3) ndarray
        Camera matrix [pixels].
    width, height : int
        Size of the image [pixels].

    Raises
    ------
    InputError
        Transposed, in other units than pixels, or of another image.

    Examples
    --------
    >>> refuse_impossible_matrix(np.array([[400.0, 0, 320], [0, 400, 240], [0, 0, 1]]), 640, 480)
    """
    (fx, skew, cx), (below, fy, cy), last = matrix.tolist()
    if min(width, height) < 1 or fx <= 0 or fy <= 0:
        raise InputError(
            f"the camera has {width} × {height} pixels and focal lengths {fx:g}, {fy:g}; all must be above 0."
        )
    _refuse_other_rows(matrix, last, below)
    if fx < _LEAST_FOCAL * width:
        raise InputError(
            f"the camera matrix has a focal length of {fx:g} pixels for images {width} pixels wide, and no lens has less than "
            "a tenth of the width; write it in pixels, not in millimetres or in shares of the width."
        )
    if max(fx / fy, fy / fx) > _MOST_UNEQUAL:
        raise InputError(
            f"the camera matrix has focal lengths of {fx:g} and {fy:g} pixels, which differ by more than a factor of "
            f"{_MOST_UNEQUAL:g}; correct them, or resample the images to square pixels."
        )
    if not (-0.5 <= cx <= width - 0.5 and -0.5 <= cy <= height - 0.5):
        raise InputError(
            f"the camera matrix has its principal point at {cx:g}, {cy:g}, outside of the image of {width} × {height} pixels; "
            "give the matrix for images of this size, with column before row."
        )
    if abs(skew) * height / fy > _MOST_SKEW_PX:
        raise InputError(
            f"the camera matrix has a skew of {skew:g} pixels, which the lens models do not have; calibrate without skew."
        )


def _refuse_other_rows(matrix: FloatArray, last: list[float], below: float) -> None:
    """Refuse a matrix whose last row is not 0 0 1, or that has a number below the diagonal."""
    if np.abs(matrix[2] - [0.0, 0.0, 1.0]).max() <= _TOLERANCE and abs(below) <= _TOLERANCE:
        return
    if np.abs(matrix[:, 2] - [0.0, 0.0, 1.0]).max() <= _TOLERANCE:
        raise InputError(
            "the camera matrix has its principal point in the last row, as MATLAB writes it; transpose it."
        )
    raise InputError(
        f"the camera matrix has the last row {last[0]:g} {last[1]:g} {last[2]:g} and {below:g} below fx; 0 0 1 and 0 were "
        "expected, write fx 0 cx, 0 fy cy, 0 0 1."
    )


def refuse_impossible_mounting(pose: FloatArray) -> None:
    """Refuse a pose (4, 4) of the camera on the body that is no rotation and shift.

    Parameters
    ----------
    pose : (4, 4) ndarray
        Takes camera coordinates to body coordinates.

    Raises
    ------
    InputError
        Transposed, without a rotation, or farther from the body than 50 m.

    Examples
    --------
    >>> refuse_impossible_mounting(np.eye(4))
    """
    rotation = pose[:3, :3]
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > _TOLERANCE or np.linalg.det(rotation) < 0:
        raise InputError("T_body_camera of the camera holds no rotation; check the order of its rows.")
    if np.abs(pose[3] - [0.0, 0.0, 0.0, 1.0]).max() > _TOLERANCE:
        is_transposed = np.abs(pose[:, 3] - [0.0, 0.0, 0.0, 1.0]).max() <= _TOLERANCE
        remedy = "transpose it" if is_transposed else "correct it"
        row = " ".join(f"{value:g}" for value in pose[3].tolist())
        raise InputError(
            f"T_body_camera of the camera has the bottom row {row}; 0 0 0 1 was expected, {remedy}."
        )
    shift_m = float(np.linalg.norm(pose[:3, 3]))
    if shift_m > _FARTHEST_M:
        raise InputError(
            f"T_body_camera puts the camera {shift_m:.0f} m from the origin of the body; write its last column in metres."
        )
