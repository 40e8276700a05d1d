"""Moved out of planners/config.py."""

from typing import Literal

from pydantic import Field, NonNegativeFloat, PositiveFloat

from planners.config import SwathConfig


class WavyConfig(SwathConfig):
    """Swaths that wind about their lines, so that they also measure how the terrain changes across them.

    The defaults were chosen on random terrain of five kinds, with and without noise, other
    than the terrain on which the benchmark judges them.
    """

    pattern: Literal["wavy"] = "wavy"
    """Name of the pattern."""
    outer_share: float = Field(default=0.35, gt=0.0, le=1.0)
    """Distance of the outermost lines from the border, in spacings."""
    inset_share: NonNegativeFloat = 0.25
    """How far swaths end before the border, in spacings."""
    steepness: float = Field(default=0.6, ge=0.0, le=2.0)
    """Greatest slope of the wave against its line; 0.6 turns the rover by 31° and makes swaths 8 % longer."""
    amplitude_share: float = Field(default=0.25, ge=0.0, le=0.5)
    """Greatest distance from the line, in spacings."""
    wavelength_m: PositiveFloat | None = None
    """Length of a wave [m]; `wavelength_scales` slope lengths of the terrain when left out."""
    wavelength_scales: PositiveFloat = 0.85
    """Length of a wave in slope lengths: ℓ of a squared exponential, ℓ/√3 of a Matérn 3/2 covariance."""
