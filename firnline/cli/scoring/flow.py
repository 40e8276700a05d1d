"""Flow between two surveys as ``firnline change --flow`` names it: tracked from the surveys, or read from files."""

from pathlib import Path
from typing import TYPE_CHECKING

from survey.core.errors import ConfigError, InputError

if TYPE_CHECKING:
    from pyproj import CRS

    from survey import Dem
    from survey.scoring.change.along_flow import Thickness
    from survey.scoring.change.displacements import DisplacementField

TRACKED = "track"
"""Value of the option by which the surveys themselves are tracked."""


def flow_of(named: str, days: float | None, later: "Dem", earlier: "Dem") -> "DisplacementField":
    """Return the displacement between two surveys."""
    from survey.scoring.change.displacements import TrackedField
    from survey.scoring.change.tracking import read_tracked

    if "," in named:
        return _of_rasters(named, _days(days), later.crs)
    if Path(named).suffix.lower() == ".json":
        return _of_motion(Path(named), _days(days))
    if days is not None:
        raise InputError(
            f"--flow {named} names displacements between the surveys, not velocities; leave --days out."
        )
    if named == TRACKED:
        return _tracked(later, earlier)
    return TrackedField.of(read_tracked(Path(named), later.crs))


def thickness_of(named: str | None, error: float) -> "Thickness | None":
    """Return the thickness that an option names: metres or a raster."""
    from survey import Dem
    from survey.scoring.change.along_flow import Thickness

    if named is None:
        return None
    try:
        value = float(named)
    except ValueError:
        return Thickness(Dem.read(named), error)
    if not 0.0 < value < float("inf"):
        raise ConfigError(f"--thickness is {named} m; give a positive number, or a raster.")
    return Thickness(value, error)


def _tracked(later: "Dem", earlier: "Dem") -> "DisplacementField":
    """Track the features of the earlier survey in the later one, on the grid of the coarser one."""
    from survey import Dem
    from survey.scoring.change.displacements import TrackedField
    from survey.scoring.change.tracking import track

    coarser = later if later.step_m >= earlier.step_m else earlier
    grid = coarser.grid()
    early, late = (Dem.on(grid, one.at(grid.xy).reshape(grid.shape)) for one in (earlier, later))
    return TrackedField.of(track(early, late))


def _of_rasters(named: str, days: float, crs: "CRS") -> "DisplacementField":
    from survey import Dem
    from survey.core.crs import same_crs
    from survey.reconstruction.motion.priors import VelocityRasters
    from survey.scoring.change.displacements import RasterField

    files = named.split(",")
    if len(files) != 4:
        raise ConfigError(
            f"--flow names {len(files)} rasters; name four with commas: velocity east, velocity north, and their standard "
            "deviations [m/day]."
        )
    rasters = VelocityRasters(*(Dem.read(Path(file)) for file in files))
    for raster in rasters:
        same_crs(crs, raster.crs, "the surveys and the rasters of the velocity")
    return RasterField(rasters, days)


def _of_motion(file: Path, days: float) -> "DisplacementField":
    from survey.data.ice_motion import read_motion
    from survey.scoring.change.displacements import SteadyField

    return SteadyField(read_motion(file), days)


def _days(days: float | None) -> float:
    if days is None:
        raise InputError("--flow names velocities; add --days with the time between the surveys.")
    return days
