"""Calibrated camera of a rover: projection, rays of its pixels, its file."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, Self

import numpy as np
import tomlkit

from survey.core.arrays import FloatArray, checked
from survey.core.config import Section, read_toml, validated
from survey.core.data_object import DataObject
from survey.core.errors import InputError
from survey.core.files.reading import existing_file
from survey.core.files.writing import replacing
from survey.data.camera.plausible import refuse_impossible_matrix, refuse_impossible_mounting
from survey.data.camera.radial import undistorted


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
        import cv2

        points = np.asarray(xyz_camera, dtype=np.float64).reshape(-1, 3)
        pixels = np.full((len(points), 2), np.nan)
        ahead = points[:, 2] > 1e-9
        if ahead.any():
            seen = np.ascontiguousarray(points[ahead, None, :])
            zero = np.zeros(3)
            if self.model == "fisheye":
                found, _ = cv2.fisheye.projectPoints(seen, zero, zero, self.matrix, self.distortion)
            else:
                found, _ = cv2.projectPoints(seen, zero, zero, self.matrix, self.distortion)
            pixels[ahead] = np.asarray(found).reshape(-1, 2)
        return pixels

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
        import cv2

        seen = np.ascontiguousarray(pixels[:, None])
        if self.model == "fisheye":
            plane = cv2.fisheye.undistortPoints(seen, self.matrix, self.distortion)
            return np.asarray(plane, dtype=np.float64).reshape(-1, 2)
        plane = cv2.undistortPoints(seen, self.matrix, np.zeros(5))
        return undistorted(np.asarray(plane, dtype=np.float64).reshape(-1, 2), self.distortion)

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
        with replacing(path) as draft:
            draft.write_text(tomlkit.dumps(content), encoding="utf-8")

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
