"""Least-squares fit of lens and board poses to the corners of all views, and requirements on the views.

`fit_lens` fits OpenCV's pinhole or fisheye model, and `parameter_covariance` gives its standard deviations. The requirements are at
least eight views, corners in half of the image area, three tilted views, and a focal length determined to 2 %.
"""

from collections.abc import Sequence
from typing import Literal, NamedTuple

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.core.files import first_line
from vision_slam.calibration.boards import BoardView

Model = Literal["pinhole", "fisheye"]
NAMES: dict[Model, tuple[str, ...]] = {
    "pinhole": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"),
    "fisheye": ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4"),
}
"""Parameters of each lens model, in the order of `LensFit.parameters`."""
_STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-9)


class LensFit(NamedTuple):
    """Fitted lens: parameters (P,), board poses as rotation vectors and shifts (N, 6), residuals of each view [pixels]."""

    model: Model
    parameters: FloatArray
    poses: FloatArray
    residuals: tuple[FloatArray, ...]

    @property
    def matrix(self) -> FloatArray:
        """Camera matrix (3, 3)."""
        fx, fy, cx, cy = self.parameters[:4]
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    @property
    def view_rms_px(self) -> FloatArray:
        """Root mean square of the residuals of each view (N,) [pixels]."""
        return np.array([float(np.sqrt(np.mean(np.sum(part**2, axis=1)))) for part in self.residuals])

    @property
    def rms_px(self) -> float:
        """Root mean square of all residuals [pixels]."""
        return float(np.sqrt(np.mean(np.sum(np.concatenate(self.residuals) ** 2, axis=1))))


def fit_lens(views: Sequence[BoardView], size: tuple[int, int], model: Model) -> LensFit:
    """Fit a lens to views of a board.

    Parameters
    ----------
    views : sequence of BoardView
        At least three.
    size : tuple of int
        Width and height of the images [pixels].
    model : {"pinhole", "fisheye"}
        OpenCV's lens model.

    Returns
    -------
    LensFit
        The least-squares solution.

    Raises
    ------
    InputError
        The views determine no lens.
    """
    places = [np.column_stack([view.board, np.zeros(len(view.board))]) for view in views]
    try:
        matrix, lens, turns, shifts = _solved(places, [view.pixels for view in views], size, model)
    except cv2.error as error:
        raise InputError(
            f"the {len(views)} views of the board determine no {model} lens ({first_line(error)}); take more views, tilted in "
            "several directions."
        ) from error
    parameters = np.r_[matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], lens]
    poses = np.column_stack([turns, shifts])
    residuals = tuple(
        view.pixels - _projected(place, pose, matrix, lens, model)
        for view, place, pose in zip(views, places, poses, strict=True)
    )
    return LensFit(model, parameters, poses, residuals)


def _solved(
    places: list[FloatArray], pixels: list[FloatArray], size: tuple[int, int], model: Model
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return camera matrix, lens coefficients, rotation vectors (N, 3) and shifts (N, 3) by OpenCV."""
    if model == "fisheye":
        flags = cv2.CALIB_RECOMPUTE_EXTRINSIC | cv2.CALIB_FIX_SKEW
        _, matrix, lens, turns, shifts = cv2.fisheye.calibrate(
            [place[None] for place in places],
            [pixel[None] for pixel in pixels],
            size,
            np.eye(3),
            np.zeros((4, 1)),
            flags=flags,
            criteria=_STOP,
        )
    else:
        _, matrix, lens, turns, shifts = cv2.calibrateCamera(
            [place.astype(np.float32) for place in places],
            [pixel.astype(np.float32) for pixel in pixels],
            size,
            np.eye(3),
            np.zeros(5),
            criteria=_STOP,
        )
    return (
        np.asarray(matrix, dtype=np.float64),
        np.asarray(lens, dtype=np.float64).ravel(),
        np.asarray(turns, dtype=np.float64).reshape(-1, 3),
        np.asarray(shifts, dtype=np.float64).reshape(-1, 3),
    )


def _projected(
    place: FloatArray, pose: FloatArray, matrix: FloatArray, lens: FloatArray, model: Model
) -> FloatArray:
    """Return pixels (K, 2) of places on a board."""
    project = cv2.fisheye.projectPoints if model == "fisheye" else cv2.projectPoints
    found, _ = project(place[:, None], pose[:3], pose[3:], matrix, lens)
    return np.asarray(found, dtype=np.float64).reshape(-1, 2)


def parameter_covariance(fit: LensFit, views: Sequence[BoardView]) -> FloatArray:
    r"""Return the covariance (P, P) of the lens parameters, with residuals that may be correlated within a view.

    With the Jacobian :math:`J_v` of view v after its own pose has been eliminated, its
    residuals :math:`r_v` and :math:`A = \sum_v J_v^T J_v`, the covariance is that of
    independent residuals of variance s², :math:`s^2 A^{-1}`, widened in each parameter to the
    linearized jackknife over views (MacKinnon and White, 1985)

    .. math:: \frac{N - 1}{N} A^{-1} \Big(\sum_v g_v g_v^T\Big) A^{-1},
              \qquad g_v = (I - J_v^T J_v A^{-1})^{-1} J_v^T r_v,

    where that is larger: blur, the board's own flatness and a lens that the model does not quite fit
    err alike in neighbouring corners.

    Parameters
    ----------
    fit : LensFit
        Result of `fit_lens`.
    views : sequence of BoardView
        The same views.

    Returns
    -------
    (P, P) ndarray
        Covariance, in squared units of the parameters.
    """
    reduced = [_reduced(fit, view, pose) for view, pose in zip(views, fit.poses, strict=True)]
    blocks = [jacobian.T @ jacobian for jacobian in reduced]
    inverse = np.linalg.pinv(np.sum(blocks, axis=0), hermitian=True)
    n, identity = len(views), np.eye(len(inverse))
    scores = [
        np.linalg.solve(identity - block @ inverse, jacobian.T @ residual.ravel())
        for block, jacobian, residual in zip(blocks, reduced, fit.residuals, strict=True)
    ]
    n_free = max(2 * sum(map(len, fit.residuals)) - 6 * n - len(fit.parameters), 1)
    variance = sum(float(np.sum(part**2)) for part in fit.residuals) / n_free
    independent = variance * inverse
    spread = np.sum([np.outer(score, score) for score in scores], axis=0)
    jackknife = (n - 1) / n * inverse @ spread @ inverse
    widened = np.sqrt(np.maximum(np.diagonal(jackknife) / np.diagonal(independent), 1.0))
    covariance: FloatArray = independent * np.outer(widened, widened)
    return covariance


def _reduced(fit: LensFit, view: BoardView, pose: FloatArray) -> FloatArray:
    """Return the Jacobian (2 K, P) of a view's pixels by the lens, without what its own pose can take up."""
    place = np.column_stack([view.board, np.zeros(len(view.board))])
    n = len(fit.parameters)
    both = np.r_[fit.parameters, pose]
    steps = 1e-6 * np.maximum(np.abs(both), 1e-2)
    columns = []
    for k, step in enumerate(steps):
        ends = []
        for sign in (1.0, -1.0):
            at = both.copy()
            at[k] += sign * step
            matrix = np.array([[at[0], 0.0, at[2]], [0.0, at[1], at[3]], [0.0, 0.0, 1.0]])
            ends.append(_projected(place, at[n:], matrix, at[4:n], fit.model).ravel())
        columns.append((ends[0] - ends[1]) / (2.0 * step))
    jacobian = np.column_stack(columns)
    basis, _ = np.linalg.qr(jacobian[:, n:])
    lens: FloatArray = jacobian[:, :n] - basis @ (basis.T @ jacobian[:, :n])
    return lens


LEAST_VIEWS = 8
LEAST_COVERAGE = 0.5
_CELLS = 6
_LEAST_TILT_DEG, _LEAST_TILTED = 12.0, 3
_LARGEST_FOCAL_SHARE = 0.02


def coverage(views: Sequence[BoardView], size: tuple[int, int]) -> float:
    """Return the share of the image area, in cells of a sixth of its sides, that corners have reached.

    Examples
    --------
    >>> corners = np.array([[10.0, 10.0], [590.0, 390.0]])
    >>> round(coverage([BoardView(corners, corners)], (600, 400)), 3)
    0.056
    """
    return float(_reached(views, size).mean())


def _reached(views: Sequence[BoardView], size: tuple[int, int]) -> FloatArray:
    """Return which cells (6, 6) of the image, from the upper left one, hold corners."""
    cells = np.zeros((_CELLS, _CELLS))
    for view in views:
        at = np.clip((view.pixels + 0.5) / size * _CELLS, 0, _CELLS - 1).astype(int)
        cells[at[:, 1], at[:, 0]] = 1.0
    return cells


def tilts_deg(poses: FloatArray) -> FloatArray:
    """Return by how much each board is tilted out of the image plane, about its x and y axes (N, 2) [deg]."""
    normals = Rotation.from_rotvec(poses[:, :3]).as_matrix()[:, :, 2]
    normals = normals * np.sign(normals[:, 2:])
    angles: FloatArray = np.degrees(np.arctan2(normals[:, :2], normals[:, 2:]))
    return angles


def refuse_few(n_views: int, n_images: int, rejected: Sequence[str]) -> None:
    """Refuse fewer than eight views of the board.

    Raises
    ------
    InputError
        Counts what was found, and names the first rejected images.
    """
    if n_views < LEAST_VIEWS:
        named = f" ({'; '.join(rejected[:3])}{' …' if len(rejected) > 3 else ''})" if rejected else ""
        raise InputError(
            f"the board was found in {n_views} of {n_images} images{named}; at least {LEAST_VIEWS} views were expected: check "
            "the number of corners, and take sharp images of the complete board."
        )


def refuse_one_sided(views: Sequence[BoardView], poses: FloatArray, size: tuple[int, int]) -> None:
    """Refuse views that leave half of the image out, or that all face the board.

    Raises
    ------
    InputError
        Names what is missing.
    """
    cells = _reached(views, size)
    if cells.mean() < LEAST_COVERAGE:
        raise InputError(
            f"the board has reached {100.0 * cells.mean():.0f} % of the image area, and least in the {_emptiest(cells)}; move it "
            f"through all of the image, at least {100.0 * LEAST_COVERAGE:.0f} %."
        )
    tilted = np.abs(tilts_deg(poses)) > _LEAST_TILT_DEG
    if tilted.any(axis=1).sum() < _LEAST_TILTED:
        raise InputError(
            f"{tilted.any(axis=1).sum()} of {len(views)} views are tilted by more than {_LEAST_TILT_DEG:.0f}°, so that focal "
            f"length and distance cannot be separated; tilt the board by 20 to 45° in at least {_LEAST_TILTED} views."
        )


def refuse_uncertain(parameters: FloatArray, sigma: FloatArray) -> None:
    """Refuse a focal length with a standard deviation above 2 %.

    Raises
    ------
    InputError
        States the standard deviation.
    """
    share = float((sigma[:2] / parameters[:2]).max())
    if not share <= _LARGEST_FOCAL_SHARE:
        raise InputError(
            f"the views determine the focal length to {100.0 * share:.1f} % alone, {100.0 * _LARGEST_FOCAL_SHARE:.0f} % "
            "were expected; add views that are tilted in other directions, nearer, and in the corners of the image."
        )


def _emptiest(cells: FloatArray) -> str:
    """Return the quarter of the image with the fewest cells that were reached."""
    half = _CELLS // 2
    quarters = {
        "upper left": cells[:half, :half],
        "upper right": cells[:half, half:],
        "lower left": cells[half:, :half],
        "lower right": cells[half:, half:],
    }
    return min(quarters, key=lambda name: float(quarters[name].mean()))
