"""Settings of planners, and their lengths in the metres of the map.

The classes hold the settings that several patterns share; each pattern adds its own in `planners.patterns`. Lengths
are metres on the ground, angles are degrees. Geometry is computed in the metres of the area's CRS (grid metres).
Where the linear scale factor of the projection is within 1 % of 1, as in UTM zones and most national grids, settings
are taken as grid metres. Elsewhere `in_grid_metres` multiplies them by the mean factor over the area. Lengths, times
and energies of a planned route are always those on the ground.
"""

from typing import TYPE_CHECKING, Literal, Self, TypeVar

from pydantic import (
    BaseModel,
    Field,
    NonNegativeFloat,
    NonNegativeInt,
    PositiveFloat,
    PositiveInt,
    model_validator,
)

from survey import Dem, SurveyArea
from survey.core import Section
from survey.core.map_scale import NOTABLE, MapScale

Corner = Literal["south-west", "south-east", "north-west", "north-east"]
HeadingRule = Literal["narrowest", "fewest-swaths", "slope", "grain"]


class PatternConfig(Section):
    """Base of all configurations of planners.

    Subclasses have a field ``pattern`` whose only value is the planner's name.
    """

    if TYPE_CHECKING:
        # A field of the base would come first in every file that is written.
        pattern: str


class SwathConfig(PatternConfig):
    """Parallel reference lines over the area: how many, which way, how far from the border."""

    swaths: PositiveInt | None = None
    """Number of swaths; give this or `spacing_m`."""
    spacing_m: PositiveFloat | None = None
    """Ground sample spacing: the largest distance between neighbouring swaths [m]."""
    heading_deg: float | None = None
    """Direction of the swaths, counter-clockwise from east [deg]; by `heading_rule` when left out."""
    heading_rule: HeadingRule = "narrowest"
    """Along the longer side, with the fewest swaths (needs `spacing_m`), up the slope, or across the terrain's grain."""
    start: Corner | None = None
    """Corner of the first swath; the one nearest to the area's first start, else the south-western one."""
    outer_share: float = Field(default=0.5, gt=0.0, le=1.0)
    """Distance of the outermost swaths from the border, in spacings."""
    inset_share: NonNegativeFloat = 0.0
    """How far swaths end before the border, in spacings."""
    shortest_m: NonNegativeFloat | None = None
    """Shortest swath that is driven [m]; by default half a spacing and four turns, which are what it takes to drive one more."""
    tie_lines: NonNegativeInt = 0
    """Number of lines driven across the swaths at the end."""

    @model_validator(mode="after")
    def _one_of_two(self) -> Self:
        if (self.swaths is None) == (self.spacing_m is None):
            raise ValueError("give either swaths or spacing_m")
        return self


_HORIZONTAL = (
    "spacing_m", "shortest_m", "wavelength_m", "step_m", "budget_m", "turn_radius_m", "clearance_m", "separation_m",
    "sample_step_m", "max_roughness_m", "speed_m_s",
)  # fmt: skip
"""Settings that grow with the unit of the map. Heights count in it too where slopes are taken."""

AnyModel = TypeVar("AnyModel", bound=BaseModel)


def settings_factor(area: SurveyArea) -> float:
    """Return the factor that turns metres of settings into grid metres.

    >>> settings_factor(SurveyArea.rectangle((499_000.0, 6_700_000.0, 501_000.0, 6_701_000.0), "EPSG:32608"))
    1.0
    >>> settings_factor(SurveyArea.rectangle((0.0, 8_399_000.0, 1000.0, 8_400_000.0), "EPSG:3857"))
    1.99
    """
    mean = MapScale.over(area.crs, area.bounds).linear.mean
    return 1.0 if abs(mean - 1.0) <= NOTABLE else mean


def in_grid_metres(settings: AnyModel, factor: float) -> AnyModel:
    """Return settings with their horizontal lengths in grid metres.

    >>> from planners.patterns.lawnmower import LawnmowerConfig
    >>> in_grid_metres(LawnmowerConfig(spacing_m=50.0), 2.0).spacing_m
    100.0
    """
    if factor == 1.0:
        return settings
    lengths = {name: getattr(settings, name) for name in _HORIZONTAL if name in type(settings).model_fields}
    changed = {name: factor * value for name, value in lengths.items() if value is not None}
    return settings.model_copy(update=changed)


def dem_in_grid_metres(dem: Dem | None, factor: float) -> Dem | None:
    """Return a DEM with heights in grid metres, so that its slopes are those of the ground."""
    if dem is None or factor == 1.0:
        return dem
    return Dem(factor * dem.elevation, dem.transform, dem.crs, dem.vertical_datum)
