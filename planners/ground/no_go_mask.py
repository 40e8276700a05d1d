"""No-go zones from a raster of marked cells."""

from dataclasses import replace

import numpy as np
import shapely

from planners.ground.raster_cells import cell_outline
from survey.core.errors import InputError
from survey.data.area import SurveyArea
from survey.data.dem import Dem


def without_marked(area: SurveyArea, mask: Dem) -> SurveyArea:
    """Return an area whose no-go zones also hold the cells of a raster that are marked, with half a cell around them.

    Parameters
    ----------
    area : SurveyArea
        What is to be surveyed.
    mask : Dem
        1 where driving is forbidden, such as the ``no_go.tif`` of a map with bounds; 0 or NaN elsewhere.

    Raises
    ------
    InputError
        Another CRS, other values, nothing left, or a start on marked ground.

    Examples
    --------
    >>> from affine import Affine
    >>> square = SurveyArea(shapely.box(0.0, 0.0, 40.0, 40.0), "EPSG:32608")
    >>> corner = np.zeros((4, 4))
    >>> corner[0, 3] = 1.0
    >>> mask = Dem(corner, Affine(10, 0, 0, 0, -10, 40), "EPSG:32608")
    >>> bool(without_marked(square, mask).free.area < square.free.area - 100.0)
    True
    """
    area.require_crs(mask.crs, "the mask of no-go ground")
    values = mask.elevation[np.isfinite(mask.elevation)]
    if not np.isin(values, (0.0, 1.0)).all():
        raise InputError(
            f"the mask of no-go ground holds values from {values.min():g} to {values.max():g}; 1 for no-go ground and 0 "
            "elsewhere were expected."
        )
    marked = mask.elevation == 1.0
    if not marked.any():
        return area
    zones = shapely.intersection(cell_outline(marked, mask), area.polygon)
    parts = [part for part in shapely.get_parts(zones) if part.geom_type == "Polygon" and part.area > 0.0]
    return replace(area, no_go=(*area.no_go, *parts))
