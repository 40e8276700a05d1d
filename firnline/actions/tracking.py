"""Motion of a surface between two surveys: features that are tracked, or a flow that is named with the thickness of the ice."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import survey
from firnline.actions.interface import Argument, Option, Preview, WrittenResult, previewed_by, refuse_existing
from survey.core import ConfigError, InputError

if TYPE_CHECKING:
    from pyproj import CRS

    from survey.scoring.differencing.along_flow import Thickness
    from survey.scoring.differencing.displacements import DisplacementField
    from survey.scoring.differencing.tracking import TrackedMotion


_TRACKED = "track"
"""Value of the option by which the surveys themselves are tracked."""


def flow_between(
    named: str | None,
    days: float | None,
    thickness: tuple[str | None, float],
    surveys: tuple["survey.Reconstruction | survey.Dem", "survey.Reconstruction | survey.Dem"],
) -> "tuple[DisplacementField | None, Thickness | None]":
    """Return the flow between a later and an earlier survey and the thickness of the ice, where a flow is named.

    `days`: time between the surveys. `thickness`: metres or a raster, and its standard deviation over the thickness.
    """
    if named is None:
        return None, None
    later, earlier = (one if isinstance(one, survey.Dem) else one.mean for one in surveys)
    return _flow_of(named, days, later, earlier), _thickness_of(*thickness)


def _flow_of(
    named: str, days: float | None, later: "survey.Dem", earlier: "survey.Dem"
) -> "DisplacementField":
    """Return the displacement between two surveys."""
    from survey.scoring.differencing.displacements import TrackedField
    from survey.scoring.differencing.tracking import read_tracked

    if "," in named:
        return _of_rasters(named, _days(days), later.crs)
    if Path(named).suffix.lower() == ".json":
        return _of_motion(Path(named), _days(days))
    if days is not None:
        raise InputError(
            f"--flow {named} names displacements between the surveys, not velocities; leave --days out."
        )
    if named == _TRACKED:
        return _tracked(later, earlier)
    return TrackedField.of(read_tracked(Path(named), later.crs))


def _thickness_of(named: str | None, error: float) -> "Thickness | None":
    """Return the thickness that an option names: metres or a raster."""
    from survey.scoring.differencing.along_flow import Thickness

    if named is None:
        return None
    try:
        value = float(named)
    except ValueError:
        return Thickness(survey.Dem.read(named), error)
    if not 0.0 < value < float("inf"):
        raise ConfigError(f"--thickness is {named} m; give a positive number, or a raster.")
    return Thickness(value, error)


def _tracked(later: "survey.Dem", earlier: "survey.Dem") -> "DisplacementField":
    """Track the features of the earlier survey in the later one, on the grid of the coarser one."""
    from survey.scoring.differencing.displacements import TrackedField
    from survey.scoring.differencing.tracking import track

    coarser = later if later.step_m >= earlier.step_m else earlier
    grid = coarser.grid()
    early, late = (survey.Dem.on(grid, one.at(grid.xy).reshape(grid.shape)) for one in (earlier, later))
    return TrackedField.of(track(early, late))


def _of_rasters(named: str, days: float, crs: "CRS") -> "DisplacementField":
    from survey.core import same_crs
    from survey.reconstruction.motion.priors import VelocityRasters
    from survey.scoring.differencing.displacements import RasterField

    files = named.split(",")
    if len(files) != 4:
        raise ConfigError(
            f"--flow names {len(files)} rasters; name four with commas: velocity east, velocity north, and their standard "
            "deviations [m/day]."
        )
    rasters = VelocityRasters(*(survey.Dem.read(Path(file)) for file in files))
    for raster in rasters:
        same_crs(crs, raster.crs, "the surveys and the rasters of the velocity")
    return RasterField(rasters, days)


def _of_motion(file: Path, days: float) -> "DisplacementField":
    from survey.data.ice_motion import read_motion
    from survey.scoring.differencing.displacements import SteadyField

    return SteadyField(read_motion(file), days)


def _days(days: float | None) -> float:
    if days is None:
        raise InputError("--flow names velocities; add --days with the time between the surveys.")
    return days


@dataclass(frozen=True, kw_only=True)
class TrackRequest:
    """Two surveys between which features are tracked."""

    earlier: Annotated[
        Path, Argument(help="Earlier survey: a raster of elevations, or an orthoimage.", reads="the raster")
    ]
    later: Annotated[Path, Argument(help="Later survey on the same grid.", reads="the raster")]
    days: Annotated[float, Option("--days", min=1e-6, help="Time between the surveys [days].")]
    images: Annotated[
        bool, Option("--images", help="Match the rasters as images, not hillshades of elevations.")
    ] = False
    window_px: Annotated[int, Option("--window", help="Width of the windows, odd [pixels].")] = 33
    step_px: Annotated[int, Option("--step", min=1, help="Distance of the windows [pixels].")] = 16
    search_px: Annotated[int, Option("--search", help="Largest displacement searched [pixels].")] = 24
    out: Annotated[Path, Option("--out", "-o", help="Points: .gpkg, .geojson or .shp.")] = Path(
        "velocity.gpkg"
    )
    force: Annotated[bool, Option("--force", help="Replace an existing file.")] = False


@dataclass(frozen=True)
class TrackResult(WrittenResult):
    """Motion of a surface between two surveys.

    Parameters
    ----------
    request : TrackRequest
        What was asked for.
    motion : TrackedMotion
        Displacements of the windows.
    earlier : Dem
        The earlier survey.
    """

    request: TrackRequest
    motion: "TrackedMotion"
    earlier: "survey.Dem"

    def _write_files(self) -> None:
        """Write the windows as points."""
        from survey.scoring.differencing.tracking import write_tracked

        write_tracked(self.request.out, self.motion, self.request.days, self.earlier.crs)

    def lines(self) -> list[str]:
        """Return the median speed with its error, and the scale of the CRS where it matters."""
        from survey.core.map_scale import MapScale

        crs = self.earlier.crs
        scale = MapScale.over(crs, self.earlier.bounds).notable_factor
        lines = [_speed_text(self.motion, self.request.days * scale)]
        if scale != 1.0:
            lines.append(
                f"note: {self.request.out.name} has displacements in metres of {crs.name}, {scale:.3f} of which are one metre "
                "on the ground here; the speed above is on the ground"
            )
        return lines


def preview_track(request: TrackRequest) -> Preview:
    """Read both surveys, and return what would be tracked."""
    earlier, _ = _tracked_pair(request)
    return Preview.of([request.out], {"surveys": "{} × {} cells".format(*earlier.shape)})


@previewed_by(preview_track)
def track(request: TrackRequest) -> TrackResult:
    """Track the features of a moving surface between two surveys.

    Parameters
    ----------
    request : TrackRequest
        Surveys and windows.

    Returns
    -------
    TrackResult
        Displacements with their errors; `TrackResult.write` writes them.

    Raises
    ------
    InputError
        Input that cannot be used, or an output that exists.
    """
    from survey.scoring.differencing import tracking

    earlier, later = _tracked_pair(request)
    found = tracking.track(
        earlier,
        later,
        window_px=request.window_px,
        step_px=request.step_px,
        search_px=request.search_px,
        shaded=not request.images,
    )
    return TrackResult(request, found, earlier)


def _tracked_pair(request: TrackRequest) -> "tuple[survey.Dem, survey.Dem]":
    from survey.scoring.differencing.tracking import check_pair

    refuse_existing([request.out], force=request.force, inputs=(request.earlier, request.later))
    earlier, later = survey.Dem.read(request.earlier), survey.Dem.read(request.later)
    check_pair(earlier, later, request.window_px, request.search_px)
    return earlier, later


def _speed_text(found: "TrackedMotion", metres: float) -> str:
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
