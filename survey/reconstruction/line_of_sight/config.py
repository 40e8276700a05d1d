"""Settings of surface points from LiDAR scans."""

from pydantic import Field, PositiveFloat, PositiveInt

from survey.core import Section


class ScanPointsConfig(Section):
    """How scans become the points of a map.

    Examples
    --------
    >>> ScanPointsConfig(cell_m=2.0).farthest_m
    80.0
    """

    cell_m: PositiveFloat = 4.0
    """Side of the cells of ground that are represented by one return of each visit [m]."""
    nearest_m: PositiveFloat = 3.0
    """Returns nearer than that are left out: the vehicle itself, snow thrown up [m]."""
    farthest_m: PositiveFloat = 80.0
    """Returns beyond that are left out, where small errors of attitude become large ones of height [m]."""
    least_returns: PositiveInt = 3
    """Returns that a cell needs to be represented."""
    most_points: int = Field(default=16000, ge=100)
    """Points of the map; cells grow until they are no more."""
