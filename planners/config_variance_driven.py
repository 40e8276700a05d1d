"""Moved out of planners/config.py."""

from typing import Literal, Self

from pydantic import Field, PositiveFloat, model_validator

from planners.config import Corner, PatternConfig


class VarianceDrivenConfig(PatternConfig):
    """A path that goes where the map is predicted to be least certain; give a budget or a wanted error."""

    pattern: Literal["variance-driven"] = "variance-driven"
    """Name of the pattern."""
    budget_m: PositiveFloat | None = None
    """Distance that may be driven [m]; give this or `rmse_m`."""
    rmse_m: PositiveFloat | None = None
    """Predicted root-mean-square error to reach [m]."""
    n_places: int = Field(default=12, ge=3, le=40)
    """Number of candidate waypoints along the longer side of the area."""
    start: Corner | None = None
    """Corner to begin at; the one nearest to the area's first start, else the south-western one."""

    @model_validator(mode="after")
    def _one_of_two(self) -> Self:
        if (self.budget_m is None) == (self.rmse_m is None):
            raise ValueError("give either budget_m or rmse_m")
        return self
