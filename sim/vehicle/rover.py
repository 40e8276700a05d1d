"""Contact physics of a tracked, skid-steered rover as rigid bodies.

Each track is a row of wheels that turn alike. Thrust, slip, side-slip, turning and tipping
over come out of Coulomb friction at the wheels' contacts with snow that gives a little.
The engine (Bullet or MuJoCo) holds the ground as one patch of heights, which follows the
rover in whole cells.
"""

import numpy as np

from planners import Rover
from sim.config.rover import PhysicsConfig
from sim.vehicle.motion import GRAVITY_M_S2, HeightField, RoverState, Tracks, Vector, origin_of
from sim.vehicle.rigid_bodies import (
    AXLE_BELOW_M,
    HALF_RELIEF_M,
    N_WHEELS,
    SINKAGE_M,
    BodyState,
    GroundPatch,
    RoverBodies,
    added,
    rigid_bodies,
)
from survey.core.arrays import FloatArray

_PATCH_M = 40.0
_MOVED_M = 10.0
_RESISTED_FROM_M_S = 0.05
_SETTLED_S = 2.0


class ContactRover(Tracks):
    """Rover of rigid bodies whose tracks push against the ground.

    Parameters
    ----------
    ground : HeightField
        Heights on square cells; 0.25 m or finer for a rover of 0.7 m.
    config : PhysicsConfig
        Tracks, friction, rate.
    rover : Rover
        Mass, rolling resistance, efficiency and idle power.
    start : (2,) array_like
        Easting and northing [m].
    heading_rad : float
        Counter-clockwise from east.

    Raises
    ------
    ConfigError
        The physics engine is not installed.

    Notes
    -----
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
