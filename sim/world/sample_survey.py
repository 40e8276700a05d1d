"""Sample survey for examples: a small hilly site with a route and the points that were measured along it."""

from dataclasses import dataclass

import numpy as np
from pyproj import CRS

from planners import LawnmowerConfig, plan
from survey import Dem, Grid, Route, SurfacePoints, SurveyArea
from survey.core import check_types
from survey.terrain import matern_field

_CRS = CRS("EPSG:32608")
_SITE_BOUNDS_M = (500_000.0, 6_700_000.0, 500_300.0, 6_700_300.0)
_AREA_BOUNDS_M = (500_020.0, 6_700_020.0, 500_280.0, 6_700_280.0)
_POINT_SIGMA_M = 0.1


@dataclass(frozen=True)
class SampleSurvey:
    """Survey of a hilly site: terrain, area, route, measured points and the grid of a map.

    Parameters
    ----------
    terrain : Dem
        True surface, nodes of 3 m.
    area : SurveyArea
        Square of 260 m inside the terrain.
    route : Route
        Swaths over the area.
    points : SurfacePoints
        A point every 5 m along the route, with independent errors of 0.1 m.
    grid : Grid
        Nodes of 4 m over the area.
    """

    terrain: Dem
    area: SurveyArea
    route: Route
    points: SurfacePoints
    grid: Grid


@check_types
def sample_survey(swaths: int = 4) -> SampleSurvey:
    """Make a small survey from random numbers, the same at every call.

    Parameters
    ----------
    swaths : int
        Number of lawnmower swaths over the area, at least 1.

    Returns
    -------
    SampleSurvey
        Hilly terrain of 300 m by 300 m with 18 m of relief, and points that were measured along the route.

    Examples
    --------
    >>> survey = sample_survey()
    >>> len(survey.points), round(survey.route.length_m)
    (248, 1235)
    """
    site = Grid(_SITE_BOUNDS_M, 3.0, _CRS)
    terrain = matern_field(site, np.random.default_rng(8), relief_m=18.0, nu=2.5, length_scale_m=90.0)
    area = SurveyArea.rectangle(_AREA_BOUNDS_M, _CRS)
    route = plan(area, None, LawnmowerConfig(swaths=swaths))
    xy = route.sample(5.0).xy
    heights = terrain.at(xy) + np.random.default_rng(1).normal(0.0, _POINT_SIGMA_M, len(xy))
    points = SurfacePoints(np.column_stack([xy, heights]), sigma_m=_POINT_SIGMA_M, crs=_CRS)
    return SampleSurvey(terrain, area, route, points, Grid.over(area.bounds, step_m=4.0, crs=_CRS))
