"""Energy balance of the contact physics: motor work against kinetic, potential and dissipated energy."""

from dataclasses import dataclass

import numpy as np

from sim.vehicle.physics import GRAVITY_M_S2
from sim.vehicle.rover import ContactRover
from survey.core.arrays import FloatArray


@dataclass
class EnergyBalance:
    r"""Sum of the work of every force on a rover, step by step.

    .. math:: W_{motors} = \Delta (E_{kin} + m g z) + W_{snow} + W_{contacts}

    The contacts' work is taken from the forces that the engine reports and the velocities
    of the very points they act on, so that the balance tests the engine: nothing in it
    follows from the rest.

    Parameters
    ----------
    rover : ContactRover
        At rest or moving.
    """

    rover: ContactRover
    contacts_j: float = 0.0

    def __post_init__(self) -> None:
        self._bodies = self._moving()
        self._energy_before_j = self._mechanical_j()
        self._shaft_before_j = self.rover.shaft_work_j
        self._resisted_before_j = self.rover.resisted_j

    def step(self, left_m_s: float, right_m_s: float) -> None:
        """Advance the rover by one step and add the work of its contacts."""
        before = self._bodies
        self.rover.step(left_m_s, right_m_s)
        self._bodies = self._moving()
        call, rover = self.rover.bullet, self.rover
        for contact in call.getContactPoints(bodyA=rover.body):
            body = contact[3] + 1
            place, normal = np.array(contact[5]), np.array(contact[7])
            force = contact[9] * normal
            force += contact[10] * np.array(contact[11]) + contact[12] * np.array(contact[13])
            arm = place - before[0][body]
            speed = 0.5 * (_speed(before, body, arm) + _speed(self._bodies, body, arm))
            self.contacts_j -= rover.dt_s * float(force @ speed)

    @property
    def motors_j(self) -> float:
        """Work of the motors [J]."""
        return self.rover.shaft_work_j - self._shaft_before_j

    @property
    def missing_j(self) -> float:
        """Motor work that no other term accounts for [J]."""
        gained = self._mechanical_j() - self._energy_before_j
        resisted = self.rover.resisted_j - self._resisted_before_j
        return self.motors_j - gained - resisted - self.contacts_j

    def _moving(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Place, velocity and rate (N, 3 each) of the chassis and the wheels."""
        call, rover = self.rover.bullet, self.rover
        place, _ = call.getBasePositionAndOrientation(rover.body)
        velocity, rate = call.getBaseVelocity(rover.body)
        wheels = call.getLinkStates(rover.body, rover.wheels, computeLinkVelocity=1)
        return (
            np.array([place, *(wheel[0] for wheel in wheels)]),
            np.array([velocity, *(wheel[6] for wheel in wheels)]),
            np.array([rate, *(wheel[7] for wheel in wheels)]),
        )

    def _mechanical_j(self) -> float:
        call, rover = self.rover.bullet, self.rover
        place, velocity, rate = self._bodies
        total = 0.0
        for body in range(len(place)):
            mass, _, inertia = call.getDynamicsInfo(rover.body, body - 1)[:3]
            spin = rate[body] if body else self._in_body_frame(rate[0])
            total += mass * (0.5 * float(velocity[body] @ velocity[body]) + GRAVITY_M_S2 * place[body, 2])
            total += 0.5 * float(np.array(inertia) @ spin**2)
        return total

    def _in_body_frame(self, vector: FloatArray) -> FloatArray:
        """Turn a vector into the chassis' frame; wheels are spheres and need no frame."""
        call, rover = self.rover.bullet, self.rover
        _, turn = call.getBasePositionAndOrientation(rover.body)
        turned: FloatArray = np.array(call.getMatrixFromQuaternion(turn)).reshape(3, 3).T @ vector
        return turned


def _speed(bodies: tuple[FloatArray, FloatArray, FloatArray], body: int, arm: FloatArray) -> FloatArray:
    """Velocity (3,) of a point at an arm from a body's middle [m/s]; the engine keeps the arm during a step."""
    _, velocity, rate = bodies
    moved: FloatArray = velocity[body] + np.cross(rate[body], arm)
    return moved
