"""Lines across an area, addressed by their distance from its edge."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from planners.config_lawnmower import LawnmowerConfig
from planners.config_wavy import WavyConfig
from planners.ground.transit import FreeGround
from planners.planning import plan
from planners.swaths.decomposition import clipped
from planners.swaths.swaths import axes_of, shortened
from planners.swaths.wavy import wavy
from survey.core.arrays import FloatArray, IntArray
from survey.data.area import SurveyArea
from survey.data.route import Route

_INSET_SHARE = 0.25


class SurveyLines:
    """Lines across an area that swaths may be laid on, addressed by their distance from its edge.

    Parameters
    ----------
    area : SurveyArea
        The free ground.
    heading_deg : float, optional
        Of the lines [deg]; across the narrowest width when left out.
    """

    def __init__(self, area: SurveyArea, heading_deg: float | None = None) -> None:
        self.area = area
        axis = plan(area, None, LawnmowerConfig(swaths=2, heading_deg=heading_deg)).swaths[0].axis
        east, north = axis[1] - axis[0]
        self.along, self.left = axes_of(float(np.degrees(np.arctan2(north, east))))
        outline = np.array(area.free.convex_hull.exterior.coords)
        self.u, self.v = outline @ self.along, outline @ self.left
        self.width_m = float(np.ptp(self.v))

    @cached_property
    def ground(self) -> FreeGround:
        """The free ground with its ways."""
        return FreeGround(self.area.free)

    def swath(self, offset_m: float, spacing_m: float, wavelength_m: float) -> list[FloatArray]:
        """Return what is driven (N, 2) on the line at an offset, piece by piece along the line [m]."""
        reach = np.array([self.u.min() - 1.0, self.u.max() + 1.0])
        line = reach[:, None] * self.along + (self.v.min() + offset_m) * self.left
        axes = [shortened(axis, _INSET_SHARE * spacing_m) for axis in clipped(self.ground, [line])]
        if not axes:
            return []
        config = WavyConfig(spacing_m=spacing_m)
        return [swath.xy for swath in wavy(axes, self.area, config, spacing_m, wavelength_m)]

    def offsets_of(self, route: Route, apart_m: float) -> list[float]:
        """Return the offsets of the lines driven [m]; pieces of one line, as about a hole, count once."""
        edge = float(self.v.min())
        found: list[float] = []
        for leg in route.swaths:
            offset = float(leg.axis.mean(axis=0) @ self.left) - edge
            if all(abs(offset - other) > apart_m for other in found):
                found.append(offset)
        return found

    def nearest(self, xy: FloatArray, offsets: Sequence[float]) -> IntArray:
        """Return the index (N,) of the offset that each place (N, 2) is nearest to."""
        offset = xy @ self.left - float(self.v.min())
        nearest: IntArray = np.argmin(np.abs(offset[:, None] - np.array(offsets)), axis=1)
        return nearest
