"""``firnline calibrate``: lens of a camera from images of a board."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from firnline.actions.interface import DryRun, Json, Quiet, end_dry_run, fact_line
from firnline.cli.outcome import with_exit_codes

if TYPE_CHECKING:
    from vision_slam.calibration.boards import Board
    from vision_slam.calibration.calibrate import CameraCalibration

_Images = Annotated[Path, typer.Argument(help="Folder of images of the board, all of one size.")]
_Board = Annotated[
    str | None, typer.Option("--board", metavar="9x6", help="Inner corners of the chessboard, e.g. 9x6.")
]
_Charuco = Annotated[
    str | None, typer.Option("--charuco", metavar="8x5", help="ChArUco board of so many squares.")
]
_Square = Annotated[float, typer.Option("--square-mm", min=0.1, help="Side of a square [mm].")]
_Marker = Annotated[
    float | None, typer.Option("--marker-mm", min=0.1, help="Side of a marker of a ChArUco board [mm].")
]
_Dictionary = Annotated[str, typer.Option("--dictionary", help="OpenCV's dictionary of a ChArUco board.")]
_Model = Annotated[
    Literal["pinhole", "fisheye"],
    typer.Option("--model", help="Lens model; fisheye for angles of view above about 120°."),
]
_Out = Annotated[
    Path,
    typer.Option("--out", "-o", help="Calibration to write; a picture of the residuals stands beside it."),
]
_Force = Annotated[bool, typer.Option("--force", help="Replace an existing calibration.")]


@with_exit_codes
def calibrate(
    images: _Images,
    board: _Board = None,
    charuco: _Charuco = None,
    square_mm: _Square = 25.0,
    marker_mm: _Marker = None,
    dictionary: _Dictionary = "4X4_50",
    model: _Model = "pinhole",
    out: _Out = Path("camera.toml"),
    force: _Force = False,
    dry_run: DryRun = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Calibrate a camera from images of a chessboard or a ChArUco board.

    For example:

      firnline calibrate board-photos --board 9x6 --square-mm 25

      firnline calibrate board-photos --charuco 8x5 --square-mm 30 --marker-mm 22 --dictionary 5X5_100

      firnline localize my-images --camera camera.toml

    Take 15 to 30 sharp images of a flat board, with the focus and zoom of the survey: move it through all of the
    image, corners included, and tilt it by 20 to 45 degrees in several directions. Written are camera.toml, with
    the standard deviation of each parameter, and a picture of the residuals (camera.png). The mounting in it
    (T_body_camera) is level and forward until you correct it.
    """
    from firnline.actions.files import refuse_existing
    from firnline.cli.progress import counted
    from survey.core.files.writing import replacing
    from survey.figures import png_bytes
    from vision_slam.calibration.calibrate import calibrate as calibrated
    from vision_slam.calibration.plotting import calibration_figure
    from vision_slam.io.sequence_files import image_files

    picture = out.with_suffix(".png")
    wanted = _board(board, charuco, square_mm, marker_mm, dictionary)
    refuse_existing([out, picture], force=force, inputs=[images])
    if dry_run:
        end_dry_run([out, picture], {"images": len(image_files(images))})
    with counted(quiet=quiet) as progress:
        calibration = calibrated(images, wanted, model=model, progress=progress)
    calibration.write(out)
    with replacing(picture) as draft:
        draft.write_bytes(png_bytes(calibration_figure(calibration)))
    if as_json:
        typer.echo(json.dumps(calibration.summary, indent=2))
    else:
        typer.echo("\n".join(_lines(calibration, out, picture)))


def _board(
    board: str | None, charuco: str | None, square_mm: float, marker_mm: float | None, dictionary: str
) -> "Board":
    """Return the board that the options name."""
    from survey.core.errors import ConfigError
    from vision_slam.calibration.boards import CharucoBoard, Chessboard

    if (board is None) == (charuco is None):
        raise ConfigError(
            "one board was expected; name --board 9x6 (inner corners) or --charuco 8x5 (squares)."
        )
    if board is not None:
        if marker_mm is not None:
            raise ConfigError("a chessboard has no markers; leave --marker-mm out, or name --charuco.")
        return Chessboard(*_counts(board, "--board"), 1e-3 * square_mm)
    if marker_mm is None:
        raise ConfigError("a ChArUco board has markers; name their side with --marker-mm.")
    return CharucoBoard(*_counts(charuco or "", "--charuco"), 1e-3 * square_mm, 1e-3 * marker_mm, dictionary)


def _counts(text: str, option: str) -> tuple[int, int]:
    """Return the two numbers of a text such as 9x6."""
    from survey.core.errors import ConfigError

    parts = text.lower().replace("×", "x").split("x")
    if len(parts) != 2 or not all(part.strip().isdigit() for part in parts):
        raise ConfigError(f"{option} is {text!r}; two numbers such as 9x6 were expected.")
    return int(parts[0]), int(parts[1])


def _lines(calibration: "CameraCalibration", out: Path, picture: Path) -> list[str]:
    """Return the result in words: parameters, images, next step."""
    camera, fit = calibration.camera, calibration.fit
    lens = (
        f"{camera.width} × {camera.height} pixels, {camera.model}, RMS {fit.rms_px:.3f} pixels, "
        f"{100.0 * calibration.coverage:.0f} % of the image reached"
    )
    lines = [f"written to {out}, {picture}", fact_line("lens", lens)]
    for name, value, sigma in zip(calibration.names, calibration.values, calibration.sigma, strict=True):
        digits = 2 if name[0] in "fc" else 5
        lines.append(fact_line(name, f"{value:.{digits}f} ± {sigma:.{digits}f}"))
    for file, rms in zip(calibration.accepted, fit.view_rms_px, strict=True):
        lines.append(fact_line("used", f"{file.name}: {rms:.3f} pixels"))
    lines += [fact_line("left out", f"{name}: {reason}") for name, reason in calibration.rejected.items()]
    lines.append(fact_line("next", f"firnline localize IMAGES --camera {out}"))
    return lines
