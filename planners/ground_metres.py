"""Lengths of settings in the metres of the map.

Settings are metres on the ground; geometry is computed in the metres of the area's CRS (grid metres).
Where the linear scale factor of the projection is within 1 % of 1, as in UTM zones and most national
grids, settings are taken as grid metres. Elsewhere they are multiplied by the mean factor over the area.
Lengths, times and energies of a planned route are always those on the ground.
"""

from typing import TypeVar

from pydantic import BaseModel

from survey.core.map_scale import NOTABLE, MapScale
from survey.data.area import SurveyArea
from survey.data.dem import Dem

_HORIZONTAL = (
    "spacing_m",
    "wavelength_m",
    "step_m",
    "budget_m",
    "turn_radius_m",
    "clearance_m",
    "separation_m",
    "sample_step_m",
    "max_roughness_m",
    "speed_m_s",
)
"""Settings that grow with the unit of the map. Heights count in it too where slopes are taken."""

AnyModel = TypeVar("AnyModel", bound=BaseModel)


def settings_factor(area: SurveyArea) -> float:
    """Return the factor that turns metres of settings into grid metres.

    Parameters
    ----------
    area : SurveyArea
        What is to be surveyed.

    Returns
    -------
    float
        1 where the mean linear scale factor over the area is within 1 % of 1, else that factor.

    Examples
    --------
    >>> settings_factor(SurveyArea.rectangle((499_000.0, 6_700_000.0, 501_000.0, 6_701_000.0), "EPSG:32608"))
    1.0
    >>> settings_factor(SurveyArea.rectangle((0.0, 8_399_000.0, 1000.0, 8_400_000.0), "EPSG:3857"))
    1.99
    """
    mean = MapScale.over(area.crs, area.bounds).linear.mean
    return 1.0 if abs(mean - 1.0) <= NOTABLE else mean


def in_grid_metres(settings: AnyModel, factor: float) -> AnyModel:
    """Return settings with their horizontal lengths in grid metres.

    Parameters
    ----------
    settings : pydantic.BaseModel
        Lengths are the fields named in this module, such as ``spacing_m``; None is left as it is.
    factor : float
        As `settings_factor` returns it.

    Returns
    -------
    pydantic.BaseModel
        The same object for a factor of 1.

    Examples
    --------
    >>> from planners.config_lawnmower import LawnmowerConfig
    >>> in_grid_metres(LawnmowerConfig(spacing_m=50.0), 2.0).spacing_m
    100.0
    """
    if factor == 1.0:
        return settings
    lengths = {name: getattr(settings, name) for name in _HORIZONTAL if name in type(settings).model_fields}
    changed = {name: factor * value for name, value in lengths.items() if value is not None}
    return settings.model_copy(update=changed)


def dem_in_grid_metres(dem: Dem | None, factor: float) -> Dem | None:
    """Return a DEM with heights in grid metres, so that its slopes are those of the ground.

    Parameters
    ----------
    dem : Dem or None
        Heights in metres.
    factor : float
        As `settings_factor` returns it.

    Returns
    -------
    Dem or None
        The same object for a factor of 1.
    """
    if dem is None or factor == 1.0:
        return dem
    return Dem(factor * dem.elevation, dem.transform, dem.crs, dem.vertical_datum)
