r"""Slope hazards of a rover: probability that the ground is too steep, and ground that is steep by its bounds.

`slope_hazard` evaluates a joint map and the covariance of its slopes: the probability that a normal vector g in the plane
is longer than the limit t. With the principal axes of the covariance, standard deviations σ₁ ≥ σ₂ and means μ along them,

.. math::  P(|g| > t) = 1 - \int_{-t}^{t} \phi\!\left(\frac{u - \mu_1}{\sigma_1}\right)
           \left[\Phi\!\left(\frac{s - \mu_2}{\sigma_2}\right) - \Phi\!\left(\frac{-s - \mu_2}{\sigma_2}\right)\right]
           \frac{du}{\sigma_1}, \qquad s = \sqrt{t^2 - u^2}

`steep_ground` needs bounds alone, also where no point was seen. Ground that is at least l at a place A and at most u at a
place B, a distance d away, rises between the two at least once as steeply as the chord (the mean value theorem),

.. math::  \max_{AB} |\nabla f| \ge (l_A - u_B) / d

A point pins the bounds at A, rays keep B low: the far side of a crest is found steep before it is seen (Fig. 4 of the
space-carving paper, where A has to be the highest place of its surroundings because no lower bound is at hand).
A chord of one step applies to both its nodes, and one of two steps to the node between. A longer one leaves open which
node is steep; it marks all between its ends where it falls by 15 % more for every step beyond two, so that most of them
have to be.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
from rasterio.features import shapes
from scipy.special import ndtr
from shapely.geometry import shape

from survey.core import BoolArray, FloatArray, InputError, write_json
from survey.data import Dem, Grid, Route, SurveyArea
from survey.io.raster import write_raster
from survey.reconstruction.joint.solution import JointSolution
from survey.reconstruction.terrain_map import Reconstruction

ACCEPTED = 0.05
"""Probability of ground beyond the limit from which it is no-go ground for the next plan."""
BASE_M = 2.0
"""Base over which slopes are taken [m], about the length of a rover."""
MOST_NODES = 10_000
_AT_ONCE = 500


@dataclass(frozen=True)
class RouteRisk:
    """Risk of a route: expected length beyond the limit [m], largest probability on it, and its length [m].

    `expected_m`: expected length of the route on ground beyond the limit [m]. `worst`: largest probability on
    the route. `length_m`: length of the route on the map [m].
    """

    expected_m: float
    worst: float
    length_m: float


@dataclass(frozen=True)
class SlopeHazard:
    """Probability at each node of a grid that the slope over a base exceeds a limit.

    `probability`: probabilities on the grid. `limit_deg`: limit of the slope [deg]. `base_m`: base of the
    slope [m].
    """

    probability: Dem
    limit_deg: float
    base_m: float

    def no_go(self, area: SurveyArea, accepted: float = ACCEPTED) -> SurveyArea:
        """Return the area with the ground beyond an accepted probability as further no-go ground."""
        dangerous = (self.probability.elevation > accepted).astype(np.uint8)
        found = shapes(dangerous, mask=dangerous.astype(bool), transform=self.probability.transform)
        cells = [shape(outline).intersection(area.polygon) for outline, _ in found]
        parts = [
            part
            for cell in cells
            for part in shapely.get_parts(cell)
            if part.geom_type == "Polygon" and part.area > 0.0
        ]
        return SurveyArea(area.polygon, area.crs, (*area.no_go, *parts), area.starts)

    def along(self, route: Route) -> RouteRisk:
        """Return the risk of a route."""
        step_m = 0.5 * self.probability.step_m
        places = np.vstack([route.sample(step_m, rover).xy for rover in range(route.n_rovers)])
        probability = self.probability.at(places)
        known = probability[np.isfinite(probability)]
        return RouteRisk(
            float(known.sum() * step_m), float(known.max(initial=0.0)), float(len(known) * step_m)
        )

    def write(self, folder: Path, area: SurveyArea, route: Route) -> None:
        """Write probability, area of the next plan with its no-go ground, and the risk of the route."""
        dem = self.probability
        bands = {"probability": dem.elevation}
        write_raster(folder / "hazard.tif", bands, dem.transform, dem.crs)
        following = self.no_go(area)
        following.write(folder / "next_area.gpkg")
        risk = self.along(route)
        added_m2 = area.free.area - following.free.area
        write_json(
            folder / "hazard.json",
            {
                "max_slope_deg": self.limit_deg,
                "base_m": self.base_m,
                "accepted_probability": ACCEPTED,
                "no_go_share": added_m2 / area.free.area,
                "route_expected_m": risk.expected_m,
                "route_worst_probability": risk.worst,
                "route_length_m": risk.length_m,
            },
        )


def slope_hazard(
    solution: JointSolution, grid: Grid, limit_deg: float, *, base_m: float = BASE_M
) -> SlopeHazard:
    """Return the probability that the ground is steeper than a limit, at each node of a grid.

    The slope over the base is a normal vector: its mean is that of the map, its covariance that of the joint
    estimate of terrain and path, with the relief that the map does not resolve. A step over the base is a slope:
    a limit of ``h`` metres is one of ``arctan(h / base)``.

    `limit_deg`: steepest slope that the rover can stand, in any direction [deg]. `base_m`: base of the slope
    [m].

    Good where the terrain is like the covariance that was fitted to it: crevasses and cliffs between swaths are
    not. Relief below the base does not count.
    """
    limit = float(np.tan(np.radians(limit_deg)))
    parts = [grid.xy[k : k + _AT_ONCE] for k in range(0, len(grid.xy), _AT_ONCE)]
    found: list[FloatArray] = []
    for part in parts:
        rises, covariance = solution.slopes(part, base_m)
        found.append(probability_beyond(rises, covariance, limit))
    return SlopeHazard(Dem.on(grid, np.concatenate(found).reshape(grid.shape)), limit_deg, base_m)


def hazard_grid(grid: Grid) -> Grid:
    """Return a grid over the same ground with at most `MOST_NODES` nodes."""
    factor = int(np.ceil(np.sqrt(np.prod(grid.shape) / MOST_NODES)))
    return grid if factor <= 1 else Grid.over(grid.bounds, factor * grid.step_m, grid.crs)


# Nodes of the quadrature along the expected slope, and its reach in standard deviations: beyond is less than rounding.
_N_NODES = 64
_REACH = 8.0
_LEAST_SHARE = 1e-6


def probability_beyond(mean: FloatArray, covariance: FloatArray, limit: float) -> FloatArray:
    """Return the probability that normal vectors in the plane are longer than a limit.

    `mean` (M, 2): means of the vectors. `covariance` (M, 2, 2): their covariances. Returns (M,): between 0
    and 1; to about 1e-6.

    >>> known, unit = np.zeros((1, 2)), np.eye(2)[None]
    >>> probability_beyond(known, unit, 2.0).round(4).tolist()  # exp(-2)
    [0.1353]
    """
    variance, axes = np.linalg.eigh(covariance)
    sigma = np.sqrt(np.maximum(variance, (_LEAST_SHARE * limit) ** 2))
    across, along = np.einsum("mij,mi->jm", axes, mean)
    sigma_across, sigma_along = sigma.T
    low = np.clip(along - _REACH * sigma_along, -limit, limit)
    high = np.clip(along + _REACH * sigma_along, -limit, limit)
    nodes, weights = np.polynomial.legendre.leggauss(_N_NODES)
    u = 0.5 * (low + high)[:, None] + 0.5 * (high - low)[:, None] * nodes
    half = np.sqrt(np.maximum(limit**2 - u**2, 0.0))
    inside = ndtr((half - across[:, None]) / sigma_across[:, None])
    inside -= ndtr((-half - across[:, None]) / sigma_across[:, None])
    density = np.exp(-0.5 * ((u - along[:, None]) / sigma_along[:, None]) ** 2)
    density /= np.sqrt(2.0 * np.pi) * sigma_along[:, None]
    within: FloatArray = 0.5 * (high - low) * ((density * inside) @ weights)
    return np.clip(1.0 - within, 0.0, 1.0)


# Chords longer than this show that the ground is steep, and not where [m].
_REACH_M = 1.0
_DIRECTIONS = ((0, 1), (1, 0), (1, 1), (1, -1))
# By so much more a chord has to fall for every step beyond two.
_MORE_PER_STEP = 0.15


def steep_ground(reconstruction: Reconstruction, limit_deg: float) -> Dem:
    """Return 1 where the ground is steeper than a limit for certain, 0 elsewhere, NaN beyond the map.

    `limit_deg`: steepest slope that is not lethal [deg].

    What is 0 is not known to be safe: the bounds there only allow of gentle ground, or are wide apart.

    A step of 1 m, seen from above: the bounds meet on the plateau, and rays keep the ground before it low.

    >>> from survey.data.grid import Grid
    >>> grid = Grid((0.0, 0.0, 5.0, 1.0), 1.0)
    >>> low, high = np.tile([1.0, 1.0, 1.0, -9.0, -9.0, 0.0], (2, 1)), np.tile([1.0, 1.0, 1.0, 0.2, 0.1, 0.0], (2, 1))
    >>> flat, codes = Dem.on(grid, 0.5 * (low + high)), np.ones(grid.shape, dtype=int)
    >>> step = Reconstruction(flat, flat, codes, "field", {}, Dem.on(grid, low), Dem.on(grid, high))
    >>> steep_ground(step, 30.0).elevation[0]
    array([0., 0., 1., 1., 0., 0.])
    """
    if reconstruction.lower is None or reconstruction.upper is None:
        raise InputError(
            f"the map by {reconstruction.method} has no bounds of its own, which steep ground is found from; map it with rays."
        )
    if not 0.0 < limit_deg < 90.0:
        raise InputError(f"a slope of {limit_deg:g}° is no limit to stay below; give one between 0 and 90°.")
    lower, upper = reconstruction.lower.elevation, reconstruction.upper.elevation
    step_m = reconstruction.mean.step_m
    steep = steep_chords(lower, upper, step_m, limit_deg, max(_REACH_M, step_m))
    grid = reconstruction.mean.grid()
    return Dem.on(grid, np.where(np.isfinite(reconstruction.mean.elevation), steep, np.nan))


def steep_chords(
    lower: FloatArray, upper: FloatArray, step_m: float, limit_deg: float, reach_m: float
) -> BoolArray:
    """Return which nodes (H, W) lie on a chord up to `reach_m` long from a lower bound down to an upper one that is too steep."""
    steep = np.zeros(lower.shape, dtype=bool)
    rise = np.tan(np.radians(limit_deg))
    for south, east in _DIRECTIONS:
        length_m = step_m * np.hypot(south, east)
        for k in range(1, int(reach_m / length_m + 1e-9) + 1):
            here, there = _pair(lower.shape, k * south, k * east)
            needed = rise * k * length_m * (1.0 + _MORE_PER_STEP * max(k - 2, 0))
            down = (lower[here] - upper[there] > needed) | (lower[there] - upper[here] > needed)
            for m in range(k + 1) if k == 1 else range(1, k):
                along = tuple(
                    slice(a.start + m * d, a.stop + m * d) for a, d in zip(here, (south, east), strict=True)
                )
                steep[along] |= down
    return steep


def _pair(shape: tuple[int, ...], south: int, east: int) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Return the nodes that have another one so many rows and columns away, and those others."""
    rows, columns = shape
    west = max(-east, 0)
    here = (slice(0, rows - south), slice(west, columns - max(east, 0)))
    return here, (slice(south, rows), slice(west + east, columns - max(east, 0) + east))
