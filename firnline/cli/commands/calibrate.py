"""``firnline calibrate``: lens of a camera from images of a board."""

from firnline.actions import localizing
from firnline.cli.outcome import with_exit_codes
from firnline.cli.request import DryRun, Json, Quiet, print_result, with_options_of


@with_exit_codes
@with_options_of(localizing.CalibrateRequest)
def calibrate(
    request: localizing.CalibrateRequest,
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
    from firnline.cli.progress import counted

    if dry_run:
        print_result(localizing.preview_calibration(request))
        return
    with counted(quiet=quiet) as progress:
        made = localizing.calibrate(request, progress)
    print_result(made.write(), as_json=as_json)
