"""Configuration of the rovers: physics of one, size of the fleet, and science payload.

`PhysicsConfig` holds tracks, motors and route following. `FleetConfig` gives the number of rovers and what happens when
one is lost. `PayloadConfig` describes a scalar quantity, its sensor, and the simulated field that it measures.
"""

from typing import Annotated, Literal

from pydantic import Field, NonNegativeFloat, PositiveFloat, PositiveInt

from planners import Fleet
from survey.core.config import Section
from survey.data.sensors.payload import Quantity


class PhysicsConfig(Section):
    """The tracked, skid-steered rover; its mass, speed, resistance and battery stand in ``rover``."""

    engine: Literal["contact", "bullet", "mujoco", "kinematic"] = "contact"
    """Rigid bodies in contact with the ground, in Bullet where pybullet is installed and else in MuJoCo; one of
    these two by name; or a rolling model without forces."""
    rate_hz: PositiveInt = 240
    """Steps of the physics per second."""
    track_gauge_m: PositiveFloat = 0.45
    """Distance between the middles of the tracks [m]."""
    track_length_m: PositiveFloat = 0.50
    """Distance from the first to the last wheel of a track [m]; the rover is a wheel longer."""
    wheel_radius_m: PositiveFloat = 0.10
    """Radius of the wheels that stand for a track [m]."""
    friction: PositiveFloat = 0.5
    """Friction between track and ground; 0.15 on ice, 0.5 on firm snow."""
    lateral_share: Annotated[float, Field(gt=0.0, le=1.0)] = 0.7
    """Friction across the tracks as a share of that along them; the engine bounds the two apart, so with 1 a
    spinning track would hold sideways as firmly as a standing one, and the rover could not turn uphill."""
    thrust_share: PositiveFloat = 0.6
    """Greatest thrust of both tracks together as a share of the weight."""
    look_ahead_m: PositiveFloat = 1.0
    """Distance to the point of the route that is steered at [m]."""
    max_turn_rate_rad_s: PositiveFloat = 0.8
    """Fastest turn that is asked for [rad/s]."""
    steer_by: Literal["position", "estimate"] = "position"
    """Where the rover really is (open loop), or what its camera, wheels, gyro and fixes give while it drives."""
    goal_radius_m: Annotated[float, Field(gt=0.0)] = 0.5
    """The route is done within this distance of its end [m]."""


class FleetConfig(Fleet):
    """Number of rovers, where they finish, and what the others do when one is lost."""

    on_loss: Literal["continue", "replan"] = "continue"
    """Whether the others drive on as planned when a rover is lost, or share the swaths that it leaves."""
    loss_probability: float = Field(default=0.0, ge=0.0, le=1.0)
    """Probability that a rover stops for good between a tenth and nine tenths of its way."""


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
