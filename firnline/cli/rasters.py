"""Reading of the rasters that a command needs about an area: in its CRS, warped where they are in degrees."""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pyproj import CRS

    import survey
    from survey.core.arrays import Bounds

_LEAST_MARGIN_M = 200.0
_MARGIN_CELLS = 4.0


def own_crs(path: Path) -> "CRS | None":
    """Return the projected CRS that a raster's header names; None where it is in degrees."""
    from survey.core.crs import projected_crs
    from survey.core.transformation import is_geographic
    from survey.io.raster import raster_header

    stated = raster_header(path).crs
    return None if is_geographic(stated) else projected_crs(stated, str(path))


def read_about(path: Path, bounds: "Bounds", crs: "CRS", what: str, *, mask: bool = False) -> "survey.Dem":
    """Read the cells of a raster on bounds [m] and about them, as far as slopes and cameras reach."""
    import survey
    from planners.capacity import require_cells
    from survey.core.crs import same_crs
    from survey.io.raster.warping import cell_m

    stated = own_crs(path)
    if stated is not None:
        same_crs(crs, stated, f"the survey area and {what}")
    west, south, east, north = bounds
    step_m = cell_m(path, crs)
    if step_m > 0.0:  # a turned raster is refused when it is read
        require_cells(int((east - west) * (north - south) / step_m**2))
    margin_m = max(_MARGIN_CELLS * step_m, _LEAST_MARGIN_M)
    about = (west - margin_m, south - margin_m, east + margin_m, north + margin_m)
    return survey.Dem.read(path, crs=crs if stated is None else None, bounds=about, mask=mask)
