"""Configuration of the rover's physics: tracks, motors and route following."""

from typing import Annotated, Literal

from pydantic import Field, PositiveFloat, PositiveInt

from survey.core.config import Section


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
