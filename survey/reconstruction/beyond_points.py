r"""Standard deviation far beyond the points, where relief is longer than the points' extent.

A kernel that is fitted to points shows the relief of waves up to their extent L, and its variance is all that it allows
elsewhere. Ground goes on rising or falling: on twelve real terrains heights at a distance d beyond points differ from
those at the points by :math:`\Delta (1 + 2 d / L)` (root mean square), where Δ is the difference between points half an
extent apart. So beyond a quarter of the extent the variance grows by :math:`(2 \Delta / L)^2 (d^2 - (L / 4)^2)`.
"""

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
import shapely

from survey.core import FloatArray, stream
from survey.data import Dem, SurveyArea
from survey.reconstruction.terrain_map import BEYOND, Reconstruction

# Share of the extent, beyond the points, within which the fitted kernel holds.
_TRUSTED_SHARE = 0.25
_N_PAIRS = 40_000
# The corners of a bounding box that hold less are not worth a sentence.
_LEAST_SHARE = 0.01
# Distances between the points that are compared, as shares of the extent, and the least one where there are none.
_LAGS, _LEAST_LAG = (0.4, 0.6), 0.25


@dataclass(frozen=True)
class BeyondPoints:
    """How ground differs beyond points.

    `hull`: convex hull of the points. `extent_m`: longer side of their bounding box [m]. `per_metre`: root
    mean square difference between points about half an extent apart, over their distance [1/m].
    """

    hull: shapely.Geometry
    extent_m: float
    per_metre: float

    @classmethod
    def of(cls, xy: FloatArray, values: FloatArray) -> Self:
        """Return what values (N,) at places (N, 2) [m] show."""
        extent_m = float(np.ptp(xy, axis=0).max())
        first, second = stream(0, "beyond points").integers(0, len(xy), (2, _N_PAIRS))
        apart = np.hypot(*(xy[first] - xy[second]).T) / extent_m
        chosen = (apart > _LAGS[0]) & (apart < _LAGS[1])
        if not chosen.any():
            chosen = apart >= _LEAST_LAG
        per_metre = (values[first] - values[second])[chosen] / (apart[chosen] * extent_m)
        hull = shapely.convex_hull(shapely.multipoints(xy))
        return cls(hull, extent_m, float(np.sqrt(np.mean(per_metre**2))))

    @property
    def trusted_m(self) -> float:
        """Distance beyond the points up to which the fitted kernel holds [m]."""
        return _TRUSTED_SHARE * self.extent_m

    def distance_m(self, xy: FloatArray) -> FloatArray:
        """Return the distance of places (M, 2) from the hull of the points (M,) [m]; 0 within it."""
        shapely.prepare(self.hull)
        distance: FloatArray = np.asarray(shapely.distance(self.hull, shapely.points(xy)), dtype=np.float64)
        return distance

    def sigma(self, distance_m: FloatArray) -> FloatArray:
        """Return the standard deviation (M,) of what the points do not show, at distances from them (M,) [m]."""
        return self.per_metre * np.sqrt(np.maximum(distance_m**2 - self.trusted_m**2, 0.0))


def widened_beyond(
    result: Reconstruction, xy: FloatArray, values: FloatArray, area: SurveyArea | None
) -> Reconstruction:
    """Return a map whose standard deviation grows with the distance beyond the points; as it is where none is far.

    `xy`, `values` (N, 2) and (N,): places of the points [m], and what was measured there.
    """
    grid = result.mean.grid()
    beyond = BeyondPoints.of(xy, values)
    # The distance from a convex set is a convex function: no node is farther than the farthest corner.
    corners = np.stack(np.meshgrid(grid.x[[0, -1]], grid.y[[0, -1]]), axis=-1).reshape(-1, 2)
    if beyond.distance_m(corners).max() <= beyond.trusted_m:
        return result
    distance = beyond.distance_m(grid.xy)
    counted = distance if area is None else distance[area.contains(grid.xy)]
    if not (counted > beyond.trusted_m).any():
        return result
    std = np.hypot(result.std.elevation, beyond.sigma(distance).reshape(grid.shape))
    facts: dict[str, Any] = {
        "share": float(np.mean(counted > beyond.trusted_m)),
        "farther_than_m": beyond.trusted_m,
        "farthest_m": float(counted.max()),
        "extent_m": beyond.extent_m,
    }
    return replace(
        result,
        std=Dem.on(grid, std, result.std.vertical_datum),
        diagnostics={**result.diagnostics, BEYOND: facts},
    )


def beyond_sentences(result: Reconstruction) -> list[str]:
    """Return in a sentence how much of a map lies far beyond its points; none where hardly anything does."""
    facts = result.diagnostics.get(BEYOND)
    if facts is None or facts["share"] < _LEAST_SHARE:
        return []
    low, high, extent = (_metres(facts[name]) for name in ("farther_than_m", "farthest_m", "extent_m"))
    return [
        f"{100.0 * facts['share']:.2g} % of the ground lies {low} to {high} m beyond the points (extent {extent} m), which "
        "show no relief of longer waves: the standard deviation grows there with the distance; add points or a prior, or map "
        "a smaller area."
    ]


def _metres(value_m: float) -> str:
    return f"{value_m:,.0f}" if value_m >= 100.0 else f"{value_m:.3g}"
