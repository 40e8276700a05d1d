"""Configuration of a science payload: sensors of scalar quantities, and the fields that they measure."""

from typing import Literal

from pydantic import Field, NonNegativeFloat, PositiveFloat

from survey.data.sensors.payload import Quantity


class PayloadConfig(Quantity):
    """A quantity, its sensor, and the simulated field of it over the site."""

    name: str = Field(pattern=r"^[a-z][a-z0-9_]*$")
    """Name of the quantity and of its column: lower case, digits and underscores."""
    noise_sd: PositiveFloat = 0.1
    """Standard deviation of the noise of a reading, in the unit."""
    lag_s: NonNegativeFloat = 0.0
    """Time constant with which the sensor follows its surroundings [s]; 0 for one that follows at once."""
    rate_hz: PositiveFloat = 1.0
    """Readings per second."""
    mean: float = 0.0
    """Simulated value at the site's mean elevation."""
    per_km_of_elevation: float = 0.0
    """Simulated change with elevation: -6.5 degC for air temperature."""
    facing_south: float = 0.0
    """Simulated surplus of a vertical wall that faces south; a slope has its share."""
    field_sd: NonNegativeFloat = 1.0
    """Standard deviation of the simulated variation from place to place."""
    field_length_m: PositiveFloat = 100.0
    """Length scale of that variation [m]."""
    field_kind: Literal["rough", "medium", "smooth"] = "medium"
    """Smoothness of that variation: of one derivative, of two, or of all."""
