"""What a planner is asked for; every length in metres, every angle in degrees."""

from typing import Literal, Self

from pydantic import Field, NonNegativeFloat, NonNegativeInt, PositiveFloat, PositiveInt, model_validator

from survey.config import Section

Corner = Literal["south-west", "south-east", "north-west", "north-east"]


class SwathConfig(Section):
    """Parallel reference lines over the area: how many, which way, how far from the border."""

    swaths: PositiveInt | None = None
    """Number of swaths; give this or `spacing_m`."""
    spacing_m: PositiveFloat | None = None
    """Ground sample spacing: the largest distance between neighbouring swaths [m]."""
    heading_deg: float | None = None
    """Direction of the swaths, counter-clockwise from east [deg]; the one that needs fewest swaths when left out."""
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


class LawnmowerConfig(SwathConfig):
    """Straight swaths at ``(i + 1/2) L / n``, driven back and forth from border to border (glacier paper, III.A).

    Examples
    --------
    >>> LawnmowerConfig(swaths=4).inset_share
    0.0
    """

    pattern: Literal["lawnmower"] = "lawnmower"
    """Name of the pattern."""


PlannerConfig = LawnmowerConfig
