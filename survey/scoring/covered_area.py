"""Nodes that a score leaves out, and the share of an area that a map covers."""

from typing import NamedTuple

import numpy as np
import shapely

from survey.core.arrays import BoolArray, Bounds, FloatArray
from survey.data.area import SurveyArea
from survey.data.dem import Dem


class NodeCounts(NamedTuple):
    """Numbers of nodes that a score leaves out.

    Parameters
    ----------
    outside : int
        Outside the area.
    unknown : int
        In the area, with a height in the map and none in the reference.
    silent : int
        In the area, without a height in the map.
    """

    outside: int
    unknown: int
    silent: int


def counted(heights: FloatArray, reference: FloatArray, inside: BoolArray, *, has_area: bool) -> NodeCounts:
    """Count the nodes (N,) that are left out, by reason.

    Where no area was named, nodes at which neither map nor reference has a height count as outside.
    """
    given, known = np.isfinite(heights), np.isfinite(reference)
    wanted = inside if has_area else inside & (given | known)
    return NodeCounts(
        outside=int((~wanted).sum()),
        unknown=int((wanted & given & ~known).sum()),
        silent=int((wanted & ~given).sum()),
    )


def nodes_beyond(bounds: Bounds, step_m: float, area: SurveyArea) -> int:
    """Return the number of nodes that the part of an area beyond a raster's bounds would hold."""
    beyond_m2 = float(area.free.difference(shapely.box(*bounds)).area)
    return round(beyond_m2 / step_m**2)


def covered_share(dem: Dem, area: SurveyArea) -> float:
    """Return the share of an area's free ground on which a map gives a height.

    Examples
    --------
    >>> from survey.data.grid import Grid
    >>> grid = Grid((0.5, 0.5, 9.5, 9.5), 1.0, "EPSG:32608")
    >>> area = SurveyArea.rectangle((0.0, 0.0, 20.0, 10.0), "EPSG:32608")
    >>> covered_share(Dem.on(grid, np.zeros(grid.shape)), area)
    0.5
    """
    inside = area.contains(dem.xy)
    given = int((inside & np.isfinite(dem.elevation.ravel())).sum())
    wanted = int(inside.sum()) + nodes_beyond(dem.bounds, dem.step_m, area)
    return given / wanted if wanted else 0.0
