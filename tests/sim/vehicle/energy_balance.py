"""Energy balance of the contact physics: motor work against kinetic, potential and dissipated energy."""

from typing import Any, Protocol

import numpy as np

from sim.vehicle.motion import GRAVITY_M_S2
from sim.vehicle.rigid_bodies import BulletBodies, MujocoBodies
from sim.vehicle.rover import ContactRover
from survey.core.arrays import FloatArray


class Ledger(Protocol):
    """Energies of one engine, from the forces and speeds that it reports."""

    contacts_j: float

    def before(self) -> None:
        """Note the state before a step."""
        ...

    def after(self, dt_s: float) -> None:
        """Add the work of the contacts during a step."""
        ...

    def mechanical_j(self) -> float:
        """Return kinetic and potential energy [J]."""
        ...


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

    def __init__(self, rover: ContactRover) -> None:
        self.rover = rover
        engine: Any = rover.engine
        self._ledger: Ledger = (
            BulletLedger(engine) if isinstance(engine, BulletBodies) else MujocoLedger(engine)
        )
        self._energy_before_j = self._ledger.mechanical_j()
        self._shaft_before_j = rover.shaft_work_j
        self._resisted_before_j = rover.resisted_j

    def step(self, left_m_s: float, right_m_s: float) -> None:
        """Advance the rover by one step and add the work of its contacts."""
        self._ledger.before()
        self.rover.step(left_m_s, right_m_s)
        self._ledger.after(self.rover.dt_s)

    @property
    def motors_j(self) -> float:
        """Work of the motors [J]."""
        return self.rover.shaft_work_j - self._shaft_before_j

    @property
    def missing_j(self) -> float:
        """Motor work that no other term accounts for [J]."""
        gained = self._ledger.mechanical_j() - self._energy_before_j
        resisted = self.rover.resisted_j - self._resisted_before_j
        return self.motors_j - gained - resisted - self._ledger.contacts_j


class BulletLedger:
    """Energies in Bullet."""

    def __init__(self, engine: BulletBodies) -> None:
        self.contacts_j = 0.0
        self._engine, self._call = engine, engine.bullet
        self._bodies = self._moving()

    def before(self) -> None:
        """Note the state before a step."""
        self._bodies = self._moving()

    def after(self, dt_s: float) -> None:
        """Add the work of the contacts during a step."""
        before, self._bodies = self._bodies, self._moving()
        for contact in self._call.getContactPoints(bodyA=self._engine.body):
            body = contact[3] + 1
            place, normal = np.array(contact[5]), np.array(contact[7])
            force = contact[9] * normal
            force += contact[10] * np.array(contact[11]) + contact[12] * np.array(contact[13])
            arm = place - before[0][body]
            speed = 0.5 * (_speed(before, body, arm) + _speed(self._bodies, body, arm))
            self.contacts_j -= dt_s * float(force @ speed)

    def mechanical_j(self) -> float:
        """Return kinetic and potential energy [J]."""
        place, velocity, rate = self._bodies
        total = 0.0
        for body in range(len(place)):
            mass, _, inertia = self._call.getDynamicsInfo(self._engine.body, body - 1)[:3]
            spin = rate[body] if body else self._in_body_frame(rate[0])
            total += mass * (0.5 * float(velocity[body] @ velocity[body]) + GRAVITY_M_S2 * place[body, 2])
            total += 0.5 * float(np.array(inertia) @ spin**2)
        return total

    def _moving(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Place, velocity and rate (N, 3 each) of the chassis and the wheels."""
        call, engine = self._call, self._engine
        place, _ = call.getBasePositionAndOrientation(engine.body)
        velocity, rate = call.getBaseVelocity(engine.body)
        wheels = call.getLinkStates(engine.body, engine.wheels, computeLinkVelocity=1)
        return (
            np.array([place, *(wheel[0] for wheel in wheels)]),
            np.array([velocity, *(wheel[6] for wheel in wheels)]),
            np.array([rate, *(wheel[7] for wheel in wheels)]),
        )

    def _in_body_frame(self, vector: FloatArray) -> FloatArray:
        """Turn a vector into the chassis' frame; wheels are spheres and need no frame."""
        _, turn = self._call.getBasePositionAndOrientation(self._engine.body)
        matrix = np.array(self._call.getMatrixFromQuaternion(turn)).reshape(3, 3)
        turned: FloatArray = matrix.T @ vector
        return turned


class MujocoLedger:
    """Energies in MuJoCo; contacts are read after each of the parts of a step."""

    def __init__(self, engine: MujocoBodies) -> None:
        self.contacts_j = 0.0
        self._engine, self._advance = engine, engine.advance
        engine.advance = self._watched  # type: ignore[method-assign]  # the parts of a step are seen here alone

    def before(self) -> None:
        """Note the state before a step; nothing, for the parts are watched."""

    def after(self, dt_s: float) -> None:
        """Add the work of the contacts during a step; nothing, for the parts are watched."""

    def mechanical_j(self) -> float:
        """Return kinetic and potential energy [J] of the rover, that of the motors' rotors included."""
        import mujoco

        model, data = self._engine.model, self._engine.data
        now = mujoco.MjData(model)
        # The ground stays at its first place: it has a mass, and is put elsewhere when the patch changes.
        now.qpos[:], now.qvel[:] = data.qpos, data.qvel
        mujoco.mj_forward(model, now)
        mujoco.mj_energyPos(model, now)
        mujoco.mj_energyVel(model, now)
        return float(now.energy.sum())

    def _watched(self) -> None:
        """Advance by one part of a step; add the contacts' forces times the mean velocity of their points."""
        import mujoco

        model, data = self._engine.model, self._engine.data
        before = data.qvel.copy()
        self._advance()
        mean, force = 0.5 * (before + data.qvel), np.zeros(6)
        for k in range(data.ncon):
            mujoco.mj_contactForce(model, data, k, force)
            frame, at = data.contact.frame[k].reshape(3, 3), data.contact.pos[k]
            body = model.geom_bodyid[data.contact.geom2[k]]
            jacobian = np.zeros((3, model.nv))
            mujoco.mj_jac(model, data, jacobian, None, at, body)
            self.contacts_j -= model.opt.timestep * float(frame.T @ force[:3] @ jacobian @ mean)


def _speed(bodies: tuple[FloatArray, FloatArray, FloatArray], body: int, arm: FloatArray) -> FloatArray:
    """Velocity (3,) of a point at an arm from a body's middle [m/s]; the engine keeps the arm during a step."""
    _, velocity, rate = bodies
    moved: FloatArray = velocity[body] + np.cross(rate[body], arm)
    return moved
