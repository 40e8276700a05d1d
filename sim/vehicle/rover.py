"""Contact physics of a tracked, skid-steered rover as rigid bodies (Bullet).

Each track is a row of wheels that turn alike. Thrust, slip, side-slip, turning and tipping
over come out of Coulomb friction at the wheels' contacts with snow that gives a little.
Bullet holds the ground as one patch of heights, which follows the rover in whole cells.
"""

from typing import Any

import numpy as np

from planners import Rover
from sim.config.drive import PhysicsConfig
from sim.vehicle.bullet import BulletClient
from sim.vehicle.physics import GRAVITY_M_S2, HeightField, RoverState, origin_of
from survey.core.arrays import FloatArray

_N_WHEELS = 3
_WHEEL_MASS_SHARE = 0.02
_AXLE_BELOW_M = 0.06
_SINKAGE_M = 0.002
_DAMPED = 0.5
_PATCH_M = 40.0
_MOVED_M = 10.0
_HALF_RELIEF_M = 50.0
_RESISTED_FROM_M_S = 0.05
_ITERATIONS = 20
_SETTLED_S = 2.0


class ContactRover:
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
        Bullet is not installed.

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
        self.bullet = BulletClient()
        self.dt_s = 1.0 / config.rate_hz
        self.friction_share = 1.0
        self.drive_share = (1.0, 1.0)
        self._ground, self._config, self._rover = ground, config, rover
        self._weight = rover.mass_kg * GRAVITY_M_S2
        self._origin = origin_of(ground, start)
        self._n_steps = 0
        self.shaft_work_j = 0.0
        self.resisted_j = 0.0
        self._battery_j = 0.0
        self._asked: tuple[float, float, float] | None = None
        call = self.bullet
        call.setGravity(0.0, 0.0, -GRAVITY_M_S2)
        # Bullet's friction cone is a pyramid along the world's axes; without it, along the slip.
        call.setPhysicsEngineParameter(
            fixedTimeStep=self.dt_s,
            numSubSteps=0,
            numSolverIterations=_ITERATIONS,
            enableConeFriction=0,
            deterministicOverlappingPairs=1,
        )
        self._patch: int | None = None
        self._shape = -1
        self.patch_centre = 0.0, 0.0
        self._lay_patch(0.0, 0.0)
        self.wheels = list(range(2 * _N_WHEELS))
        self.body = self._built(heading_rad)
        self._settle()

    def _built(self, heading_rad: float) -> int:
        """Build the rover on the ground, and return its body."""
        call, config, mass = self.bullet, self._config, self._rover.mass_kg
        radius, gauge, length = config.wheel_radius_m, config.track_gauge_m, config.track_length_m
        between = max(0.5 * gauge - radius, 0.05)
        chassis = call.createCollisionShape(call.GEOM_BOX, halfExtents=[0.5 * length, between, _AXLE_BELOW_M])
        wheel = call.createCollisionShape(call.GEOM_SPHERE, radius=radius)
        along = np.linspace(0.5, -0.5, _N_WHEELS) * length
        places = [[x, side * 0.5 * gauge, -_AXLE_BELOW_M] for side in (1.0, -1.0) for x in along]
        n = len(places)
        self._height_m = radius + _AXLE_BELOW_M - _SINKAGE_M
        body: int = call.createMultiBody(
            mass * (1.0 - n * _WHEEL_MASS_SHARE),
            chassis,
            basePosition=[0.0, 0.0, self._height_m + self._highest_below(heading_rad)],
            baseOrientation=[0.0, 0.0, np.sin(0.5 * heading_rad), np.cos(0.5 * heading_rad)],
            linkMasses=[_WHEEL_MASS_SHARE * mass] * n,
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
        stiffness = self._weight / n / _SINKAGE_M
        for link in range(-1, n):
            call.changeDynamics(
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
        return body

    def _settle(self) -> None:
        """Let the rover come to rest on its tracks, and reset all counters."""
        self._read()
        for _ in range(round(_SETTLED_S / self.dt_s)):
            self.step(0.0, 0.0)
        self._n_steps = 0
        self._unrolled_from = self._angles
        self.shaft_work_j = self.resisted_j = self._battery_j = 0.0

    def _highest_below(self, heading_rad: float) -> float:
        """Return the height of the highest ground under the rover at its start, above that at its middle [m]."""
        config = self._config
        half = 0.5 * config.track_length_m + config.wheel_radius_m, 0.5 * config.track_gauge_m
        x, y = (axis.ravel() for axis in np.meshgrid(*(np.linspace(-h, h, 9) for h in half)))
        cos, sin = np.cos(heading_rad), np.sin(heading_rad)
        places = self._origin[:2] + np.column_stack([x * cos - y * sin, x * sin + y * cos])
        return float(np.nanmax(self._ground.elevation(places))) - float(self._origin[2])

    def _lay_patch(self, x: float, y: float) -> None:
        """Place the patch of ground around a point; where it overlaps the last patch the triangles are the same."""
        call, step = self.bullet, self._ground.step_m
        xmin, ymin, xmax, ymax = self._ground.bounds
        n = round(_PATCH_M / step) + 1
        first = np.round((self._origin[:2] + [x, y] - [xmin, ymin]) / step) - n // 2
        east, north = xmin + (first[0] + np.arange(n)) * step, ymin + (first[1] + np.arange(n)) * step
        # Beyond the map the last heights go on; the mission ends when the rover gets there.
        nodes = np.stack(np.meshgrid(np.clip(east, xmin, xmax), np.clip(north, ymin, ymax)), axis=-1)
        height = self._ground.elevation(nodes.reshape(-1, 2)) - self._origin[2]
        # Whole metres, so that the engine's single precision gives a place the same height on every patch.
        middle = float(np.round(0.5 * (height.min() + height.max())))
        self._shape_ground(np.clip(height - middle, -_HALF_RELIEF_M, _HALF_RELIEF_M), n)
        centre = [
            0.5 * (side[0] + side[-1]) - at for side, at in zip((east, north), self._origin, strict=False)
        ]
        call.resetBasePositionAndOrientation(self._patch, [*centre, middle], [0.0, 0.0, 0.0, 1.0])
        self.patch_centre = float(centre[0]), float(centre[1])

    def _shape_ground(self, height: FloatArray, n: int) -> None:
        """Set the heights of the patch; its bounds are fixed when it is created, wide enough for all."""
        call, step = self.bullet, self._ground.step_m
        field = {
            "shapeType": call.GEOM_HEIGHTFIELD,
            "meshScale": [step, step, 1.0],
            "numHeightfieldRows": n,
            "numHeightfieldColumns": n,
        }
        if self._patch is None:
            widest = np.zeros(n * n)
            widest[:2] = -_HALF_RELIEF_M, _HALF_RELIEF_M
            self._shape = call.createCollisionShape(**field, heightfieldData=widest.tolist())
            self._patch = call.createMultiBody(0, self._shape)
            call.changeDynamics(self._patch, -1, lateralFriction=1.0, restitution=0.0)
        call.createCollisionShape(
            **field, heightfieldData=height.tolist(), replaceHeightfieldIndex=self._shape
        )

    def step(self, left_m_s: float, right_m_s: float) -> None:
        """Advance by one step at commanded track speeds [m/s]."""
        self._ask(left_m_s * self.drive_share[0], right_m_s * self.drive_share[1])
        resistance = self._resist()
        turning, velocity = self._turning, self._velocity
        self.bullet.stepSimulation()
        self._n_steps += 1
        self._read()
        self._account(resistance, turning, velocity)
        (x, y, _), (at_x, at_y) = self._place, self.patch_centre
        if max(abs(x - at_x), abs(y - at_y)) > _MOVED_M:
            self._lay_patch(x, y)

    def _ask(self, left_m_s: float, right_m_s: float) -> None:
        """Set motor speeds and friction where they have changed."""
        asked = left_m_s, right_m_s, self.friction_share
        if asked == self._asked:
            return
        call, config = self.bullet, self._config
        radius = config.wheel_radius_m
        if self._asked is None or self._asked[2] != self.friction_share:
            for link in range(-1, len(self.wheels)):
                friction = config.friction * self.friction_share
                call.changeDynamics(self.body, link, lateralFriction=friction)
        call.setJointMotorControlArray(
            self.body,
            self.wheels,
            call.VELOCITY_CONTROL,
            targetVelocities=[left_m_s / radius] * _N_WHEELS + [right_m_s / radius] * _N_WHEELS,
            # Where one wheel carries the load it gets all of its track's torque.
            forces=[0.5 * config.thrust_share * self._weight * radius] * len(self.wheels),
        )
        self._asked = asked

    def _resist(self) -> list[float]:
        """Apply the resistance of the snow along the body; return the force [N]."""
        x, y, z, w = self._turn
        ahead = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)
        along = sum(a * v for a, v in zip(ahead, self._velocity, strict=True))
        force = -float(self._rover.rolling_resistance * self._weight * np.tanh(along / _RESISTED_FROM_M_S))
        pushed = [force * a for a in ahead]
        self.bullet.applyExternalForce(self.body, -1, pushed, self._place, self.bullet.WORLD_FRAME)
        return pushed

    def _read(self) -> None:
        """Read the state of chassis and wheels from Bullet."""
        call = self.bullet
        self._place, self._turn = call.getBasePositionAndOrientation(self.body)
        self._velocity, self._rate = call.getBaseVelocity(self.body)
        wheels = call.getJointStates(self.body, self.wheels)
        self._angles = [wheel[0] for wheel in wheels]
        self._turning = [wheel[1] for wheel in wheels]
        self._torques = [wheel[3] for wheel in wheels]

    def _account(self, resistance: list[float], turning: list[float], velocity: tuple[float, ...]) -> None:
        """Add the work of a step, at the mean of the speeds before and after it."""
        rates = zip(self._torques, turning, self._turning, strict=True)
        power = sum(torque * 0.5 * (old + new) for torque, old, new in rates)
        speeds = zip(resistance, velocity, self._velocity, strict=True)
        self.resisted_j -= self.dt_s * sum(force * 0.5 * (old + new) for force, old, new in speeds)
        self.shaft_work_j += self.dt_s * power
        self._battery_j += self.dt_s * (max(power, 0.0) / self._rover.efficiency + self._rover.idle_w)

    @property
    def state(self) -> RoverState:
        """State after the last step."""
        x, y, z, w = self._turn
        down = [-self._height_m * part for part in _up(x, y, z, w)]
        place = [at + below + start for at, below, start in zip(self._place, down, self._origin, strict=True)]
        moving = [v + c for v, c in zip(self._velocity, _cross(self._rate, down), strict=True)]
        share = self._config.wheel_radius_m / _N_WHEELS
        rolled = [share * (now - then) for now, then in zip(self._angles, self._unrolled_from, strict=True)]
        return RoverState(
            self._n_steps * self.dt_s,
            (float(place[0]), float(place[1]), float(place[2])),
            self._turn,
            (moving[0], moving[1], moving[2]),
            self._rate,
            (sum(rolled[:_N_WHEELS]), sum(rolled[_N_WHEELS:])),
            self._battery_j,
        )


def _up(x: float, y: float, z: float, w: float) -> tuple[float, float, float]:
    """Return the direction of the body's z axis in the world."""
    return 2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)


def _cross(a: Any, b: Any) -> tuple[float, float, float]:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
