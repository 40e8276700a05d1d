"""Moved out of planners/config.py."""

from typing import Self

from pydantic import Field, PositiveFloat, model_validator

from planners.config import SwathConfig


class SteeredConfig(SwathConfig):
    """Swaths that the rover deviates from while it drives."""

    step_m: PositiveFloat = 10.0
    """Distance driven between two decisions [m]."""
    candidates_deg: tuple[float, ...] = Field(default=(-45.0, 0.0, 45.0), min_length=1, strict=False)
    """Headings to choose from, counter-clockwise from the swath's, within 80° of it [deg]."""
    toggle_probability: float = Field(default=0.1, ge=0.0, le=1.0)
    """Chance per step that the rule is switched."""
    band_share: float = Field(default=0.5, ge=0.0, le=0.5)
    """Greatest distance from the swath, in spacings."""

    @model_validator(mode="after")
    def _forward(self) -> Self:
        if max(abs(candidate) for candidate in self.candidates_deg) > 80.0:
            raise ValueError(
                "candidates_deg must lie within 80 degrees of the swath, or the rover would not advance"
            )
        return self
