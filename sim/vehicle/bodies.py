"""Rigid bodies of the contact physics: the interface of an engine, and what a rover is made of."""

from collections.abc import Iterable
from typing import NamedTuple, Protocol

from planners import Rover
from sim.config.drive import PhysicsConfig
from sim.vehicle.physics import GRAVITY_M_S2, Vector
from survey.core.arrays import FloatArray

N_WHEELS = 3
WHEEL_MASS_SHARE = 0.02
AXLE_BELOW_M = 0.06
SINKAGE_M = 0.002
HALF_RELIEF_M = 50.0


class GroundPatch(NamedTuple):
    """Square patch of ground heights around the rover.

    ``height`` (n, n) counts from ``centre[2]`` [m], its rows from south to north; ``centre``
    is in the engine's frame, whose origin is the place of the start.
    """

    height: FloatArray
    step_m: float
    centre: Vector


class RoverBodies(NamedTuple):
    """Rover as rigid bodies: configuration, mass and pose at the start."""

    config: PhysicsConfig
    rover: Rover
    height_m: float
    heading_rad: float


class BodyState(NamedTuple):
    """State of the bodies: chassis in the engine's frame, wheels of the left and then of the right track.

    ``turn`` (x, y, z, w) takes the body to the world; ``angles``, ``turning`` and ``torques``
    of the wheels are in rad, rad/s and N m, the torques those of the last step's motors.
    """

    place: Vector
    turn: tuple[float, float, float, float]
    velocity: Vector
    rate: Vector
    angles: list[float]
    turning: list[float]
    torques: list[float]


class RigidBodies(Protocol):
    """Rigid-body engine: a rover of a chassis and two rows of wheels on a patch of ground."""

    def lay(self, patch: GroundPatch) -> None:
        """Replace the patch of ground."""
        ...

    def command(self, left_rad_s: float, right_rad_s: float, friction: float) -> None:
        """Set the speeds that the motors aim at, and the friction of the ground."""
        ...

    def push(self, force: list[float]) -> None:
        """Apply a force to the middle of the chassis during the next step [N]."""
        ...

    def step(self) -> None:
        """Advance by one step."""
        ...

    def read(self) -> BodyState:
        """Return the state after the last step."""
        ...


def motor_torque_n_m(config: PhysicsConfig, rover: Rover) -> float:
    """Return the greatest torque of a track's motor."""
    weight = rover.mass_kg * GRAVITY_M_S2
    return 0.5 * config.thrust_share * weight * config.wheel_radius_m


def added(values: Iterable[float]) -> float:
    """Return the sum in the order of the values, with the same bytes in every Python (`sum` compensates since 3.12).

    Examples
    --------
    >>> added([1.0, 1e100, -1e100])
    0.0
    """
    total = 0.0
    for value in values:
        total += value
    return total
