"""Moved out of planners/layout.py."""

from planners.config_wavy import WavyConfig
from planners.driving.rover import Crew
from planners.layout import swath_route
from planners.swaths.swaths import Swath
from planners.swaths.wavy import wavy
from survey.core.arrays import FloatArray
from survey.core.errors import ConfigError
from survey.data.area import SurveyArea
from survey.data.route import Route


def wavy_route(
    area: SurveyArea, config: WavyConfig, *, slope_length_m: float | None = None, crew: Crew | None = None
) -> Route:
    """Lay wavy swaths over an area and join them.

    Parameters
    ----------
    area : SurveyArea
        The free ground.
    config : WavyConfig
        Number or spacing of the swaths, heading, border and waves.
    slope_length_m : float, optional
        Distance over which the terrain's slopes change [m]; needed without a wavelength.
    crew : Crew, optional
        Rovers and prior elevations; one rover that pivots by default.

    Returns
    -------
    Route
        Without a prediction.

    Raises
    ------
    ConfigError
        Neither a wavelength nor a slope length.
    """
    crew = crew or Crew()
    wavelength_m = _wavelength_m(config, slope_length_m)
    radius_m = crew.rover.turn_radius_m

    def waves(axes: list[FloatArray], spacing_m: float) -> list[Swath]:
        return wavy(axes, area, config, spacing_m, wavelength_m, turn_radius_m=radius_m)

    return swath_route(area, config, crew, waves)


def _wavelength_m(config: WavyConfig, slope_length_m: float | None) -> float:
    if config.wavelength_m is not None:
        return config.wavelength_m
    if slope_length_m is None:
        raise ConfigError("wavy swaths need a wavelength_m, or a prior or a kernel to take it from.")
    return config.wavelength_scales * slope_length_m
