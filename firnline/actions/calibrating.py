"""Calibrate a camera from images of a board."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from firnline.actions.interface import (
    Argument,
    Option,
    Preview,
    Progress,
    WrittenResult,
    fact_line,
    no_progress,
    previewed_by,
    refuse_existing,
)
from firnline.actions.requests import PictureOptions
from survey.core import ConfigError

if TYPE_CHECKING:
    from vision_slam.calibration import Board, CameraCalibration


@dataclass(frozen=True, kw_only=True)
class CalibrateRequest(PictureOptions):
    """Images of a board from which a camera is calibrated."""

    images: Annotated[Path, Argument(help="Folder of images of the board, all of one size.")]
    board: Annotated[
        str | None, Option("--board", metavar="9x6", help="Inner corners of the chessboard, e.g. 9x6.")
    ] = None
    charuco: Annotated[
        str | None, Option("--charuco", metavar="8x5", help="ChArUco board of so many squares.")
    ] = None
    square_mm: Annotated[float, Option("--square-mm", min=0.1, help="Side of a square [mm].")] = 25.0
    marker_mm: Annotated[
        float | None, Option("--marker-mm", min=0.1, help="Side of a marker of a ChArUco board [mm].")
    ] = None
    dictionary: Annotated[str, Option("--dictionary", help="OpenCV's dictionary of a ChArUco board.")] = (
        "4X4_50"
    )
    model: Annotated[
        Literal["pinhole", "fisheye"],
        Option("--model", help="Lens model; fisheye for angles of view above about 120°."),
    ] = "pinhole"
    out: Annotated[
        Path, Option("--out", "-o", help="Calibration to write; a picture of the residuals stands beside it.")
    ] = Path("camera.toml")
    force: Annotated[bool, Option("--force", help="Replace an existing calibration.")] = False

    @property
    def files(self) -> list[Path]:
        """Calibration, and the picture of the residuals if one is drawn."""
        return [self.out] if self.no_pictures else [self.out, self.out.with_suffix(f".{self.pictures}")]

    def named_board(self) -> "Board":
        """Return the board that the options name.

        Raises
        ------
        ConfigError
            No board, two boards, or a board without its sizes.
        """
        from vision_slam.calibration import CharucoBoard, Chessboard

        board, charuco, marker_mm = self.board, self.charuco, self.marker_mm
        if (board is None) == (charuco is None):
            raise ConfigError(
                "one board was expected; name --board 9x6 (inner corners) or --charuco 8x5 (squares)."
            )
        if board is not None:
            if marker_mm is not None:
                raise ConfigError("a chessboard has no markers; leave --marker-mm out, or name --charuco.")
            return Chessboard(*_counts(board, "--board"), 1e-3 * self.square_mm)
        if marker_mm is None:
            raise ConfigError("a ChArUco board has markers; name their side with --marker-mm.")
        sizes = (1e-3 * self.square_mm, 1e-3 * marker_mm)
        return CharucoBoard(*_counts(charuco or "", "--charuco"), *sizes, self.dictionary)


@dataclass(frozen=True)
class CalibrationResult(WrittenResult):
    """Lens of a camera.

    Parameters
    ----------
    request : CalibrateRequest
        What was asked for.
    calibration : CameraCalibration
        The lens, with the standard deviation of each parameter.
    """

    request: CalibrateRequest
    calibration: "CameraCalibration"

    def _write_files(self) -> None:
        """Write the calibration, and a picture of the residuals beside it."""
        self.calibration.write(self.request.out)
        from vision_slam.calibration import calibration_figure

        out = self.request.out
        self.request.write_pictures(out.parent, lambda: {out.stem: calibration_figure(self.calibration)})

    def facts(self) -> dict[str, Any]:
        """Return parameters, residuals and coverage."""
        return dict(self.calibration.summary)

    def lines(self) -> list[str]:
        """Return parameters, images, and the next step."""
        calibration = self.calibration
        camera, lens_fit = calibration.camera, calibration.fit
        lens = (
            f"{camera.width} × {camera.height} pixels, {camera.model}, RMS {lens_fit.rms_px:.3f} pixels, "
            f"{100.0 * calibration.coverage:.0f} % of the image reached"
        )
        lines = [f"written to {', '.join(map(str, self.request.files))}", fact_line("lens", lens)]
        for name, value, sigma in zip(calibration.names, calibration.values, calibration.sigma, strict=True):
            digits = 2 if name[0] in "fc" else 5
            lines.append(fact_line(name, f"{value:.{digits}f} ± {sigma:.{digits}f}"))
        for file, rms in zip(calibration.accepted, lens_fit.view_rms_px, strict=True):
            lines.append(fact_line("used", f"{file.name}: {rms:.3f} pixels"))
        lines += [fact_line("left out", f"{name}: {reason}") for name, reason in calibration.rejected.items()]
        return [*lines, fact_line("next", f"firnline localize IMAGES --camera {self.request.out}")]


def preview_calibration(request: CalibrateRequest) -> Preview:
    """Check the board and count the images."""
    from vision_slam.readers.images import image_files

    _checked_board(request)
    return Preview.of(request.files, {"images": len(image_files(request.images))})


@previewed_by(preview_calibration)
def calibrate(request: CalibrateRequest, progress: Progress = no_progress) -> CalibrationResult:
    """Calibrate a camera from images of a chessboard or a ChArUco board.

    Parameters
    ----------
    request : CalibrateRequest
        Images and board.
    progress : callable
        Called with what is done, how many are done, and how many there are.

    Returns
    -------
    CalibrationResult
        The lens; `CalibrationResult.write` writes it.

    Raises
    ------
    InputError
        Images that show no board, or an output that exists.
    ConfigError
        No board, or one without its sizes.
    """
    from vision_slam.calibration import calibrate as calibrated

    board = _checked_board(request)
    return CalibrationResult(
        request, calibrated(request.images, board, model=request.model, progress=progress)
    )


def _checked_board(request: CalibrateRequest) -> "Board":
    board = request.named_board()
    refuse_existing(request.files, force=request.force, inputs=[request.images])
    return board


def _counts(text: str, option: str) -> tuple[int, int]:
    """Return the two numbers of a text such as 9x6."""
    parts = text.lower().replace("×", "x").split("x")
    if len(parts) != 2 or not all(part.strip().isdigit() for part in parts):
        raise ConfigError(f"{option} is {text!r}; two numbers such as 9x6 were expected.")
    return int(parts[0]), int(parts[1])
