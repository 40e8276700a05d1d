"""Camera calibration: detect a board in images, fit the lens, reject bad views, state standard deviations.

`calibrate` returns a `CameraCalibration`, which writes ``camera.toml``. `calibration_figure` draws the residuals over the image, their
scatter, and the residual of each image.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from survey.core.arrays import BoolArray, FloatArray, Progress
from survey.core.errors import InputError
from survey.core.files import replacing
from survey.data.camera import Camera
from survey.figures.style import CLAIM, ESTIMATE, FULL_IN, MUTED, styled
from vision_slam.calibration.boards import Board, BoardView
from vision_slam.calibration.fit import (
    NAMES,
    LensFit,
    Model,
    coverage,
    fit_lens,
    parameter_covariance,
    refuse_few,
    refuse_one_sided,
    refuse_uncertain,
)
from vision_slam.odometry.tracks import grey_of
from vision_slam.readers.images import FORWARD, image_files, images_of
from vision_slam.readers.photos import checked_photos

# A view this many times worse than the median one, and worse than this many pixels, is blurred or misread.
_WORSE, _LEAST_BAD_PX = 3.0, 0.3
_MOST_REJECTED = 0.25


@dataclass(frozen=True, eq=False)
class CameraCalibration:
    """Calibrated lens with the standard deviation of each parameter.

    Parameters
    ----------
    camera : Camera
        The lens; its mounting is level and forward until it is measured.
    names : tuple of str
        Parameters: fx, fy, cx, cy [pixels] and lens coefficients.
    values, sigma : (P,) ndarray
        Values and standard deviations.
    fit : LensFit
        Residuals and board poses of the accepted views.
    views : tuple of BoardView
        Corners of the accepted views.
    accepted : tuple of Path
        Images of the accepted views.
    rejected : dict of str to str
        Reason by the name of an image.
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
        """Write ``camera.toml`` with a table ``[calibration]`` of the standard deviations.

        Parameters
        ----------
        path : str or pathlib.Path
            The file.

        Raises
        ------
        InputError
            The file cannot be written.
        """
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

    Parameters
    ----------
    images : path or sequence of Path
        Folder of images, or the files; all of one size.
    board : Board
        `vision_slam.calibration.boards.Chessboard` or `CharucoBoard`.
    model : {"pinhole", "fisheye"}
        Lens model; fisheye for angles of view above about 120°.
    progress : callable, optional
        Progress callback (stage, done, total).

    Returns
    -------
    CameraCalibration
        Camera, standard deviations, residuals, accepted and rejected images.

    Raises
    ------
    InputError
        No images, sizes that differ, or views that are too few, one-sided or untilted.
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
    """Draw the residuals of a calibration.

    Parameters
    ----------
    calibration : CameraCalibration
        Result of `vision_slam.calibration.calibrate.calibrate`.

    Returns
    -------
    matplotlib.figure.Figure
        Residuals as arrows over the image, their scatter about zero, and their root mean square in each
        image.
    """
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
