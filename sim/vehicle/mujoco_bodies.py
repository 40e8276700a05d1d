"""Rigid bodies of the rover in the MuJoCo physics engine."""

from typing import Any

import numpy as np
from numba import njit

from sim.vehicle.bodies import (
    AXLE_BELOW_M,
    HALF_RELIEF_M,
    N_WHEELS,
    WHEEL_MASS_SHARE,
    BodyState,
    GroundPatch,
    RoverBodies,
    added,
    motor_torque_n_m,
)
from sim.vehicle.physics import GRAVITY_M_S2
from survey.core.arrays import FloatArray
from survey.core.errors import ConfigError

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

    Parameters
    ----------
    bodies : RoverBodies
        Tracks, mass, pose at the start.
    patch : GroundPatch
        Ground around the start.

    Raises
    ------
    ConfigError
        MuJoCo is not installed.
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
