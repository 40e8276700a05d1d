"""Camera calibration from images of a chessboard or a ChArUco board.

A `Board` finds its corners in an image. `fit_lens` fits OpenCV's pinhole or fisheye model and the poses of the board to
the corners of all views by least squares, and `parameter_covariance` gives the standard deviations. The requirements are
at least eight views, corners in half of the image area, three tilted views, and a focal length determined to 2 %.
`calibrate` detects the board, fits the lens, rejects bad views and returns a `CameraCalibration`, which writes
``camera.toml``. `calibration_figure` draws the residuals over the image, their scatter, and the residual of each image.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple, Protocol

import cv2
import numpy as np
import tomlkit
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from survey import Camera, ConfigError, InputError
from survey.core import BoolArray, FloatArray, Progress, first_line, replacing
from survey.data.frames import Image
from survey.figures.style import CLAIM, ESTIMATE, FULL_IN, MUTED, styled
from vision_slam.odometry.tracks import grey_of
from vision_slam.readers.calibrations import FORWARD
from vision_slam.readers.images import image_files, images_of
from vision_slam.readers.photos import checked_photos

_SEARCHED_PX = 1600  # chessboards are searched in images of this width, and refined in the full ones
_LEAST_CORNERS = 8


class BoardView(NamedTuple):
    """Corners of a board in one image: places on the board (K, 2) [m], and pixels (K, 2)."""

    board: FloatArray
    pixels: FloatArray


class Board(Protocol):
    """Calibration board."""

    def detect(self, grey: Image) -> BoardView | None:
        """Return the board's corners in a grey image; None where it is not found."""
        ...


@dataclass(frozen=True)
class Chessboard:
    """Chessboard of ``columns`` × ``rows`` inner corners.

    `columns`, `rows`: inner corners, one less than squares in each direction. `square_m`: side of a square
    [m]; the calibration does not depend on it.
    """

    columns: int
    rows: int
    square_m: float = 0.025

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < 3 or not self.square_m > 0.0:
            raise ConfigError(
                f"a board of {self.columns} × {self.rows} inner corners of {self.square_m:g} m was named; at least "
                "3 × 3 corners and squares above 0 were expected."
            )

    def detect(self, grey: Image) -> BoardView | None:
        """Return the board's corners in a grey image; None where not all of them are found.

        `grey` (H, W): the image.
        """
        factor = min(_SEARCHED_PX / grey.shape[1], 1.0)
        small = (
            cv2.resize(grey, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
            if factor < 1.0
            else grey
        )
        size, exact = (self.columns, self.rows), cv2.CALIB_CB_ACCURACY
        found, corners = cv2.findChessboardCornersSB(small, size, flags=exact)
        if not found:
            found, corners = cv2.findChessboardCornersSB(small, size, flags=exact | cv2.CALIB_CB_EXHAUSTIVE)
        if not found:
            return None
        pixels = (np.asarray(corners, dtype=np.float64).reshape(-1, 2) + 0.5) / factor - 0.5
        if factor < 1.0:
            pixels = _refined(grey, pixels)
        places = np.mgrid[: self.columns, : self.rows].T.reshape(-1, 2) * self.square_m
        return BoardView(places.astype(np.float64), pixels)


@dataclass(frozen=True)
class CharucoBoard:
    """Chessboard with ArUco markers in its white squares; parts of it may be hidden.

    `columns`, `rows`: squares in each direction. `square_m`, `marker_m`: sides of a square and of a marker
    [m]; the calibration depends on their ratio alone. `dictionary`: OpenCV's dictionary of markers, without
    ``DICT_``: ``4X4_50``, ``5X5_100``, ….
    """

    columns: int
    rows: int
    square_m: float
    marker_m: float
    dictionary: str = "4X4_50"

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < 3 or not 0.0 < self.marker_m < self.square_m:
            raise ConfigError(
                f"a ChArUco board of {self.columns} × {self.rows} squares of {self.square_m:g} m with markers of "
                f"{self.marker_m:g} m was named; at least 3 × 3 squares and smaller markers were expected."
            )
        if not hasattr(cv2.aruco, f"DICT_{self.dictionary}"):
            raise ConfigError(
                f"there is no dictionary of markers {self.dictionary!r}; name one of OpenCV's, such as 4X4_50 or 6X6_250."
            )

    @property
    def board(self) -> Any:
        """OpenCV's board."""
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{self.dictionary}"))
        return cv2.aruco.CharucoBoard((self.columns, self.rows), self.square_m, self.marker_m, dictionary)

    def detect(self, grey: Image) -> BoardView | None:
        """Return the board's corners in a grey image; None where fewer than eight are found.

        `grey` (H, W): the image.
        """
        board = self.board
        corners, ids, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(grey)
        if ids is None or len(ids) < _LEAST_CORNERS:
            return None
        places = np.asarray(board.getChessboardCorners(), dtype=np.float64)[np.asarray(ids).ravel(), :2]
        return BoardView(places, np.asarray(corners, dtype=np.float64).reshape(-1, 2))


def _refined(grey: Image, pixels: FloatArray) -> FloatArray:
    """Refine corners in the full image, within a third of the distance to their neighbours."""
    spacing = float(np.linalg.norm(np.diff(pixels, axis=0), axis=1).min())
    half = int(np.clip(spacing / 3.0, 3, 15))
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-3)
    corners = np.ascontiguousarray(pixels[:, None, :], dtype=np.float32)
    found = cv2.cornerSubPix(grey, corners, (half, half), (-1, -1), stop)
    return np.asarray(found, dtype=np.float64).reshape(-1, 2)


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

    `size`: width and height of the images [pixels].
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

    Returns (P, P): covariance, in squared units of the parameters.
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
    """Refuse fewer than eight views of the board."""
    if n_views < LEAST_VIEWS:
        named = f" ({'; '.join(rejected[:3])}{' …' if len(rejected) > 3 else ''})" if rejected else ""
        raise InputError(
            f"the board was found in {n_views} of {n_images} images{named}; at least {LEAST_VIEWS} views were expected: check "
            "the number of corners, and take sharp images of the complete board."
        )


def refuse_one_sided(views: Sequence[BoardView], poses: FloatArray, size: tuple[int, int]) -> None:
    """Refuse views that leave half of the image out, or that all face the board."""
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
    """Refuse a focal length with a standard deviation above 2 %."""
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


# A view this many times worse than the median one, and worse than this many pixels, is blurred or misread.
_WORSE, _LEAST_BAD_PX = 3.0, 0.3
_MOST_REJECTED = 0.25


@dataclass(frozen=True, eq=False)
class CameraCalibration:
    """Calibrated lens with the standard deviation of each parameter.

    `camera`: the lens; its mounting is level and forward until it is measured. `names`: parameters: fx, fy,
    cx, cy [pixels] and lens coefficients. `values`, `sigma` (P,): values and standard deviations. `fit`:
    residuals and board poses of the accepted views. `views`: corners of the accepted views. `accepted`:
    images of the accepted views. `rejected`: reason by the name of an image.
    """

    camera: Camera
    names: tuple[str, ...]
    values: FloatArray
    sigma: FloatArray
    fit: LensFit
    views: tuple[BoardView, ...]
    accepted: tuple[Path, ...]
    rejected: dict[str, str]

    @property
    def coverage(self) -> float:
        """Share of the image area that corners have reached."""
        return coverage(self.views, (self.camera.width, self.camera.height))

    @property
    def summary(self) -> dict[str, Any]:
        """Figures of the calibration, for printing and JSON."""
        return {
            "images": len(self.accepted) + len(self.rejected),
            "views": len(self.accepted),
            "rms_px": self.fit.rms_px,
            "coverage": self.coverage,
            "parameters": dict(zip(self.names, self.values.tolist(), strict=True)),
            "sigma": dict(zip(self.names, self.sigma.tolist(), strict=True)),
            "view_rms_px": {
                file.name: float(rms)
                for file, rms in zip(self.accepted, self.fit.view_rms_px.tolist(), strict=True)
            },
            "rejected": self.rejected,
        }

    def write(self, path: str | Path) -> None:
        """Write ``camera.toml`` with a table ``[calibration]`` of the standard deviations."""
        report = {
            "views": len(self.accepted),
            "rms_px": round(self.fit.rms_px, 4),
            "coverage": round(self.coverage, 3),
            "sigma": {name: float(f"{s:.4g}") for name, s in self.summary["sigma"].items()},
        }
        with replacing(path) as draft:
            self.camera.write(draft)
            with draft.open("a", encoding="utf-8") as file:
                file.write("\n" + tomlkit.dumps({"calibration": report}))


def calibrate(
    images: str | Path | Sequence[Path],
    board: Board,
    *,
    model: Model = "pinhole",
    progress: Progress | None = None,
) -> CameraCalibration:
    """Calibrate a camera from images of a board.

    Views whose residuals are more than three times those of the median view are left out. What it cannot
    do: a board that is not flat, a lens whose focus changes between the images, the mounting on the rover.
    """
    files = _files(images)
    size = checked_photos(files)[0].upright_size
    accepted, views, rejected = _views(files, board, size, progress)
    refuse_few(len(views), len(files), [f"{name}: {reason}" for name, reason in rejected.items()])
    fit = fit_lens(views, size, model)
    good = _good(fit.view_rms_px)
    if not good.all():
        for k in np.flatnonzero(~good).tolist():
            rejected[accepted[k].name] = f"residuals of {fit.view_rms_px[k]:.2f} pixels, blurred or misread"
        accepted = [file for file, is_good in zip(accepted, good, strict=True) if is_good]
        views = [view for view, is_good in zip(views, good, strict=True) if is_good]
        refuse_few(len(views), len(files), [f"{name}: {reason}" for name, reason in rejected.items()])
        fit = fit_lens(views, size, model)
    refuse_one_sided(views, fit.poses, size)
    sigma = np.sqrt(np.diagonal(parameter_covariance(fit, views)))
    refuse_uncertain(fit.parameters, sigma)
    camera = Camera(model, *size, fit.matrix, fit.parameters[4:], FORWARD)
    return CameraCalibration(
        camera, NAMES[model], fit.parameters, sigma, fit, tuple(views), tuple(accepted), rejected
    )


def _files(images: str | Path | Sequence[Path]) -> list[Path]:
    if not isinstance(images, str | Path):
        return list(images)
    place = Path(images)
    if not place.is_dir():
        raise InputError(f"{place} is no folder; name the folder with images of the board.")
    files = image_files(place) or image_files(place / "images")
    if not files:
        raise InputError(
            f"{place} holds no images (PNG, JPEG, TIFF); name the folder with images of the board."
        )
    return files


def _views(
    files: list[Path], board: Board, size: tuple[int, int], progress: Progress | None
) -> tuple[list[Path], list[BoardView], dict[str, str]]:
    """Return the images in which the board is found, its corners, and the reason for each other image."""
    images = images_of(files)
    accepted, views, rejected = list[Path](), list[BoardView](), dict[str, str]()
    for k, file in enumerate(files):
        view = board.detect(grey_of(images[k], *size))
        if view is None:
            rejected[file.name] = "board not found"
        else:
            accepted.append(file)
            views.append(view)
        if progress is not None:
            progress("board", k + 1, len(files))
    return accepted, views, rejected


def _good(rms_px: FloatArray) -> BoolArray:
    """Return which views (N,) are not much worse than the median one; at most a quarter is left out."""
    limit = max(_WORSE * float(np.median(rms_px)), _LEAST_BAD_PX)
    limit = max(limit, float(np.quantile(rms_px, 1.0 - _MOST_REJECTED)))
    good: BoolArray = rms_px <= limit
    return good


_ARROW_SHARE = 0.04  # of the image's width, for a residual of twice the RMS


@styled
def calibration_figure(calibration: CameraCalibration) -> Figure:
    """Draw the residuals of a calibration."""
    figure = Figure(figsize=(FULL_IN, 0.62 * FULL_IN), layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=(2.0, 1.0))
    _draw_over_image(figure.add_subplot(grid[:, 0]), calibration)
    _draw_scatter(figure.add_subplot(grid[0, 1]), calibration)
    _draw_images(figure.add_subplot(grid[1, 1]), calibration)
    return figure


def _draw_over_image(axes: Axes, calibration: CameraCalibration) -> None:
    camera, fit = calibration.camera, calibration.fit
    pixels = np.concatenate([view.pixels for view in calibration.views])
    residuals = np.concatenate(fit.residuals)
    scale = _ARROW_SHARE * camera.width / (2.0 * fit.rms_px)
    axes.quiver(
        *pixels.T, *residuals.T, color=ESTIMATE, angles="xy", scale_units="xy", scale=1.0 / scale, width=0.002
    )
    axes.plot(*camera.matrix[:2, 2], "+", color=CLAIM, markersize=10)
    axes.set(xlim=(-0.5, camera.width - 0.5), ylim=(camera.height - 0.5, -0.5), aspect="equal")
    axes.set(xlabel="column [pixels]", ylabel="row [pixels]")
    axes.set_title(
        f"Residuals, enlarged {scale:.0f} times; {100.0 * calibration.coverage:.0f} % of the image reached"
    )


def _draw_scatter(axes: Axes, calibration: CameraCalibration) -> None:
    residuals = np.concatenate(calibration.fit.residuals)
    axes.plot(*residuals.T, ".", color=ESTIMATE, markersize=1.5)
    reach = 1.1 * float(np.abs(residuals).max())
    axes.axhline(0.0, color=MUTED, linewidth=0.6)
    axes.axvline(0.0, color=MUTED, linewidth=0.6)
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
    axes.set(xlabel="along rows [pixels]", ylabel="along columns [pixels]")
    axes.set_title(f"RMS {calibration.fit.rms_px:.3f} pixels")


def _draw_images(axes: Axes, calibration: CameraCalibration) -> None:
    rms = calibration.fit.view_rms_px
    axes.bar(np.arange(1, len(rms) + 1), rms, color=CLAIM)
    axes.set(xlabel="image", ylabel="RMS [pixels]")
    axes.set_title(f"{len(rms)} images used, {len(calibration.rejected)} left out")
