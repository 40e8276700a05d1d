"""Probability that the ground is steeper than a rover's limit, from a joint map and the covariance of its slopes."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
from rasterio.features import shapes
from shapely.geometry import shape

from survey.core.arrays import FloatArray
from survey.core.documents import write_json
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.data.route import Route
from survey.io.raster import write_raster
from survey.reconstruction.hazards.disc_probability import probability_beyond
from survey.reconstruction.joint.solution import JointSolution

ACCEPTED = 0.05
"""Probability of ground beyond the limit from which it is no-go ground for the next plan."""
BASE_M = 2.0
"""Base over which slopes are taken [m], about the length of a rover."""
MOST_NODES = 10_000
_AT_ONCE = 500


@dataclass(frozen=True)
class RouteRisk:
    """Risk of a route: expected length beyond the limit [m], largest probability on it, and its length [m].

    Parameters
    ----------
    expected_m : float
        Expected length of the route on ground beyond the limit [m].
    worst : float
        Largest probability on the route.
    length_m : float
        Length of the route on the map [m].
    """

    expected_m: float
    worst: float
    length_m: float


@dataclass(frozen=True)
class SlopeHazard:
    """Probability at each node of a grid that the slope over a base exceeds a limit.

    Parameters
    ----------
    probability : Dem
        Probabilities on the grid.
    limit_deg : float
        Limit of the slope [deg].
    base_m : float
        Base of the slope [m].
    """

    probability: Dem
    limit_deg: float
    base_m: float

    def no_go(self, area: SurveyArea, accepted: float = ACCEPTED) -> SurveyArea:
        """Return the area with the ground beyond an accepted probability as further no-go ground.

        Parameters
        ----------
        area : SurveyArea
            Area of the next plan.
        accepted : float
            Probability that is accepted.

        Returns
        -------
        SurveyArea
            Cells around nodes beyond it are no-go ground, within the area.
        """
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
        """Return the risk of a route.

        Parameters
        ----------
        route : Route
            Route of all rovers.

        Returns
        -------
        RouteRisk
            Of the part of the route that lies on the map.
        """
        step_m = 0.5 * self.probability.step_m
        places = np.vstack([route.sample(step_m, rover).xy for rover in range(route.n_rovers)])
        probability = self.probability.at(places)
        known = probability[np.isfinite(probability)]
        return RouteRisk(
            float(known.sum() * step_m), float(known.max(initial=0.0)), float(len(known) * step_m)
        )

    def write(self, folder: Path, area: SurveyArea, route: Route) -> None:
        """Write probability, area of the next plan with its no-go ground, and the risk of the route.

        Parameters
        ----------
        folder : pathlib.Path
            Existing folder, for ``hazard.tif``, ``next_area.gpkg`` and ``hazard.json``.
        area : SurveyArea
            Area of the survey.
        route : Route
            Route whose risk is stated.
        """
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

    Parameters
    ----------
    solution : JointSolution
        Joint estimate that the map was read from.
    grid : Grid
        Nodes; a few thousand take seconds.
    limit_deg : float
        Steepest slope that the rover can stand, in any direction [deg].
    base_m : float
        Base of the slope [m].

    Returns
    -------
    SlopeHazard
        Probabilities on the grid.

    Notes
    -----
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
