"""Configurations of planners; lengths in metres on the ground, angles in degrees."""

from typing import TYPE_CHECKING, Literal, Self

from pydantic import Field, NonNegativeFloat, NonNegativeInt, PositiveFloat, PositiveInt, model_validator

from survey.core.config import Section

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
    tie_lines: NonNegativeInt = 0
    """Number of lines driven across the swaths at the end."""

    @model_validator(mode="after")
    def _one_of_two(self) -> Self:
        if (self.swaths is None) == (self.spacing_m is None):
            raise ValueError("give either swaths or spacing_m")
        return self
