"""Calibrated camera of a rover: projection, rays of its pixels, its file.

`Camera` has the models of OpenCV, pinhole with five lens coefficients or fisheye with four, and its mounting on the vehicle.
The pinhole distortion is inverted by Newton's method, up to the radius at which the model folds. Numbers that no camera has are refused.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, Self

import numpy as np
import tomlkit

from survey.core import (
    DataObject,
    FloatArray,
    InputError,
    Section,
    checked,
    existing_file,
    validated,
    write_text,
)
from survey.core.config import read_toml


class CalibrationTable(Section):
    """Keys of the table ``[calibration]``: how well the lens is known; localization does not use it."""

    views: int
    """Images of the board that were used."""
    rms_px: float
    """Root mean square of the residuals [pixels]."""
    coverage: float
    """Share of the image area that the board has reached."""
    sigma: dict[str, float]
    """Standard deviation of each parameter: fx, fy, cx, cy [pixels] and lens coefficients."""


class CameraFile(Section):
    """Keys of ``camera.toml``."""

    model: Literal["pinhole", "fisheye"]
    """OpenCV's lens model: rational pinhole (k1, k2, p1, p2, k3) or fisheye (k1, k2, k3, k4)."""
    width: int
    """Columns of the image."""
    height: int
    """Rows of the image."""
    matrix: tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]
    """Focal lengths and principal point [pixels]; pixel centres are whole numbers."""
    distortion: tuple[float, ...] | None = None
    """Coefficients of the lens model; without them zero is assumed."""
    T_body_camera: tuple[
        tuple[float, float, float, float],
        tuple[float, float, float, float],
        tuple[float, float, float, float],
        tuple[float, float, float, float],
    ]
    """Takes camera coordinates (x right, y down, z forward) to the body's."""
    row_readout_s: float = 0.0
    """Time between the exposures of neighbouring rows; 0 for a global shutter [s]."""
    calibration: CalibrationTable | None = None
    """How well the lens is known, as ``firnline calibrate`` writes it."""


@dataclass(frozen=True, eq=False, repr=False)
class Camera(DataObject):
    """Lens, sensor and mounting.

    Parameters
    ----------
    model : {"pinhole", "fisheye"}
        OpenCV's lens models.
    width, height : int
        Size of the image [pixels].
    matrix : (3, 3) array_like
        Camera matrix [pixels]; pixel centres are whole numbers.
    distortion : (5,) array_like for pinhole, (4,) for fisheye
        k1, k2, p1, p2, k3, or k1 … k4.
    T_body_camera : (4, 4) array_like
        Takes camera coordinates (x right, y down, z forward) to body coordinates (x
        forward, y left, z up).
    row_readout_s : float
        Rolling shutter: time between neighbouring rows [s].
    distortion_is_assumed : bool
        Whether the lens coefficients are zero because nothing states them.

    Examples
    --------
    >>> camera = Camera("pinhole", 640, 480, [[400, 0, 320], [0, 400, 240], [0, 0, 1]], np.zeros(5), np.eye(4))
    >>> camera.project(np.array([[1.0, 0.5, 2.0]])).tolist()
    [[520.0, 340.0]]
    >>> camera.rays(np.array([[320.0, 240.0]])).tolist()
    [[0.0, 0.0, 1.0]]
    """

    model: Literal["pinhole", "fisheye"]
    width: int
    height: int
    matrix: FloatArray
    distortion: FloatArray
    T_body_camera: FloatArray
    row_readout_s: float = 0.0
    distortion_is_assumed: bool = False

    def __post_init__(self) -> None:
        n = {"pinhole": 5, "fisheye": 4}[self.model]
        object.__setattr__(self, "matrix", checked(self.matrix, (3, 3), "the camera matrix"))
        object.__setattr__(self, "distortion", checked(self.distortion, (n,), "the lens coefficients"))
        pose = checked(self.T_body_camera, (4, 4), "the camera's place on the body")
        object.__setattr__(self, "T_body_camera", pose)
        refuse_impossible_mounting(pose)
        refuse_impossible_matrix(self.matrix, self.width, self.height)

    def project(self, xyz_camera: FloatArray) -> FloatArray:
        """Project points in the camera frame to pixels.

        The fisheye model holds up to 90° off its axis, the pinhole model where the polynomial of
        OpenCV is one to one.

        Parameters
        ----------
        xyz_camera : (N, 3) array_like
            Points [m], camera frame.

        Returns
        -------
        (N, 2) ndarray
            Column and row [pixels]; NaN for points behind the camera.
        """
        points = np.asarray(xyz_camera, dtype=np.float64).reshape(-1, 3)
        pixels = np.full((len(points), 2), np.nan)
        ahead = points[:, 2] > 1e-9
        if ahead.any():
            pixels[ahead] = self._shown(points[ahead])
        return pixels

    def _shown(self, points: FloatArray) -> FloatArray:
        """Return the pixels (N, 2) of points (N, 3) ahead of the camera."""
        plane = points[:, :2] / points[:, 2:]
        if self.model == "fisheye":
            plane = _bent(plane, self.distortion)
        elif self.distortion.any():
            plane = _distorted(plane, self.distortion)
        shown: FloatArray = plane * np.diag(self.matrix)[:2] + self.matrix[:2, 2]
        return shown

    def rays(self, uv: FloatArray) -> FloatArray:
        """Return the viewing directions of pixels.

        Parameters
        ----------
        uv : (N, 2) array_like
            Column and row [pixels].

        Returns
        -------
        (N, 3) ndarray
            Unit vectors, camera frame; NaN for pixels at which a pinhole lens shows nothing, because
            its distortion folds nearer to the centre.
        """
        pixels = np.asarray(uv, dtype=np.float64).reshape(-1, 2)
        if len(pixels) == 0:
            return np.zeros((0, 3))
        rays = np.column_stack([self._plane(pixels), np.ones(len(pixels))])
        directions: FloatArray = rays / np.linalg.norm(rays, axis=1, keepdims=True)
        return directions

    def _plane(self, pixels: FloatArray) -> FloatArray:
        """Return where the rays of pixels (N, 2) meet the plane z = 1."""
        if self.model == "fisheye":
            import cv2

            seen = np.ascontiguousarray(pixels[:, None])
            plane = cv2.fisheye.undistortPoints(seen, self.matrix, self.distortion)
            return np.asarray(plane, dtype=np.float64).reshape(-1, 2)
        return undistort((pixels - self.matrix[:2, 2]) / np.diag(self.matrix)[:2], self.distortion)

    def scaled(self, factor: float) -> "Camera":
        """Return the same lens with another resolution.

        Parameters
        ----------
        factor : float
            New over old number of pixels per side.

        Returns
        -------
        Camera
            With the matrix of the new resolution.
        """
        matrix = self.matrix.copy()
        matrix[:2] *= factor
        matrix[:2, 2] += 0.5 * (factor - 1.0)  # pixel centres are whole numbers, edges lie at halves
        size = round(self.width * factor), round(self.height * factor)
        return replace(
            self, width=size[0], height=size[1], matrix=matrix, row_readout_s=self.row_readout_s / factor
        )

    def write(self, path: str | Path) -> None:
        """Write ``camera.toml``.

        Parameters
        ----------
        path : str or pathlib.Path
            The file.
        """
        content = {
            "model": self.model,
            "width": self.width,
            "height": self.height,
            "matrix": self.matrix.tolist(),
            **({} if self.distortion_is_assumed else {"distortion": self.distortion.tolist()}),
            "T_body_camera": self.T_body_camera.tolist(),
            "row_readout_s": self.row_readout_s,
        }
        write_text(path, tomlkit.dumps(content))

    @classmethod
    def read(cls, path: str | Path) -> Self:
        """Read ``camera.toml``.

        Parameters
        ----------
        path : str or pathlib.Path
            The file.

        Returns
        -------
        Camera
            The calibration.

        Raises
        ------
        InputError
            Missing, or the numbers describe no camera.
        ConfigError
            A key is missing, unknown or of the wrong kind.
        """
        file = existing_file(path, "the calibration")
        given = validated(CameraFile, read_toml(file), str(file))
        n = {"pinhole": 5, "fisheye": 4}[given.model]
        distortion = (0.0,) * n if given.distortion is None else given.distortion
        if len(distortion) != n:
            raise InputError(
                f"{file} gives {len(distortion)} distortion coefficients; a {given.model} lens has {n}."
            )
        try:
            return cls(
                given.model,
                given.width,
                given.height,
                np.array(given.matrix),
                np.array(distortion),
                np.array(given.T_body_camera),
                given.row_readout_s,
                distortion_is_assumed=given.distortion is None,
            )
        except InputError as error:
            raise InputError(f"{file}: {error}") from error


_N_ITERATIONS = 50
_CONVERGED = 1e-11  # of the plane z = 1
_ON_AXIS = 1e-8


def undistort(plane: FloatArray, coefficients: FloatArray) -> FloatArray:
    """Return the points of the plane z = 1 that the lens shows at distorted ones.

    `plane` (N, 2): distorted points of the plane z = 1. `coefficients` (5,): k1, k2, p1, p2, k3. Returns (N,
    2): undistorted points; NaN where the lens shows none: beyond the radius at which the radial polynomial
    stops to grow.

    >>> undistort(np.array([[0.5, 0.0], [0.9, 0.0]]), np.array([-0.3, 0.0, 0.0, 0.0, 0.0])).round(6).tolist()
    [[0.54988, 0.0], [nan, nan]]
    """
    found = plane.copy()
    if not coefficients.any():
        return found
    limit, active = fold_radius(coefficients), np.arange(len(plane))
    with np.errstate(all="ignore"):
        for _ in range(_N_ITERATIONS):
            off = plane[active] - _distorted(found[active], coefficients)
            slope = _distortion_slope(found[active], coefficients)
            found[active] += np.linalg.solve(_regular(slope), off[:, :, None])[:, :, 0]
            active = active[~(np.abs(off).max(axis=1) < _CONVERGED)]
            if not len(active):
                break
        found[active] = np.nan
        found[~(np.hypot(*found.T) < limit)] = np.nan
    return found


def fold_radius(coefficients: FloatArray) -> float:
    """Return the radius on the plane z = 1 beyond which the radial polynomial falls; infinite where it never does.

    `coefficients` (5,): k1, k2, p1, p2, k3.

    >>> round(fold_radius(np.array([-0.3, 0.0, 0.0, 0.0, 0.0])), 4)
    1.0541
    """
    k1, k2, _, _, k3 = coefficients.tolist()
    squares = np.roots([7.0 * k3, 5.0 * k2, 3.0 * k1, 1.0])
    real = squares.real[(np.abs(squares.imag) < 1e-9 * np.abs(squares)) & (squares.real > 0.0)]
    return float(np.sqrt(real.min())) if len(real) else np.inf


def _bent(plane: FloatArray, coefficients: FloatArray) -> FloatArray:
    """Return the points (N, 2) of the plane z = 1 as a fisheye lens shows them, by a polynomial of their angle (Kannala and Brandt 2006)."""
    k1, k2, k3, k4 = coefficients.tolist()
    radius = np.hypot(*plane.T)
    angle = np.arctan(radius)
    s = angle**2
    shown = angle * (1.0 + s * (k1 + s * (k2 + s * (k3 + s * k4))))
    factor = np.divide(shown, radius, out=np.ones_like(radius), where=radius > _ON_AXIS)
    bent: FloatArray = plane * factor[:, None]
    return bent


def _distorted(plane: FloatArray, coefficients: FloatArray) -> FloatArray:
    """Return the points (N, 2) of the plane z = 1 after distortion: radial and tangential polynomials of Brown (1966)."""
    k1, k2, p1, p2, k3 = coefficients.tolist()
    x, y = plane.T
    s = x**2 + y**2
    shown: FloatArray = plane * (1.0 + s * (k1 + s * (k2 + s * k3)))[:, None]
    shown[:, 0] += 2.0 * p1 * x * y + p2 * (s + 2.0 * x**2)
    shown[:, 1] += p1 * (s + 2.0 * y**2) + 2.0 * p2 * x * y
    return shown


def _distortion_slope(plane: FloatArray, coefficients: FloatArray) -> FloatArray:
    """Return how distorted points change with the undistorted ones (N, 2, 2)."""
    k1, k2, p1, p2, k3 = coefficients.tolist()
    x, y = plane.T
    s = x**2 + y**2
    radial = 1.0 + s * (k1 + s * (k2 + s * k3))
    by_s = 2.0 * (k1 + s * (2.0 * k2 + 3.0 * s * k3))
    slope = np.empty((len(plane), 2, 2))
    slope[:, 0, 0] = radial + by_s * x**2 + 2.0 * p1 * y + 6.0 * p2 * x
    slope[:, 1, 1] = radial + by_s * y**2 + 6.0 * p1 * y + 2.0 * p2 * x
    slope[:, 0, 1] = slope[:, 1, 0] = by_s * x * y + 2.0 * (p1 * x + p2 * y)
    return slope


def _regular(slope: FloatArray) -> FloatArray:
    """Return matrices (N, 2, 2) with those replaced that have no finite inverse: there is no solution there."""
    determinant = slope[:, 0, 0] * slope[:, 1, 1] - slope[:, 0, 1] * slope[:, 1, 0]
    is_bad = ~(np.abs(determinant) > 1e-12) | ~np.isfinite(determinant)
    return np.where(is_bad[:, None, None], np.eye(2), slope)


_LEAST_FOCAL = 0.1  # focal length over the width of the image; a fisheye lens of 180° has 0.3
_MOST_UNEQUAL = 1.3
_MOST_SKEW_PX = 1.0
_FARTHEST_M = 50.0
_TOLERANCE = 1e-6


# No lens is built farther from the middle of its sensor, in shares of the image; and of how much two shares of one scale differ.
_MOST_OFF_CENTRE, _SAME_SCALE = 0.2, 0.15


def off_centre_note(camera: Camera) -> str | None:
    """Return a note where the principal point is far from the middle of the image, with the scale that would explain it.

    >>> matrix = np.array([[150.0, 0, 80], [0, 150, 60], [0, 0, 1]])
    >>> off_centre_note(Camera("pinhole", 320, 240, matrix, np.zeros(5), np.eye(4)))
    'the principal point 80, 60 is far from the middle of 320 × 240 pixels, as in a calibration for images of 0.5 times this size: multiply fx, fy, cx and cy by 2 where it is one'
    """
    (_, _, cx), (_, _, cy), _ = camera.matrix.tolist()
    width, height = camera.width, camera.height
    off = max(abs((cx + 0.5) / width - 0.5), abs((cy + 0.5) / height - 0.5))
    if off <= _MOST_OFF_CENTRE:
        return None
    return (
        f"the principal point {cx:g}, {cy:g} is far from the middle of {width} × {height} pixels"
        f"{_of_other_size(cx, cy, width, height) or ', as in a part cut out of larger images'}"
    )


def _of_other_size(cx: float, cy: float, width: int, height: int) -> str:
    """Return in words of which size of images a principal point is the middle; empty where of none of this shape."""
    across, down = (2.0 * cx + 1.0) / width, (2.0 * cy + 1.0) / height
    if min(across, down) <= 0.0 or abs(across - down) > _SAME_SCALE * max(across, down):
        return ""
    scale = 0.5 * (across + down)
    return (
        f", as in a calibration for images of {scale:.2g} times this size: multiply fx, fy, cx and cy by {1.0 / scale:.2g} "
        "where it is one"
    )


def refuse_impossible_matrix(matrix: FloatArray, width: int, height: int) -> None:
    """Refuse a camera matrix (3, 3) that describes no lens in front of such an image.

    `matrix` (3, 3): camera matrix [pixels]. `width`, `height`: size of the image [pixels].

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
            f"the camera matrix has its principal point at {cx:g}, {cy:g}, outside of the image of {width} × {height} pixels"
            f"{_of_other_size(cx, cy, width, height)}; give the matrix for images of this size, with column before row."
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

    `pose` (4, 4): takes camera coordinates to body coordinates.

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
