"""Rover physics: the common interface, and a kinematic model without forces."""

from typing import NamedTuple, Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from planners import Rover
from sim.config.drive import PhysicsConfig
from survey.core.arrays import FloatArray

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
