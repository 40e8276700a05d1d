"""Rigid bodies of the rover in the Bullet physics engine (pybullet)."""

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from sim.vehicle.bodies import (
    AXLE_BELOW_M,
    HALF_RELIEF_M,
    N_WHEELS,
    SINKAGE_M,
    WHEEL_MASS_SHARE,
    BodyState,
    GroundPatch,
    RoverBodies,
    motor_torque_n_m,
)
from sim.vehicle.physics import GRAVITY_M_S2, Vector
from survey.core.arrays import FloatArray
from survey.core.errors import ConfigError

_DAMPED = 0.5
_ITERATIONS = 20


class BulletClient:
    """Bullet client with a world of its own, closed with the object."""

    def __init__(self) -> None:
        with _silence():
            try:
                import pybullet
            except ImportError as error:
                raise ConfigError(
                    "physics.engine is 'bullet', but pybullet is not installed (it has wheels up to Python 3.11); "
                    'set physics.engine = "mujoco" or "kinematic".'
                ) from error
            self._client = pybullet.connect(pybullet.DIRECT)
        self._module = pybullet

    def __getattr__(self, name: str) -> Any:
        """Return Bullet's function of that name for this world, or its constant."""
        if name.startswith("_"):  # a client that could not connect has no module to ask
            raise AttributeError(name)
        found = getattr(self._module, name)
        if callable(found):
            found = partial(found, physicsClientId=self._client)
        setattr(self, name, found)
        return found

    def __del__(self) -> None:
        if hasattr(self, "_module"):
            self._module.disconnect(self._client)


class BulletBodies:
    """Rover and ground in Bullet.

    Parameters
    ----------
    bodies : RoverBodies
        Tracks, mass, pose at the start.
    patch : GroundPatch
        Ground around the start.

    Raises
    ------
    ConfigError
        Bullet is not installed.
    """

    def __init__(self, bodies: RoverBodies, patch: GroundPatch) -> None:
        self.bullet = BulletClient()
        self._config, self._rover = bodies.config, bodies.rover
        self._asked: tuple[float, float, float] | None = None
        self._patch: int | None = None
        self._shape = -1
        self._place: Vector = (0.0, 0.0, 0.0)
        call = self.bullet
        call.setGravity(0.0, 0.0, -GRAVITY_M_S2)
        # Bullet's friction cone is a pyramid along the world's axes; without it, along the slip.
        call.setPhysicsEngineParameter(
            fixedTimeStep=1.0 / bodies.config.rate_hz,
            numSubSteps=0,
            numSolverIterations=_ITERATIONS,
            enableConeFriction=0,
            deterministicOverlappingPairs=1,
        )
        self.lay(patch)
        self.wheels = list(range(2 * N_WHEELS))
        self.body = self._built(bodies)

    def _built(self, bodies: RoverBodies) -> int:
        """Build the rover on the ground, and return its body."""
        call, config, mass = self.bullet, self._config, self._rover.mass_kg
        radius, gauge, length = config.wheel_radius_m, config.track_gauge_m, config.track_length_m
        between, heading = max(0.5 * gauge - radius, 0.05), bodies.heading_rad
        chassis = call.createCollisionShape(call.GEOM_BOX, halfExtents=[0.5 * length, between, AXLE_BELOW_M])
        wheel = call.createCollisionShape(call.GEOM_SPHERE, radius=radius)
        along = np.linspace(0.5, -0.5, N_WHEELS) * length
        places = [[x, side * 0.5 * gauge, -AXLE_BELOW_M] for side in (1.0, -1.0) for x in along]
        n = len(places)
        body: int = call.createMultiBody(
            mass * (1.0 - n * WHEEL_MASS_SHARE),
            chassis,
            basePosition=[0.0, 0.0, bodies.height_m],
            baseOrientation=[0.0, 0.0, np.sin(0.5 * heading), np.cos(0.5 * heading)],
            linkMasses=[WHEEL_MASS_SHARE * mass] * n,
            linkCollisionShapeIndices=[wheel] * n,
            linkVisualShapeIndices=[-1] * n,
            linkPositions=places,
            linkOrientations=[[0.0, 0.0, 0.0, 1.0]] * n,
            linkInertialFramePositions=[[0.0, 0.0, 0.0]] * n,
            linkInertialFrameOrientations=[[0.0, 0.0, 0.0, 1.0]] * n,
            linkParentIndices=[0] * n,
            linkJointTypes=[call.JOINT_REVOLUTE] * n,
            linkJointAxis=[[0.0, 1.0, 0.0]] * n,
        )
        self._set_contacts(body, n)
        return body

    def _set_contacts(self, body: int, n: int) -> None:
        """Set friction, stiffness and damping of the contacts of every link."""
        config, mass = self._config, self._rover.mass_kg
        stiffness = mass * GRAVITY_M_S2 / n / SINKAGE_M
        for link in range(-1, n):
            self.bullet.changeDynamics(
                body,
                link,
                lateralFriction=config.friction,
                anisotropicFriction=[1.0, config.lateral_share, 1.0],
                restitution=0.0,
                linearDamping=0.0,
                angularDamping=0.0,
                jointDamping=0.0,
                contactStiffness=stiffness,
                contactDamping=_DAMPED * 2.0 * np.sqrt(stiffness * mass / n),
            )

    def lay(self, patch: GroundPatch) -> None:
        """Replace the patch; its bounds are fixed when it is created, wide enough for all."""
        call, n = self.bullet, len(patch.height)
        field = {
            "shapeType": call.GEOM_HEIGHTFIELD,
            "meshScale": [patch.step_m, patch.step_m, 1.0],
            "numHeightfieldRows": n,
            "numHeightfieldColumns": n,
        }
        if self._patch is None:
            widest: FloatArray = np.zeros(n * n)
            widest[:2] = -HALF_RELIEF_M, HALF_RELIEF_M
            self._shape = call.createCollisionShape(**field, heightfieldData=widest.tolist())
            self._patch = call.createMultiBody(0, self._shape)
            call.changeDynamics(self._patch, -1, lateralFriction=1.0, restitution=0.0)
        height = patch.height.ravel().tolist()
        call.createCollisionShape(**field, heightfieldData=height, replaceHeightfieldIndex=self._shape)
        call.resetBasePositionAndOrientation(self._patch, list(patch.centre), [0.0, 0.0, 0.0, 1.0])

    def command(self, left_rad_s: float, right_rad_s: float, friction: float) -> None:
        """Set motor speeds and friction where they have changed."""
        asked = left_rad_s, right_rad_s, friction
        if asked == self._asked:
            return
        call = self.bullet
        if self._asked is None or self._asked[2] != friction:
            for link in range(-1, len(self.wheels)):
                call.changeDynamics(self.body, link, lateralFriction=friction)
        # Where one wheel carries the load it gets all of its track's torque.
        torque = motor_torque_n_m(self._config, self._rover)
        call.setJointMotorControlArray(
            self.body,
            self.wheels,
            call.VELOCITY_CONTROL,
            targetVelocities=[left_rad_s] * N_WHEELS + [right_rad_s] * N_WHEELS,
            forces=[torque] * len(self.wheels),
        )
        self._asked = asked

    def push(self, force: list[float]) -> None:
        """Apply a force to the middle of the chassis during the next step [N]."""
        self.bullet.applyExternalForce(self.body, -1, force, self._place, self.bullet.WORLD_FRAME)

    def step(self) -> None:
        """Advance by one step."""
        self.bullet.stepSimulation()

    def read(self) -> BodyState:
        """Return the state of chassis and wheels."""
        call = self.bullet
        self._place, turn = call.getBasePositionAndOrientation(self.body)
        velocity, rate = call.getBaseVelocity(self.body)
        wheels = call.getJointStates(self.body, self.wheels)
        angles, turning, _, torques = (list(column) for column in zip(*wheels, strict=True))
        return BodyState(self._place, turn, velocity, rate, angles, turning, torques)


@contextmanager
def _silence() -> Iterator[None]:
    """Suppress Bullet's messages on standard output and standard error."""
    sys.stdout.flush()
    sys.stderr.flush()
    copies = [os.dup(stream) for stream in (1, 2)]
    with Path(os.devnull).open("wb") as nowhere:
        for stream in (1, 2):
            os.dup2(nowhere.fileno(), stream)
    try:
        yield
    finally:
        ctypes.CDLL(None).fflush(None)
        for stream, copy in zip((1, 2), copies, strict=True):
            os.dup2(copy, stream)
            os.close(copy)
