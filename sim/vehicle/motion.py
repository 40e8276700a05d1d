"""Motion of the rover: physics, states at equal time steps, and exact motion along a route.

`Physics` is the interface of all models of the rover; `KinematicRover` rolls without forces. `RoverMotion` interpolates
the states for the sensors. `exact_drive` gives the motion of a rover that follows its route exactly and rests on the
ground; it needs no physics.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from planners import Rover
from sim.config.rover import PhysicsConfig
from survey import Dem, InputError, Route, Trajectory
from survey.core import FloatArray

Vector = tuple[float, float, float]

GRAVITY_M_S2 = 9.81


class HeightField(Protocol):
    """Height field of the ground on a square grid."""

    @property
    def step_m(self) -> float:
        """Distance between neighbouring nodes [m]."""
        ...

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """``(xmin, ymin, xmax, ymax)`` of the outermost nodes [m]."""
        ...

    def elevation(self, xy: FloatArray, /) -> FloatArray:
        """Return the height of places (N, 2) [m]; NaN beyond the bounds."""
        ...


class RoverState(NamedTuple):
    """Real state of a rover, for sensors and scores, never for estimators.

    ``position`` of the body's origin on the ground between the tracks [m], ``velocity`` of
    that point [m/s] and ``rate`` of turn [rad/s] are in the world's frame; ``quaternion``
    (x, y, z, w) takes the body to the world; ``rolled_m`` is what the left and the right
    track have rolled; ``energy_j`` the energy drawn from the battery.
    """

    time_s: float
    position: Vector
    quaternion: tuple[float, float, float, float]
    velocity: Vector
    rate: Vector
    rolled_m: tuple[float, float]
    energy_j: float

    @property
    def heading_rad(self) -> float:
        """Heading, counter-clockwise from east [rad]."""
        x, y, z, w = self.quaternion
        return float(np.arctan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z)))


class Physics(Protocol):
    """Physics of a rover, in steps of fixed length at commanded track speeds."""

    dt_s: float
    """Length of a step [s]."""
    friction_share: float
    """Friction of the ground as a share of the usual one; below 1 on slippery spots."""
    drive_share: tuple[float, float]
    """Speed of the left and the right track as shares of the commanded ones; 0 is a stuck track."""

    def step(self, left_m_s: float, right_m_s: float) -> None:
        """Advance by one step at commanded track speeds [m/s]."""
        ...

    @property
    def state(self) -> RoverState:
        """State after the last step."""
        ...


def origin_of(ground: HeightField, xy: FloatArray) -> FloatArray:
    """Return the place on the ground (3,) above which a rover starts."""
    height = ground.elevation(np.atleast_2d(xy))
    return np.array([xy[0], xy[1], float(height[0])])


class Tracks:
    """Step, grip and track speeds that all models of a rover have."""

    def __init__(self, config: PhysicsConfig) -> None:
        self.dt_s = 1.0 / config.rate_hz
        self.friction_share = 1.0
        self.drive_share = (1.0, 1.0)

    def _driven(self, left_m_s: float, right_m_s: float) -> tuple[float, float]:
        """Return the speeds of both tracks that follow from the commanded ones [m/s]."""
        return left_m_s * self.drive_share[0], right_m_s * self.drive_share[1]


class KinematicRover(Tracks):
    r"""Kinematic model of a rover: it rests on the ground and rolls at the speed of its tracks, less slip.

    On a slope θ the tracks slip by i = i₀ + tan²θ; the turn is a share of what the tracks'
    difference asks for, as skidding tracks give it:

    .. math:: v = (1 - i) (v_l + v_r) / 2, \qquad \omega = \kappa (v_r - v_l) / b

    What it cannot do: inertia, side-slip, stalling, tipping over. For machines without a rigid-body engine.
    """

    SLIP = 0.01
    TURN_SHARE = 0.5

    def __init__(
        self, ground: HeightField, config: PhysicsConfig, rover: Rover, start: FloatArray, heading_rad: float
    ) -> None:
        super().__init__(config)
        self._ground, self._config, self._rover = ground, config, rover
        self._n_steps = 0
        self._xy = np.array(start, dtype=np.float64)
        self._heading = heading_rad
        self._rolled = np.zeros(2)
        self._energy = 0.0
        self._slope = 0.0
        self._speeds = 0.0, 0.0

    def step(self, left_m_s: float, right_m_s: float) -> None:
        """Advance by one step at commanded track speeds [m/s]."""
        left, right = self._driven(left_m_s, right_m_s)
        self._n_steps += 1
        self._rolled += self.dt_s * left, self.dt_s * right
        slip = min((self.SLIP + np.tan(self._slope) ** 2) / self.friction_share, 1.0)
        speed = (1.0 - slip) * 0.5 * (left + right)
        turn = self.TURN_SHARE * (right - left) / self._config.track_gauge_m
        self._heading += self.dt_s * turn
        along = np.array([np.cos(self._heading), np.sin(self._heading)])
        self._xy = self._xy + self.dt_s * speed * np.cos(self._slope) * along
        self._speeds = speed, turn
        rover = self._rover
        resisted = rover.rolling_resistance * np.cos(self._slope) + np.sin(self._slope)
        pull = rover.mass_kg * GRAVITY_M_S2 * max(resisted, 0.0)
        self._energy += self.dt_s * (rover.idle_w + pull * abs(0.5 * (left + right)) / rover.efficiency)
        if self._n_steps % 12 == 0:
            self._slope = float(-self._attitude()[1])

    def _attitude(self) -> FloatArray:
        """Return roll, pitch and yaw of the plane through four points under the tracks [rad]."""
        half = 0.5 * self._config.track_length_m, 0.5 * self._config.track_gauge_m
        ahead = np.array([np.cos(self._heading), np.sin(self._heading)]) * half[0]
        left = np.array([-np.sin(self._heading), np.cos(self._heading)]) * half[1]
        corners = self._xy + [ahead + left, ahead - left, left - ahead, -left - ahead]
        z = np.nan_to_num(self._ground.elevation(corners))
        rise_ahead = (z[0] + z[1] - z[2] - z[3]) / (4.0 * half[0])
        rise_left = (z[0] + z[2] - z[1] - z[3]) / (4.0 * half[1])
        pitch = -np.arctan(rise_ahead)
        return np.array([np.arctan(rise_left * np.cos(pitch)), pitch, self._heading])

    @property
    def state(self) -> RoverState:
        """State after the last step."""
        height = float(np.nan_to_num(self._ground.elevation(self._xy[None]))[0])
        turned = Rotation.from_euler("xyz", self._attitude())
        speed, turn = self._speeds
        return RoverState(
            self._n_steps * self.dt_s,
            (float(self._xy[0]), float(self._xy[1]), height),
            tuple(turned.as_quat().tolist()),
            tuple((turned.as_matrix()[:, 0] * speed).tolist()),
            tuple((turned.as_matrix()[:, 2] * turn).tolist()),
            (float(self._rolled[0]), float(self._rolled[1])),
            self._energy,
        )


@dataclass(frozen=True)
class RoverMotion:
    """States of the rover at equal time steps, interpolated in between.

    `time_s` (N,): times [s]. `position` (N, 3): position of the body's origin in the world [m]. `quaternion`
    (N, 4): rotation from the body to the world (x, y, z, w). `velocity`, `rate` (N, 3): velocity and rate of
    turn in the world [m/s, rad/s]. `rolled_m` (N, 2): distance rolled by the left and the right track [m].
    """

    time_s: FloatArray
    position: FloatArray
    quaternion: FloatArray
    velocity: FloatArray
    rate: FloatArray
    rolled_m: FloatArray

    @classmethod
    def of(cls, states: Sequence[RoverState]) -> "RoverMotion":
        """Return the motion through states in the order of time."""
        return cls(*(np.array([state[k] for state in states]) for k in range(6)))

    def displaced(self, displacement: Callable[[FloatArray, FloatArray], FloatArray]) -> "RoverMotion":
        """Return the motion with displacements (N, 3) of its places (N, 2) at its times (N,) added [m]."""
        moved = displacement(self.position[:, :2], self.time_s)
        return replace(self, position=self.position + moved)

    @property
    def rotation(self) -> Rotation:
        """Rotation from the body to the world at every time."""
        return Rotation.from_quat(self.quaternion)

    def position_at(self, time_s: FloatArray) -> FloatArray:
        """Return the origin (M, 3) at times within the stretch."""
        return _between(self.time_s, self.position, time_s)

    def rotation_at(self, time_s: FloatArray) -> Rotation:
        """Return the attitude at times within the stretch."""
        return self._turning(np.clip(time_s, self.time_s[0], self.time_s[-1]))

    @cached_property
    def _turning(self) -> Slerp:
        """Interpolator of the attitude."""
        return Slerp(self.time_s, self.rotation)

    def rolled_at(self, time_s: FloatArray) -> FloatArray:
        """Return the distances (M, 2) rolled by both tracks at times within the stretch [m]."""
        return _between(self.time_s, self.rolled_m, time_s)

    def velocity_at(self, time_s: FloatArray) -> FloatArray:
        """Return the origin's velocity (M, 3) in the world at times within the stretch [m/s]."""
        return _between(self.time_s, self.velocity, time_s)

    def pose_at(self, time_s: float) -> FloatArray:
        """Return T_world_body (4, 4) at a time."""
        pose = np.eye(4)
        pose[:3, :3] = self.rotation_at(np.array([time_s])).as_matrix()[0]
        pose[:3, 3] = self.position_at(np.array([time_s]))[0]
        return pose


def _between(time_s: FloatArray, values: FloatArray, at_s: FloatArray) -> FloatArray:
    return np.column_stack([np.interp(at_s, time_s, column) for column in values.T])


_HALF_LENGTH_M = 0.5


def exact_drive(
    terrain: Dem, route: Route, speed_m_s: float, interval_s: float = 1.0
) -> tuple[Trajectory, FloatArray]:
    """Return the real poses of a rover that follows a route exactly, and their attitudes.

    `speed_m_s`: speed along the route [m/s]. `interval_s`: time between poses [s]. Returns `attitude_rad` (N,
    3): roll, pitch and yaw [rad].
    """
    samples = route.sample(speed_m_s * interval_s)
    time_s = samples.distance_m / speed_m_s
    return poses_at_rest(terrain, samples.xy, samples.heading_rad, time_s)


def poses_at_rest(
    terrain: Dem, xy: FloatArray, heading_rad: FloatArray, time_s: FloatArray
) -> tuple[Trajectory, FloatArray]:
    """Return the poses of a rover at rest on the terrain, and their attitudes.

    `xy` (N, 2): places [m]. `heading_rad` (N,): headings [rad]. `time_s` (N,): times, increasing [s]. Returns
    `attitude_rad` (N, 3): roll, pitch and yaw [rad].
    """
    height = terrain.at(xy)
    if np.isnan(height).any():
        east, north = xy[np.flatnonzero(np.isnan(height))[0]]
        raise InputError(
            f"the route leaves the known terrain at ({east:.1f}, {north:.1f}); cut the area to the terrain "
            "(area.clip_to_terrain) or take a larger raster."
        )
    attitude = _resting_attitude(terrain, xy, heading_rad)
    position = np.column_stack([xy, height])
    zero = np.zeros((len(position), 3, 3))
    turns = Rotation.from_euler("xyz", attitude).as_quat(canonical=True)
    return Trajectory(time_s, position, turns, zero, terrain.crs), attitude


def _resting_attitude(terrain: Dem, xy: FloatArray, heading_rad: FloatArray) -> FloatArray:
    """Return roll, pitch and yaw (N, 3) of a rover of about a metre at rest on the ground [rad]."""
    ahead = _HALF_LENGTH_M * np.column_stack([np.cos(heading_rad), np.sin(heading_rad)])
    left = _HALF_LENGTH_M * np.column_stack([-np.sin(heading_rad), np.cos(heading_rad)])
    pitch = -np.arctan(_rise(terrain, xy, ahead))
    roll = np.arctan(_rise(terrain, xy, left))
    return np.column_stack([roll, pitch, heading_rad])


def _rise(terrain: Dem, xy: FloatArray, half: FloatArray) -> FloatArray:
    """Return the slope of the ground from xy − half to xy + half; level where the terrain is not known."""
    rise = (terrain.at(xy + half) - terrain.at(xy - half)) / (2.0 * np.hypot(half[:, 0], half[:, 1]))
    return np.where(np.isfinite(rise), rise, 0.0)
