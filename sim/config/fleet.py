"""Configuration of a fleet on its mission: how many rovers, and what happens when one is lost."""

from typing import Literal

from pydantic import Field

from planners import Fleet


class FleetConfig(Fleet):
    """Number of rovers, where they finish, and what the others do when one is lost."""

    on_loss: Literal["continue", "replan"] = "continue"
    """Whether the others drive on as planned when a rover is lost, or share the swaths that it leaves."""
    loss_probability: float = Field(default=0.0, ge=0.0, le=1.0)
    """Probability that a rover stops for good between a tenth and nine tenths of its way."""
