"""The one entry: from an area and what is wanted to a route."""

from planners.base import route_of
from planners.config import LawnmowerConfig
from planners.lawnmower import lawnmower
from planners.swaths import reference_lines
from survey.area import SurveyArea
from survey.dem import Dem
from survey.errors import ConfigError
from survey.route import Route


def plan(area: SurveyArea, prior: Dem | None, config: LawnmowerConfig, *, speed_m_s: float = 1.0) -> Route:
    """Plan the route of a survey.

    Parameters
    ----------
    area : SurveyArea
        What is to be surveyed.
    prior : Dem or None
        Elevations known beforehand, in the area's CRS.
    config : LawnmowerConfig
        The pattern and its settings.
    speed_m_s : float
        Speed of the rover, for the predicted time [m/s].

    Returns
    -------
    Route
        With ``prediction`` of ``length_m``, ``n_turns`` (changes of heading above 30° at a
        waypoint) and ``time_s`` (driving only).

    Raises
    ------
    InputError
        A prior in another CRS than the area; an area that no swath meets.
    ConfigError
        A speed that is not greater than 0.

    Examples
    --------
    >>> area = SurveyArea.rectangle((0.0, 0.0, 600.0, 600.0), "EPSG:32608")
    >>> route = plan(area, None, LawnmowerConfig(swaths=4))
    >>> route.length_m, route.prediction["n_turns"]
    (2850.0, 6.0)
    """
    if not speed_m_s > 0.0:
        raise ConfigError(f"the speed is {speed_m_s} m/s; it must be greater than 0.")
    if prior is not None:
        area.require_crs(prior.crs, "the prior")
    lines = reference_lines(area, config)
    swaths = lawnmower(lines)
    return route_of(swaths, area, config.pattern, lines.spacing_m, speed_m_s=speed_m_s)
