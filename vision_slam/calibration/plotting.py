"""Figure of a calibration: residuals over the image, their scatter, and the residual of each image."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from survey.figures.style import CLAIM, ESTIMATE, FULL_IN, MUTED, styled
from vision_slam.calibration.calibrate import CameraCalibration

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
