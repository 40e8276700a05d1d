"""Contact physics of a tracked, skid-steered rover as rigid bodies, in Bullet or in MuJoCo.

Each track is a row of wheels that turn alike. Thrust, slip, side-slip, turning and tipping over come out of Coulomb
friction at the wheels' contacts with snow that gives a little. An engine holds the ground as one patch of heights;
`ContactRover` moves the patch with the rover in whole cells, and accounts for work and energy.
"""

import ctypes
import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from numba import njit

from planners import Rover
from sim.config.rover import PhysicsConfig
from sim.vehicle.motion import GRAVITY_M_S2, HeightField, RoverState, Tracks, Vector, origin_of
from survey.core import ConfigError, FloatArray

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

    >>> added([1.0, 1e100, -1e100])
    0.0
    """
    total = 0.0
    for value in values:
        total += value
    return total


_MODULES = {"bullet": "pybullet", "mujoco": "mujoco"}


def choose_physics(name: str) -> str:
    """Return the rigid-body engine that a mission asks for; ``contact`` means the first one installed."""
    wanted = list(_MODULES) if name == "contact" else [name]
    for engine in wanted:
        if find_spec(_MODULES[engine]) is not None:
            return engine
    missing = " nor ".join(_MODULES[engine] for engine in wanted)
    neither = "neither " if len(wanted) > 1 else ""
    raise ConfigError(
        f"physics.engine is {name!r}, and {neither}{missing} is {'' if neither else 'not '}installed; "
        f'install {_MODULES[wanted[-1]]}, or set physics.engine = "kinematic".'
    )


def rigid_bodies(bodies: RoverBodies, patch: GroundPatch) -> RigidBodies:
    """Return the rover and its ground in the engine of the configuration."""
    if choose_physics(bodies.config.engine) == "bullet":
        return BulletBodies(bodies, patch)
    return MujocoBodies(bodies, patch)


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

    `bodies`: tracks, mass, pose at the start. `patch`: ground around the start.
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


_BASE_M = 1.0
_N_SUBSTEPS = 2
# Inertia of motors and gears, as felt at a wheel.
_ARMATURE_KG_M2 = 0.01
# Spring and damper of a contact per unit of its mass (1/s², 1/s): about 2 mm of sinkage at rest. A small
# impedance with a strong spring, for a spinning track must not lift itself off the ground: MuJoCo's cone is convex,
# and the normal spring holds against friction times the reference acceleration of the slip.
_IMPEDANCE, _STIFFNESS, _DAMPING = 0.2, 2400.0, 150.0
# Slip dies away at that rate (1/s) within the cone, and standing tracks creep that much less than they sink.
_SLIP_DAMPING, _FRICTION_STIFFNESS = 10.0, 1e4
_SLIP = np.array([-1.0, -_SLIP_DAMPING])
_INTEGRAL_S = 0.05


class MujocoBodies:
    """Rover and ground in MuJoCo, with one motor for the linked wheels of each track.

    A motor is a controller of speed with a proportional and an integral part and a bounded
    torque. The friction cone is an ellipse with axes along and across the tracks.

    `bodies`: tracks, mass, pose at the start. `patch`: ground around the start.
    """

    def __init__(self, bodies: RoverBodies, patch: GroundPatch) -> None:
        try:
            import mujoco
        except ImportError as error:
            raise ConfigError(
                "physics.engine is 'mujoco', but mujoco is not installed; "
                'install it, or set physics.engine = "kinematic".'
            ) from error
        self._mujoco = mujoco
        self.model: Any = mujoco.MjModel.from_xml_string(_model(bodies, patch))
        self.data: Any = mujoco.MjData(self.model)
        self._lateral_share = bodies.config.lateral_share
        self._torque = motor_torque_n_m(bodies.config, bodies.rover)
        self._gain = 0.5 * _wheel_inertia(bodies) * N_WHEELS / self.model.opt.timestep
        self._integrated = self.model.opt.timestep / _INTEGRAL_S
        self._integral, self._target, self._torques = [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]
        self._friction = bodies.config.friction
        self.lay(patch)
        self.data.qpos[:7] = _start_pose(bodies)
        mujoco.mj_forward(self.model, self.data)
        # Views of the engine's own memory.
        self._turning, self._motors = self.data.qvel[6:], self.data.ctrl
        self._axes = self.data.xmat[2].reshape(3, 3)

    def lay(self, patch: GroundPatch) -> None:
        """Replace the patch of ground."""
        self.model.hfield_data[:] = ((patch.height + HALF_RELIEF_M) / (2.0 * HALF_RELIEF_M)).ravel()
        x, y, z = patch.centre
        self.data.mocap_pos[0] = x, y, z - HALF_RELIEF_M

    def command(self, left_rad_s: float, right_rad_s: float, friction: float) -> None:
        """Set the speeds that the motors aim at, and the friction of the ground."""
        self._target = [left_rad_s, right_rad_s]
        self._friction = friction

    def push(self, force: list[float]) -> None:
        """Apply a force to the middle of the chassis during the next step [N]."""
        self.data.xfrc_applied[2, :3] = force

    def step(self) -> None:
        """Advance by one step of equal parts."""
        left = right = 0.0
        for _ in range(_N_SUBSTEPS):
            self._drive()
            left, right = left + self._torques[0], right + self._torques[1]
            self.advance()
        self._torques = [left / _N_SUBSTEPS, right / _N_SUBSTEPS]

    def _drive(self) -> None:
        """Set the torques of both tracks' motors; the integral stops where the torque is bounded."""
        # MuJoCo's own speed controller needs an implicit integrator, which does not support this contact solver.
        turning = self._turning.tolist()
        for track in (0, 1):
            mean = added(turning[track * N_WHEELS : (track + 1) * N_WHEELS]) / N_WHEELS
            missing = self._gain * (self._target[track] - mean)
            integral = self._integral[track] + missing * self._integrated
            wanted = missing + integral
            self._torques[track] = min(max(wanted, -self._torque), self._torque)
            if abs(wanted) <= self._torque:
                self._integral[track] = integral
        left, right = (torque / N_WHEELS for torque in self._torques)
        self._motors[:] = [left] * N_WHEELS + [right] * N_WHEELS

    def advance(self) -> None:
        """Advance by one time step of the engine, with friction along and across the tracks."""
        engine, model, data = self._mujoco, self.model, self.data
        engine.mj_fwdPosition(model, data)
        self._orient_contacts()
        engine.mj_makeConstraint(model, data)
        engine.mj_projectConstraint(model, data)
        engine.mj_fwdVelocity(model, data)
        engine.mj_fwdActuation(model, data)
        engine.mj_fwdAcceleration(model, data)
        engine.mj_fwdConstraint(model, data)
        engine.mj_Euler(model, data)

    def _orient_contacts(self) -> None:
        """Turn the contacts' frames along the tracks, and set friction along and across them."""
        contacts = self.data.contact
        # Tracks hold less across than along them; the engine's own frames do not follow the tracks.
        if self.data.ncon:
            across = self._friction * self._lateral_share
            contacts.solreffriction[:] = _SLIP
            _orient(contacts.frame, contacts.pos, contacts.dist, self._axes[:, 0])
            contacts.friction[:, :2] = self._friction, across

    def read(self) -> BodyState:
        """Return the state of chassis and wheels."""
        position, velocity = self.data.qpos, self.data.qvel
        w, x, y, z = position[3:7].tolist()
        rate = _rotation(w, x, y, z) @ velocity[3:6]
        return BodyState(
            tuple(position[:3].tolist()),
            (x, y, z, w),
            tuple(velocity[:3].tolist()),
            tuple(rate.tolist()),
            position[7:].tolist(),
            velocity[6:].tolist(),
            [torque / N_WHEELS for torque in self._torques for _ in range(N_WHEELS)],
        )


def _model(bodies: RoverBodies, patch: GroundPatch) -> str:
    """Return the model of rover and ground in MuJoCo's XML."""
    config = bodies.config
    n, half_m = len(patch.height), 0.5 * (len(patch.height) - 1) * patch.step_m
    along = np.linspace(0.5, -0.5, N_WHEELS) * config.track_length_m
    places = [(x, side * 0.5 * config.track_gauge_m) for side in (1.0, -1.0) for x in along]
    wheels = "".join(_wheel(k, x, y, bodies) for k, (x, y) in enumerate(places))
    links = "".join(
        f'<joint joint1="{track * N_WHEELS + k}" joint2="{track * N_WHEELS}"/>'
        for track in range(2)
        for k in range(1, N_WHEELS)
    )
    motors = "".join(f'<motor joint="{k}"/>' for k in range(len(places)))
    between = max(0.5 * config.track_gauge_m - config.wheel_radius_m, 0.05)
    mass = bodies.rover.mass_kg * (1.0 - len(places) * WHEEL_MASS_SHARE)
    contact = (
        f'condim="3" priority="1" solref="{-_STIFFNESS} {-_DAMPING}" solimp="{_IMPEDANCE} {_IMPEDANCE} 0.001"'
    )
    return f"""<mujoco>
  <compiler angle="radian"/>
  <option timestep="{1.0 / config.rate_hz / _N_SUBSTEPS!r}" gravity="0 0 {-GRAVITY_M_S2}" cone="elliptic"
    impratio="{_FRICTION_STIFFNESS}"><flag island="disable"/></option>
  <default><geom {contact}/></default>
  <asset><hfield name="ground" nrow="{n}" ncol="{n}" size="{half_m} {half_m} {2.0 * HALF_RELIEF_M} {_BASE_M}"/></asset>
  <worldbody>
    <body mocap="true"><geom type="hfield" hfield="ground" priority="0"/></body>
    <body><freejoint/>
      <geom type="box" size="{0.5 * config.track_length_m} {between} {AXLE_BELOW_M}" mass="{mass}"/>{wheels}
    </body>
  </worldbody>
  <equality>{links}</equality>
  <actuator>{motors}</actuator>
</mujoco>"""


def _wheel(index: int, x: float, y: float, bodies: RoverBodies) -> str:
    """Return one wheel in MuJoCo's XML."""
    mass = WHEEL_MASS_SHARE * bodies.rover.mass_kg
    return (
        f'<body pos="{x} {y} {-AXLE_BELOW_M}"><joint name="{index}" axis="0 1 0" armature="{_ARMATURE_KG_M2}"/>'
        f'<geom type="sphere" size="{bodies.config.wheel_radius_m}" mass="{mass}"/></body>'
    )


def _wheel_inertia(bodies: RoverBodies) -> float:
    """Return the inertia of a wheel with its share of the motor about its axle [kg m²]."""
    mass = WHEEL_MASS_SHARE * bodies.rover.mass_kg
    return 0.4 * mass * bodies.config.wheel_radius_m**2 + _ARMATURE_KG_M2


def _start_pose(bodies: RoverBodies) -> list[float]:
    """Return place and quaternion (w, x, y, z) at the start."""
    half = 0.5 * bodies.heading_rad
    return [0.0, 0.0, bodies.height_m, float(np.cos(half)), 0.0, 0.0, float(np.sin(half))]


@njit(cache=True)
def _orient(frame: FloatArray, pos: FloatArray, dist: FloatArray, ahead: FloatArray) -> None:
    """Turn frames (N, 9) of contacts along a direction (3,), and put the contacts on the wheels' surface."""
    for k in range(len(frame)):
        nx, ny, nz = frame[k, 0], frame[k, 1], frame[k, 2]
        up = nx * ahead[0] + ny * ahead[1] + nz * ahead[2]
        x, y, z = ahead[0] - up * nx, ahead[1] - up * ny, ahead[2] - up * nz
        length = max(np.sqrt(x * x + y * y + z * z), 1e-9)
        x, y, z = x / length, y / length, z / length
        frame[k, 3:6] = x, y, z
        frame[k, 6:9] = ny * z - nz * y, nz * x - nx * z, nx * y - ny * x
        for axis in range(3):
            pos[k, axis] += 0.5 * dist[k] * frame[k, axis]


def _rotation(w: float, x: float, y: float, z: float) -> FloatArray:
    """Return the rotation matrix of a unit quaternion."""
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


# Bullet takes minutes to load a site at 0.25 m, and rovers fell through such a large field: a patch follows the rover.
_PATCH_M = 40.0
_MOVED_M = 10.0
_RESISTED_FROM_M_S = 0.05
_SETTLED_S = 2.0


class ContactRover(Tracks):
    """Rover of rigid bodies whose tracks push against the ground.

    `ground`: heights on square cells; 0.25 m or finer for a rover of 0.7 m. `config`: tracks, friction, rate.
    `rover`: mass, rolling resistance, efficiency and idle power. `start` (2,): easting and northing [m].
    `heading_rad`: counter-clockwise from east.

    Of the battery's energy the tracks' work is taken divided by the efficiency, and the
    idle power; braking gives nothing back. The snow's resistance is a force c m g against
    the motion, as compaction makes it. What it cannot do: the shear of a snow pack that
    gives way under the track, tracks that come off, wheels that dig in.
    """

    def __init__(
        self, ground: HeightField, config: PhysicsConfig, rover: Rover, start: FloatArray, heading_rad: float
    ) -> None:
        super().__init__(config)
        self._ground, self._config, self._rover = ground, config, rover
        self._weight = rover.mass_kg * GRAVITY_M_S2
        self._origin = origin_of(ground, start)
        self._n_steps = 0
        self.shaft_work_j = 0.0
        self.resisted_j = 0.0
        self._battery_j = 0.0
        self._height_m = config.wheel_radius_m + AXLE_BELOW_M - SINKAGE_M
        patch = self._patch_around(0.0, 0.0)
        self.patch_centre = patch.centre[:2]
        height = self._height_m + self._highest_below(heading_rad)
        self.engine = rigid_bodies(RoverBodies(config, rover, height, heading_rad), patch)
        self._now = self.engine.read()
        self._settle()

    def _settle(self) -> None:
        """Let the rover come to rest on its tracks, and reset all counters."""
        for _ in range(round(_SETTLED_S / self.dt_s)):
            self.step(0.0, 0.0)
        self._n_steps = 0
        self._unrolled_from = self._now.angles
        self.shaft_work_j = self.resisted_j = self._battery_j = 0.0

    def _highest_below(self, heading_rad: float) -> float:
        """Return the height of the highest ground under the rover at its start, above that at its middle [m]."""
        config = self._config
        half = 0.5 * config.track_length_m + config.wheel_radius_m, 0.5 * config.track_gauge_m
        x, y = (axis.ravel() for axis in np.meshgrid(*(np.linspace(-h, h, 9) for h in half)))
        cos, sin = np.cos(heading_rad), np.sin(heading_rad)
        places = self._origin[:2] + np.column_stack([x * cos - y * sin, x * sin + y * cos])
        return float(np.nanmax(self._ground.elevation(places))) - float(self._origin[2])

    def _patch_around(self, x: float, y: float) -> GroundPatch:
        """Return the patch of ground around a point; where it overlaps the last patch the triangles are the same."""
        step = self._ground.step_m
        xmin, ymin, xmax, ymax = self._ground.bounds
        n = round(_PATCH_M / step) + 1
        first = np.round((self._origin[:2] + [x, y] - [xmin, ymin]) / step) - n // 2
        east, north = xmin + (first[0] + np.arange(n)) * step, ymin + (first[1] + np.arange(n)) * step
        # Beyond the map the last heights go on; the mission ends when the rover gets there.
        nodes = np.stack(np.meshgrid(np.clip(east, xmin, xmax), np.clip(north, ymin, ymax)), axis=-1)
        height = self._ground.elevation(nodes.reshape(-1, 2)) - self._origin[2]
        # Whole metres, so that the engine's single precision gives a place the same height on every patch.
        middle = float(np.round(0.5 * (height.min() + height.max())))
        height = np.clip(height - middle, -HALF_RELIEF_M, HALF_RELIEF_M).reshape(n, n)
        at_x, at_y = (
            float(0.5 * (side[0] + side[-1]) - at)
            for side, at in zip((east, north), self._origin, strict=False)
        )
        return GroundPatch(height, step, (at_x, at_y, middle))

    def step(self, left_m_s: float, right_m_s: float) -> None:
        """Advance by one step at commanded track speeds [m/s]."""
        radius = self._config.wheel_radius_m
        left, right = self._driven(left_m_s, right_m_s)
        self.engine.command(left / radius, right / radius, self._config.friction * self.friction_share)
        before, resistance = self._now, self._resistance()
        self.engine.push(resistance)
        self.engine.step()
        self._n_steps += 1
        self._now = self.engine.read()
        self._account(resistance, before)
        (x, y, _), (at_x, at_y) = self._now.place, self.patch_centre
        if max(abs(x - at_x), abs(y - at_y)) > _MOVED_M:
            patch = self._patch_around(x, y)
            self.engine.lay(patch)
            self.patch_centre = patch.centre[:2]

    def _resistance(self) -> list[float]:
        """Return the resistance of the snow along the body [N]."""
        x, y, z, w = self._now.turn
        ahead = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)
        along = added(a * v for a, v in zip(ahead, self._now.velocity, strict=True))
        force = -float(self._rover.rolling_resistance * self._weight * np.tanh(along / _RESISTED_FROM_M_S))
        return [force * a for a in ahead]

    def _account(self, resistance: list[float], before: BodyState) -> None:
        """Add the work of a step, at the mean of the speeds before and after it."""
        now = self._now
        rates = zip(now.torques, before.turning, now.turning, strict=True)
        power = added(torque * 0.5 * (old + new) for torque, old, new in rates)
        speeds = zip(resistance, before.velocity, now.velocity, strict=True)
        self.resisted_j -= self.dt_s * added(force * 0.5 * (old + new) for force, old, new in speeds)
        self.shaft_work_j += self.dt_s * power
        self._battery_j += self.dt_s * (max(power, 0.0) / self._rover.efficiency + self._rover.idle_w)

    @property
    def state(self) -> RoverState:
        """State after the last step."""
        now = self._now
        x, y, z, w = now.turn
        down = [-self._height_m * part for part in _up(x, y, z, w)]
        place = [at + below + start for at, below, start in zip(now.place, down, self._origin, strict=True)]
        moving = [v + c for v, c in zip(now.velocity, _cross(now.rate, down), strict=True)]
        share = self._config.wheel_radius_m / N_WHEELS
        rolled = [share * (at - start) for at, start in zip(now.angles, self._unrolled_from, strict=True)]
        return RoverState(
            self._n_steps * self.dt_s,
            (float(place[0]), float(place[1]), float(place[2])),
            now.turn,
            (moving[0], moving[1], moving[2]),
            now.rate,
            (added(rolled[:N_WHEELS]), added(rolled[N_WHEELS:])),
            self._battery_j,
        )


def _up(x: float, y: float, z: float, w: float) -> Vector:
    """Return the direction of the body's z axis in the world."""
    return 2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)


def _cross(a: Vector, b: list[float]) -> Vector:
    """Return the cross product of two vectors."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
