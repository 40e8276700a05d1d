"""Configuration of the rovers: limits and physics of one, size of the fleet, and science payload.

`RoverConfig` says how a rover drives, what ground it can stand, and where its instruments sit.
`PhysicsConfig` holds tracks, motors and route following. `FleetConfig` gives the number of rovers and what happens when
one is lost. `PayloadConfig` describes a scalar quantity, its sensor, and the simulated field that it measures.
"""

from math import atan, degrees
from typing import Annotated, Literal

from pydantic import Field, NonNegativeFloat, PositiveFloat, PositiveInt

from planners import Fleet, Rover
from survey.core import Section
from survey.data.sensors.payload import Quantity


class RoverConfig(Rover):
    """How the rover drives, what ground it can stand, and where its instruments sit."""

    antenna_height_m: NonNegativeFloat = 0.5
    """Height of the GPS antenna above the ground [m]."""
    camera_height_m: PositiveFloat = 0.7
    """Height of the camera above the ground [m]."""
    max_step_m: PositiveFloat | None = None
    """Largest difference of height over 2 m [m], for the hazards of the map; not checked when left out."""

    def hazard_slope_deg(self, base_m: float) -> float | None:
        """Return the steepest slope over a base that no limit forbids [deg]; None without limits.

        Parameters
        ----------
        base_m : float
            Base of slopes and steps [m].

        Returns
        -------
        float or None
            The least of the largest pitch, the largest roll and the slope of the largest step.

        Examples
        --------
        >>> round(RoverConfig(max_pitch_deg=20.0, max_step_m=0.5).hazard_slope_deg(2.0), 1)
        14.0
        """
        step_deg = None if self.max_step_m is None else degrees(atan(self.max_step_m / base_m))
        return min((limit for limit in (self.max_slope_deg, step_deg) if limit is not None), default=None)


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
