"""``firnline track``: displacement and velocity of a surface between two surveys by feature tracking."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from firnline.cli.facts import end_dry_run
from firnline.cli.options import DryRun, Quiet
from firnline.cli.outcome import with_exit_codes
from firnline.cli.request import with_options_of

if TYPE_CHECKING:
    from survey.scoring.change.tracking import TrackedMotion


@dataclass(frozen=True, kw_only=True)
class TrackRequest:
    """Options of the command."""

    earlier: Annotated[Path, typer.Argument(help="Earlier survey: a raster of elevations, or an orthoimage.")]
    later: Annotated[Path, typer.Argument(help="Later survey on the same grid.")]
    days: Annotated[float, typer.Option("--days", min=1e-6, help="Time between the surveys [days].")]
    images: Annotated[
        bool, typer.Option("--images", help="Match the rasters as images, not hillshades of elevations.")
    ] = False
    window_px: Annotated[int, typer.Option("--window", help="Width of the windows, odd [pixels].")] = 33
    step_px: Annotated[int, typer.Option("--step", min=1, help="Distance of the windows [pixels].")] = 16
    search_px: Annotated[int, typer.Option("--search", help="Largest displacement searched [pixels].")] = 24
    out: Annotated[Path, typer.Option("--out", "-o", help="Points: .gpkg, .geojson or .shp.")] = Path(
        "velocity.gpkg"
    )
    force: Annotated[bool, typer.Option("--force", help="Replace an existing file.")] = False
    dry_run: DryRun = False
    quiet: Quiet = False


@with_exit_codes
@with_options_of(TrackRequest)
def track(request: TrackRequest) -> None:
    """Track the features of a moving surface between two surveys: displacements, velocities and their errors.

    Weak matches, and those that contradict their neighbours, are written with outlier = 1.

    For example:

      firnline track 2024.tif 2026.tif --days 730 -o velocity.gpkg
    """
    from firnline.cli.outputs import refuse_existing
    from survey.core.map_scale import MapScale
    from survey.data.dem import Dem
    from survey.scoring.change.tracking import check_pair, track, write_tracked

    refuse_existing([request.out], force=request.force, inputs=(request.earlier, request.later))
    earlier, later = Dem.read(request.earlier), Dem.read(request.later)
    check_pair(earlier, later, request.window_px, request.search_px)
    if request.dry_run:
        end_dry_run([request.out], {"surveys": "{} × {} cells".format(*earlier.shape)})
    found = track(
        earlier,
        later,
        window_px=request.window_px,
        step_px=request.step_px,
        search_px=request.search_px,
        shaded=not request.images,
    )
    write_tracked(request.out, found, request.days, earlier.crs)
    if not request.quiet:
        scale = MapScale.over(earlier.crs, earlier.bounds).notable_factor
        typer.echo(_summary(found, request.days * scale))
        if scale != 1.0:
            typer.echo(
                f"note: {request.out.name} has displacements in metres of {earlier.crs.name}, {scale:.3f} of which are one metre on "
                "the ground here; the speed above is on the ground"
            )


def _summary(found: "TrackedMotion", metres: float) -> str:
    """Return the number of windows, the median speed and its error; `metres` of the CRS are one metre a day."""
    import numpy as np

    good = ~found.is_outlier
    if not good.any():
        return f"all {len(found)} windows are outliers; take larger windows, a wider search or surveys closer in time."
    speed = np.hypot(*found.shift_m[good].T) / metres
    sigma = np.hypot(*found.sigma_m[good].T) / np.sqrt(2.0) / metres
    return (
        f"{len(found)} windows, {int((~good).sum())} of them outliers; median speed {np.median(speed):.3g} m a day, "
        f"median standard deviation {np.median(sigma):.2g} m a day on either axis"
    )
