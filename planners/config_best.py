"""Moved out of planners/config.py."""

from typing import Literal, Self

from pydantic import PositiveFloat, PositiveInt, model_validator

from planners.config import Corner, PatternConfig


class BestConfig(PatternConfig):
    """The swaths of least predicted error: straight or wavy, their heading, inset and spacing are chosen."""

    pattern: Literal["best"] = "best"
    """Name of the pattern."""
    swaths: PositiveInt | None = None
    """As far as the plain lawnmower of so many swaths drives; give this or one of the next three."""
    spacing_m: PositiveFloat | None = None
    """As far as the plain lawnmower of this spacing drives [m]."""
    budget_m: PositiveFloat | None = None
    """Distance that may be driven [m]."""
    rmse_m: PositiveFloat | None = None
    """Predicted root-mean-square error to reach by the shortest route [m]."""
    heading_deg: float | None = None
    """Direction of the swaths [deg]; four headings are compared when left out."""
    start: Corner | None = None
    """Corner of the first swath."""

    @model_validator(mode="after")
    def _one_of_four(self) -> Self:
        if [self.swaths, self.spacing_m, self.budget_m, self.rmse_m].count(None) != 3:
            raise ValueError("give one of swaths, spacing_m, budget_m and rmse_m")
        return self
